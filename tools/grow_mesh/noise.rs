//! Seeded fractal noise in space: octaves of gradient noise whose slopes are alike.
//!
//! This work is based on: Perlin, "Improving Noise", SIGGRAPH 2002 (gradients on a lattice, the quintic fade). We differ
//! in the gradients: components even in [-1, 1) from a hash, no table; and each octave's lattice has a shift of its own,
//! so that the places where gradient noise is zero do not fall together. Sums and products alone, no library function:
//! the same bytes on every platform.

use glam::DVec3;
use glowtree::geometry::hash::mix2;

/// Root mean square of one octave: with w = 1 − fade, A = ∫w² = 181/462 and B = ∫(w t)² = 535/18018 it is √(8 A² B).
const RMS: f64 = 0.190_943_637_876_724_1;

/// Root mean square length of one octave's gradient over 1/spacing: with P = ∫(w t)′² = 30/77 and D = ∫w′² = 10/7 it is
/// √(8 (P A² + 2 D A B)).
const RMS_GRADIENT: f64 = 0.862_725_385_466_243_7;

/// What the noise looks like; lengths in units of the positions.
#[derive(Debug, Clone, Copy)]
pub struct Looks {
    /// Spacing of the first octave's lattice; each next one's is half of it.
    pub wavelength: f64,
    /// Number of octaves.
    pub octaves: u32,
    /// Root mean square height.
    pub height: f64,
}

impl Looks {
    /// Spacing of an octave's lattice.
    fn spacing(self, octave: u32) -> f64 {
        self.wavelength / f64::from(1u32 << octave)
    }

    /// Root of the sum of the squared spacings: heights go with the spacings, so that slopes are alike.
    fn spacings(self) -> f64 {
        (0..self.octaves).map(|o| self.spacing(o) * self.spacing(o)).sum::<f64>().sqrt()
    }

    /// Root mean square slope on a plane: two of the gradient's three components lie in it.
    pub fn slope(self) -> f64 {
        self.height / self.spacings() * f64::from(self.octaves).sqrt() * plane_slope()
    }

    /// The same octaves with the height that makes a given root mean square slope on a plane.
    pub fn with_slope(self, slope: f64) -> Self {
        Self { height: slope * self.spacings() / (f64::from(self.octaves).sqrt() * plane_slope()), ..self }
    }
}

/// Root mean square slope on a plane of one octave of height 1 and spacing 1.
fn plane_slope() -> f64 {
    RMS_GRADIENT / RMS * (2.0f64 / 3.0).sqrt()
}

/// A function of position.
#[derive(Debug)]
pub struct Noise {
    octaves: Vec<Octave>,
}

#[derive(Debug)]
struct Octave {
    seed: u64,
    cells_per_length: f64,
    shift: DVec3,
    height: f64,
}

impl Noise {
    /// The noise of a seed.
    pub fn new(looks: Looks, seed: u64) -> Self {
        let share = looks.height / (looks.spacings() * RMS);
        let octave = |o: u32| {
            let seed = mix2(seed, u64::from(o));
            let shift = DVec3::from_array(
                [0, 1, 2].map(|axis| (mix2(seed, axis) >> 11) as f64 / (1u64 << 53) as f64),
            );
            let spacing = looks.spacing(o);
            Octave { seed, cells_per_length: 1.0 / spacing, shift, height: share * spacing }
        };
        Self { octaves: (0..looks.octaves).map(octave).collect() }
    }

    /// The height at a position.
    pub fn at(&self, position: DVec3) -> f64 {
        self.octaves
            .iter()
            .map(|o| o.height * gradient_noise(position * o.cells_per_length + o.shift, o.seed))
            .sum()
    }
}

/// One octave of spacing 1: a gradient at each lattice point, blended by the quintic 6t⁵ − 15t⁴ + 10t³.
fn gradient_noise(at: DVec3, seed: u64) -> f64 {
    let axes = at.to_array();
    let cell = axes.map(floor);
    let [x, y, z] = [0, 1, 2].map(|axis| axes[axis] - cell[axis] as f64);
    let [u, v, w] = [x, y, z].map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
    let steps =
        |axis: usize, prime: u64| [cell[axis] as u64, (cell[axis] + 1) as u64].map(|c| c.wrapping_mul(prime));
    let xs = steps(0, 0x9e37_79b9_7f4a_7c15);
    let ys = steps(1, 0xc2b2_ae3d_27d4_eb4f);
    let zs = steps(2, 0x1656_67b1_9e37_79f9);
    let corner = |i: usize, j: usize, k: usize| {
        let hash = scramble(seed ^ xs[i].wrapping_add(ys[j]).wrapping_add(zs[k]));
        let component = |shift: u32| ((hash >> shift) & 0x1f_ffff) as f64 * (1.0 / 1_048_576.0) - 1.0;
        component(0) * (x - i as f64) + component(21) * (y - j as f64) + component(42) * (z - k as f64)
    };
    let mixed = |a: f64, b: f64, t: f64| a + t * (b - a);
    let row = |j: usize, k: usize| mixed(corner(0, j, k), corner(1, j, k), u);
    mixed(mixed(row(0, 0), row(1, 0), v), mixed(row(0, 1), row(1, 1), v), w)
}

/// The finaliser of MurmurHash3.
fn scramble(key: u64) -> u64 {
    let mut z = (key ^ (key >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
    z = (z ^ (z >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    z ^ (z >> 33)
}

/// The largest integer that is not above: a cast and a comparison, where `f64::floor` may be a call.
fn floor(x: f64) -> i64 {
    let cut = x as i64;
    cut - i64::from((cut as f64) > x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glowtree::geometry::hash::Stream;

    fn points(count: usize, extent: f64) -> impl Iterator<Item = DVec3> {
        let mut chance = Stream::new(5, 0);
        let mut unit = move || (chance.bits() >> 11) as f64 / (1u64 << 53) as f64;
        (0..count).map(move |_| DVec3::new(unit(), unit(), unit()) * extent)
    }

    #[test]
    fn one_octave_has_the_height_and_the_gradient_that_the_constants_say() {
        let (mut square, mut slope, count, step) = (0.0, 0.0, 400_000, 1.0e-4);
        for p in points(count, 400.0) {
            let value = gradient_noise(p, 11);
            square += value * value;
            let ahead = DVec3::AXES.map(|axis| (gradient_noise(p + axis * step, 11) - value) / step);
            slope += ahead.iter().map(|d| d * d).sum::<f64>();
        }
        let (rms, gradient) = ((square / count as f64).sqrt(), (slope / count as f64).sqrt());
        // 64 million cells, 400,000 points: the root mean square of a variable of kurtosis near 3 has the relative
        // standard error √(1/2n) = 0.11 %; five of them, and the differences' step of 1e-4.
        assert!((rms / RMS - 1.0).abs() < 0.0057, "rms {rms}");
        assert!((gradient / RMS_GRADIENT - 1.0).abs() < 0.0057, "gradient {gradient}");
    }

    #[test]
    fn heights_and_slopes_of_the_sum_are_those_asked() {
        let looks = Looks { wavelength: 3.2, octaves: 5, height: 1.0 }.with_slope(0.25);
        assert!((looks.slope() - 0.25).abs() < 1.0e-12);
        let noise = Noise::new(looks, 3);
        let (mut square, mut slope, count, step) = (0.0, 0.0, 100_000, 1.0e-5);
        for p in points(count, 1000.0) {
            let value = noise.at(p);
            square += value * value;
            slope += [DVec3::X, DVec3::Y]
                .map(|a| ((noise.at(p + a * step) - value) / step).powi(2))
                .iter()
                .sum::<f64>();
        }
        // As above with n = 100,000: five times 0.22 %.
        let (rms, slope) = ((square / count as f64).sqrt(), (slope / count as f64).sqrt());
        assert!((rms / looks.height - 1.0).abs() < 0.011, "rms {rms}, asked {}", looks.height);
        assert!((slope / 0.25 - 1.0).abs() < 0.011, "slope {slope}");
    }

    #[test]
    fn the_noise_is_continuous_across_cells_and_depends_on_its_seed() {
        for p in points(1000, 50.0) {
            let on_face = DVec3::new(floor(p.x) as f64, p.y, p.z);
            // Gradients of three components below 1 and a fade of slope below 15/8: the slope is below 10.
            let across = gradient_noise(on_face + DVec3::X * 1.0e-9, 2)
                - gradient_noise(on_face - DVec3::X * 1.0e-9, 2);
            assert!(across.abs() < 2.0e-8, "a step of {across} at {on_face}");
            assert!(gradient_noise(p, 2) != gradient_noise(p, 3), "at {p}");
        }
        assert_eq!([-1.5, -1.0, -0.5, 0.0, 0.5, 1.0].map(floor), [-2, -1, -1, 0, 0, 1]);
    }
}
