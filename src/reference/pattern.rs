//! Sample patterns: Owen-scrambled Sobol pairs, and the inversion of tabulated densities.
//!
//! This work is based on: Burley, "Practical Hash-based Owen Scrambling", JCGT 2020, with Vegdahl's constants for the
//! Laine–Karras permutation; Ahmed, "An Implementation Algorithm of 2D Sobol Sequence Fast, Elegant, and Compact",
//! EGSR 2024, for the Pascal matrix. Pairs are padded: each dimension pair shuffles the index anew, so any number of
//! pairs is well distributed by itself and independent of the others.

use crate::geometry::hash;

/// How many path vertices draw from the scrambled sequence; deeper ones carry too little of the light to profit.
const PATTERNED_VERTICES: u32 = 3;

/// What a number at a path vertex is drawn for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Purpose {
    /// The direction in which the path goes on.
    Direction = 0,
    /// The point on an emitter.
    Emitter = 1,
    /// The direction to an image sky.
    Sky = 2,
    /// The lamp (first number) and whether the path survives (second).
    Choice = 3,
}

/// The numbers of one path: a function of (seed, point, replicate, sample, vertex, purpose) alone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Draws {
    /// Key of the replicate: all its samples share one scrambled sequence.
    pub replicate: u64,
    /// Number of the sample within its replicate.
    pub sample: u32,
}

impl Draws {
    /// Two numbers as 32-bit fractions of one.
    pub fn bits(&self, vertex: u32, purpose: Purpose) -> [u32; 2] {
        let dimension = u64::from(vertex) * 4 + purpose as u64;
        let key = self.replicate.wrapping_add(dimension.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        if vertex >= PATTERNED_VERTICES {
            return halves(hash::mix2(key, u64::from(self.sample)));
        }
        let [shuffle, x] = halves(hash::mix(key));
        let [y, shift] = halves(hash::mix(!key));
        // In bit-reversed order throughout: a nested uniform shuffle of the index, then of each coordinate.
        let index = permuted(self.sample.reverse_bits(), shuffle).reverse_bits();
        [(permuted(index, x) ^ shift).reverse_bits(), (permuted(pascal(index), y) ^ !shift).reverse_bits()]
    }

    /// Two numbers in [0, 1).
    pub fn pair(&self, vertex: u32, purpose: Purpose) -> [f32; 2] {
        self.bits(vertex, purpose).map(unit)
    }
}

/// The top 24 bits as a number in [0, 1).
pub(super) fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

fn halves(bits: u64) -> [u32; 2] {
    [(bits >> 32) as u32, bits as u32]
}

/// The Laine–Karras permutation: each bit of the result depends on that bit and the lower ones only, which, read in
/// reverse, is an Owen scramble.
fn permuted(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// The second Sobol dimension, bit-reversed: the product of the index with Pascal's triangle modulo 2.
fn pascal(mut index: u32) -> u32 {
    index ^= (index >> 1) & 0x5555_5555;
    index ^= (index >> 2) & 0x3333_3333;
    index ^= (index >> 4) & 0x0f0f_0f0f;
    index ^= (index >> 8) & 0x00ff_00ff;
    index ^ (index >> 16)
}

/// A discrete density with constant-time, order-preserving inversion (a guide table over the cumulative sums).
#[derive(Debug, Clone)]
pub(super) struct Density {
    /// Cumulative sums, starting with 0, one more than there are entries.
    sums: Vec<f64>,
    /// For each of equally many intervals of [0, 1): the entry in which it starts.
    guide: Vec<u32>,
}

/// An entry drawn from a [`Density`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Pick {
    /// Which.
    pub entry: usize,
    /// Where in the entry's interval the number fell, in [0, 1): as good as a new number.
    pub rest: f64,
    /// With what probability it is drawn.
    pub probability: f64,
}

impl Density {
    /// The density proportional to the weights; `None` when they do not sum to anything.
    pub fn new(weights: impl Iterator<Item = f64>) -> Option<Self> {
        let mut sums = vec![0.0];
        let mut sum = 0.0;
        for weight in weights {
            sum += weight;
            sums.push(sum);
        }
        if sum <= 0.0 || sum.is_nan() {
            return None;
        }
        let count = sums.len() - 1;
        let mut entry = 0;
        let guide = (0..count)
            .map(|k| {
                let start = k as f64 / count as f64 * sum;
                while sums[entry + 1] <= start {
                    entry += 1;
                }
                entry as u32
            })
            .collect();
        Some(Self { sums, guide })
    }

    /// The sum of the weights.
    pub fn total(&self) -> f64 {
        self.sums[self.sums.len() - 1]
    }

    /// The probability of an entry.
    pub fn probability(&self, entry: usize) -> f64 {
        (self.sums[entry + 1] - self.sums[entry]) / self.total()
    }

    /// The entry at a number given in 32-bit fractions of one.
    pub fn pick(&self, bits: u32) -> Pick {
        let x = (f64::from(bits) + 0.5) * (1.0 / 4_294_967_296.0);
        let at = x * self.total();
        let mut entry = self.guide[(x * self.guide.len() as f64) as usize] as usize;
        // The guide may start one entry late by rounding, and early by as many as share its interval.
        while entry > 0 && self.sums[entry] > at {
            entry -= 1;
        }
        while entry + 2 < self.sums.len() && self.sums[entry + 1] <= at {
            entry += 1;
        }
        let width = self.sums[entry + 1] - self.sums[entry];
        let rest = ((at - self.sums[entry]) / width.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0 - f64::EPSILON);
        Pick { entry, rest, probability: width / self.total() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn replicate(seed: u64, vertex: u32, count: u32) -> Vec<[f32; 2]> {
        (0..count)
            .map(|sample| Draws { replicate: hash::mix(seed), sample }.pair(vertex, Purpose::Emitter))
            .collect()
    }

    #[test]
    fn pairs_are_a_net_in_every_elementary_interval() {
        for vertex in 0..PATTERNED_VERTICES {
            for seed in 0..20 {
                let points = replicate(seed, vertex, 64);
                for columns in [1, 2, 4, 8, 16, 32, 64] {
                    let mut seen = [false; 64];
                    for [x, y] in &points {
                        let cell = (x * columns as f32) as usize * (64 / columns)
                            + (y * (64 / columns) as f32) as usize;
                        assert!(
                            !seen[cell],
                            "two of 64 points in one interval of {columns} columns, seed {seed}"
                        );
                        seen[cell] = true;
                    }
                }
            }
        }
    }

    #[test]
    fn each_number_is_uniform_over_the_replicates_and_pairs_are_uncorrelated() {
        let n = 40_000;
        let mut sums = [0.0f64; 4];
        for seed in 0..n {
            let draws = Draws { replicate: hash::mix2(1, seed), sample: 5 };
            let [x, y] = draws.pair(0, Purpose::Direction).map(f64::from);
            let [z, _] = draws.pair(1, Purpose::Direction).map(f64::from);
            let terms = [x - 0.5, y - 0.5, (x - 0.5) * (y - 0.5), (x - 0.5) * (z - 0.5)];
            (0..4).for_each(|k| sums[k] += terms[k] / n as f64);
        }
        // Standard errors: 0.289/√n = 1.4e-3 for the means, (1/12)/√n = 4.2e-4 for the products; four of them.
        assert!(sums[0].abs() < 5.8e-3 && sums[1].abs() < 5.8e-3, "{sums:?}");
        assert!(sums[2].abs() < 1.7e-3 && sums[3].abs() < 1.7e-3, "{sums:?}");
    }

    #[test]
    fn densities_invert_with_gaps_and_peaks() {
        let weights = [0.0, 1.0, 0.0, 1e-9, 3.0, 0.0, 4.0, 0.0];
        let density = Density::new(weights.iter().copied()).expect("positive weights");
        let n = 1u32 << 16;
        let mut counts = [0u32; 8];
        for i in 0..n {
            let pick = density.pick(i << 16);
            assert!((0.0..1.0).contains(&pick.rest));
            counts[pick.entry] += 1;
        }
        for (entry, weight) in weights.iter().enumerate() {
            // Equidistant numbers: each count is exact to one.
            let want = weight / 8.000_000_001 * f64::from(n);
            assert!((f64::from(counts[entry]) - want).abs() <= 1.0, "entry {entry}: {counts:?}");
            assert!((density.probability(entry) - weight / density.total()).abs() < 1e-15);
        }
        assert!(Density::new([0.0, 0.0].into_iter()).is_none());
        assert!(Density::new(std::iter::empty()).is_none());
    }
}
