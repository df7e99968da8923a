//! How colours stand in the page: with a shared exponent.
//!
//! This work is based on: the RGB9_E5 format of OpenGL ES 3.0, section 3.8.3.2: three mantissas of nine bits.

use crate::light::Rgb;

/// A colour of channels in [0, 65,408] with one exponent: within 1/512 of its largest channel. Negative is zero.
pub fn shared_exponent(colour: Rgb) -> u32 {
    let channels = colour.to_array().map(|c| if c > 0.0 { f64::from(c).min(65_408.0) } else { 0.0 });
    let most = channels.into_iter().fold(0.0, f64::max);
    // Mantissas are integers below 512, times 2^(exponent − 24); rounding up to 512 takes the next exponent.
    let step = |exponent: i32| (f64::from(exponent) - 24.0).exp2();
    let mut exponent = (most.max(1e-30).log2().floor() as i32 + 16).clamp(0, 31);
    if (most / step(exponent)).round() >= 512.0 {
        exponent = (exponent + 1).min(31);
    }
    let [red, green, blue] = channels.map(|c| ((c / step(exponent)).round() as u32).min(511));
    red | green << 9 | blue << 18 | (exponent as u32) << 27
}

/// A colour at each vertex, as the page's textures hold it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Layer {
    /// What the page multiplies it by.
    pub scale: f32,
    /// RGB9_E5, little-endian.
    pub words: Vec<u8>,
}

impl Layer {
    /// Colours that are within [0, 1] already.
    pub fn plain(colours: &[Rgb]) -> Self {
        Self::over(colours, 1.0)
    }

    /// Over their largest channel.
    pub fn scaled(colours: &[Rgb]) -> Self {
        let most = colours.iter().map(|c| c.max_element()).filter(|c| c.is_finite()).fold(0.0, f32::max);
        Self::over(colours, if most > 0.0 { most } else { 1.0 })
    }

    fn over(colours: &[Rgb], scale: f32) -> Self {
        let over = 1.0 / scale;
        let words = colours.iter().flat_map(|&c| shared_exponent(c * over).to_le_bytes());
        Self { scale, words: words.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash;

    #[test]
    fn colours_come_back_within_half_a_step() {
        let decoded = |word: u32| {
            let scale = (f64::from(word >> 27) - 24.0).exp2();
            [0, 9, 18].map(|shift| f64::from(word >> shift & 511) * scale)
        };
        for i in 0..10_000 {
            let [a, b] = hash::unit_pair(3, i);
            let [c, size] = hash::unit_pair(4, i);
            let colour = Rgb::new(a, b, c) * (30.0 * size - 14.0).exp2();
            for (given, back) in colour.to_array().into_iter().zip(decoded(shared_exponent(colour))) {
                // The largest mantissa is 256 at least: half a step is 1/512 of the largest channel at most, 1/512 of the
                // least normal colour (2^-16) below that.
                let bound = f64::from(colour.max_element()).max(2f64.powi(-16)) / 512.0;
                assert!((f64::from(given) - back).abs() <= bound, "{colour}: {given} came back as {back}");
            }
        }
        assert_eq!(shared_exponent(Rgb::new(-1.0, f32::NAN, 0.0)), 0);
        assert_eq!(decoded(shared_exponent(Rgb::splat(1.0e9))), [65_408.0; 3]);
        assert_eq!(decoded(shared_exponent(Rgb::new(0.999_9, 0.5, 0.0))), [1.0, 0.5, 0.0]);
    }
}
