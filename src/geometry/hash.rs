//! Counter-based random numbers: a value depends on its key alone, never on the thread that asks.
//!
//! This work is based on: Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014
//! (the SplitMix64 finaliser).

/// Mixes a 64-bit key into 64 well-distributed bits.
pub fn mix(key: u64) -> u64 {
    let mut z = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Mixes a seed with a counter.
pub fn mix2(seed: u64, counter: u64) -> u64 {
    mix(mix(seed) ^ counter.wrapping_mul(0xd6e8_feb8_6659_fd93))
}

/// A number in [0, 1) with 24 random bits.
pub fn unit(seed: u64, counter: u64) -> f32 {
    (mix2(seed, counter) >> 40) as f32 * (1.0 / 16_777_216.0)
}

/// Two independent numbers in [0, 1).
pub fn unit_pair(seed: u64, counter: u64) -> [f32; 2] {
    let bits = mix2(seed, counter);
    let scale = 1.0 / 16_777_216.0;
    [(bits >> 40) as f32 * scale, ((bits >> 16) & 0xff_ffff) as f32 * scale]
}

/// A stream of numbers for serial use, as in path tracing: key once, then draw.
#[derive(Debug, Clone)]
pub struct Stream {
    state: u64,
}

impl Stream {
    /// The stream that belongs to (seed, counter).
    pub fn new(seed: u64, counter: u64) -> Self {
        Self { state: mix2(seed, counter) }
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        let out = mix(self.state);
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        out
    }

    /// The next number in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 * (1.0 / 16_777_216.0)
    }

    /// The next two numbers in [0, 1).
    pub fn unit_pair(&mut self) -> [f32; 2] {
        let bits = self.bits();
        let scale = 1.0 / 16_777_216.0;
        [(bits >> 40) as f32 * scale, ((bits >> 16) & 0xff_ffff) as f32 * scale]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_fill_the_interval_evenly() {
        let n = 100_000u64;
        let mean = (0..n).map(|i| f64::from(unit(3, i))).sum::<f64>() / n as f64;
        // Standard error of the mean of n uniforms is 0.289/√n = 9.1e-4; five of them.
        assert!((mean - 0.5).abs() < 4.6e-3, "mean {mean}");
        let [a, b] = (0..n).fold([0.0f64; 2], |s, i| {
            let [x, y] = unit_pair(3, i);
            assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
            [s[0] + f64::from(x * y), s[1] + f64::from(y)]
        });
        assert!((a / n as f64 - 0.25).abs() < 4.6e-3 && (b / n as f64 - 0.5).abs() < 4.6e-3);
    }
}
