//! How linear light becomes a picture: one factor, chosen from the picture, then sRGB.

use glam::Vec3;

use crate::light::{Rgb, linear_to_srgb};

/// The share of the weight that stays below [`HEADROOM`]: emitters usually fill less than the other two percent.
const PERCENTILE: f64 = 0.98;

/// Where that percentile's luminance goes, of a display's full linear range.
const HEADROOM: f64 = 0.9;

/// Luminance of linear Rec.709.
pub fn luminance(colour: Rgb) -> f32 {
    colour.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// The factor that takes the 98th percentile of the weighted luminances to 0.9; 1 when nothing is lit.
///
/// Each item is (luminance, weight); weights are areas or pixels. Items that are not finite do not count.
pub fn automatic(lit: impl Iterator<Item = (f32, f32)>) -> f32 {
    let mut lit: Vec<(f32, f32)> = lit.filter(|(l, w)| l.is_finite() && *l > 0.0 && *w > 0.0).collect();
    lit.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = lit.iter().map(|(_, weight)| f64::from(*weight)).sum();
    let mut below = 0.0;
    for (luminance, weight) in lit {
        below += f64::from(weight);
        if below >= PERCENTILE * total {
            return (HEADROOM / f64::from(luminance)).min(f64::from(f32::MAX)) as f32;
        }
    }
    1.0
}

/// The sRGB bytes of `colour` under an exposure.
pub fn srgb(colour: Rgb, exposure: f32) -> [u8; 3] {
    (colour * exposure).to_array().map(linear_to_srgb)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_percentile_lands_at_nine_tenths_and_darkness_changes_nothing() {
        // 100 equal weights of luminance 1..=100: the 98th is 98.
        let exposure = automatic((1..=100).map(|l| (l as f32, 1.0)));
        assert!((exposure - 0.9 / 98.0).abs() < 1e-7, "{exposure}");
        // A tiny emitter does not darken the picture.
        let lamp = automatic([(1.0, 0.99), (1000.0, 0.01)].into_iter());
        assert!((lamp - 0.9).abs() < 1e-6, "{lamp}");
        assert_eq!(automatic([(0.0, 1.0), (f32::NAN, 1.0)].into_iter()), 1.0);
    }

    #[test]
    fn white_is_white() {
        assert_eq!(srgb(Vec3::splat(2.0), 0.5), [255; 3]);
        assert!((luminance(Vec3::ONE) - 1.0).abs() < 1e-6);
    }
}
