//! Light's units and colours: linear Rec.709 triples, sRGB encoding, exposure; far light by spherical harmonics.

pub mod harmonics;

use glam::Vec3;

/// Linear Rec.709 red, green, blue. What it measures (radiance, irradiance, albedo) is said where it is used.
pub type Rgb = Vec3;

/// Mean of the three channels: the scalar that error targets speak of.
pub fn mean_channel(c: Rgb) -> f32 {
    (c.x + c.y + c.z) * (1.0 / 3.0)
}

/// Decodes an 8-bit sRGB value to linear (IEC 61966-2-1).
pub fn srgb_to_linear(byte: u8) -> f32 {
    let s = f32::from(byte) / 255.0;
    if s <= 0.040_45 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

/// Encodes a linear value to 8-bit sRGB, rounding; values outside [0, 1] clamp and NaN gives 0.
pub fn linear_to_srgb(linear: f32) -> u8 {
    let l = if linear.is_nan() { 0.0 } else { linear.clamp(0.0, 1.0) };
    let s = if l <= 0.003_130_8 { l * 12.92 } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
    (s * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trips_every_byte() {
        for byte in 0..=255u8 {
            assert_eq!(linear_to_srgb(srgb_to_linear(byte)), byte);
        }
        assert_eq!(linear_to_srgb(f32::NAN), 0);
        assert_eq!(linear_to_srgb(7.0), 255);
    }
}
