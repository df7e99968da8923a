//! Unit vectors in 32 bits.
//!
//! This work is based on: Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014
//! (the octahedral map). Both coordinates are rounded to 65,535 values, an odd number, so that the axes are exact and the
//! word with all bits set stays free.

use glam::{Vec2, Vec3};

/// The word that no vector encodes to.
pub const NONE: u32 = u32::MAX;

/// Largest angle between a vector and its decoded code, radians.
///
/// Rounding moves the coordinates by half a step, d = 2⁻¹/32767 each; the third moves by at most their sum, so the point on
/// the octahedron moves by √6 d = 3.74e-5; it lies at least 1/√3 from the centre. Roundings of f32 add below 1e-6.
pub const ERROR: f32 = 6.6e-5;

/// Half the number of steps of a coordinate.
const HALF: f32 = 32_767.0;

/// The code of a unit vector; of a vector that is not finite, or zero, [`NONE`].
pub fn encode(unit: Vec3) -> u32 {
    let sum = unit.abs().element_sum();
    if !(sum > 0.0 && sum.is_finite()) {
        return NONE;
    }
    let flat = Vec2::new(unit.x, unit.y) / sum;
    let flat = if unit.z < 0.0 { folded(flat) } else { flat };
    let [x, y] = flat.to_array().map(|value| (value * HALF + HALF).round().clamp(0.0, 2.0 * HALF) as u32);
    x | y << 16
}

/// The unit vector of a code; zero for [`NONE`].
pub fn decode(code: u32) -> Vec3 {
    if code == NONE {
        return Vec3::ZERO;
    }
    let flat = Vec2::new((code & 0xffff) as f32, (code >> 16) as f32) / HALF - 1.0;
    let z = 1.0 - flat.x.abs() - flat.y.abs();
    let flat = if z < 0.0 { folded(flat) } else { flat };
    flat.extend(z).normalize_or_zero()
}

/// The lower half of the octahedron, folded over the upper one's edges, and back.
fn folded(flat: Vec2) -> Vec2 {
    let sign = |value: f32| if value < 0.0 { -1.0 } else { 1.0 };
    Vec2::new((1.0 - flat.y.abs()) * sign(flat.x), (1.0 - flat.x.abs()) * sign(flat.y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{hash, hemisphere};

    #[test]
    fn codes_keep_directions_within_the_error() {
        let mut worst = 0.0f32;
        for i in 0..200_000 {
            let unit = hemisphere::uniform_sphere(hash::unit_pair(11, i));
            let code = encode(unit);
            assert_ne!(code, NONE);
            // The chord: arc and chord of such angles differ by 1e-14.
            worst = worst.max((decode(code) - unit.normalize()).length());
        }
        assert!(worst < ERROR, "{worst}");
        // Sabotage: eight bits a coordinate would err by 256 times as much.
        assert!(worst > ERROR / 8.0, "{worst} is too good for 16 bits");
    }

    #[test]
    fn axes_are_exact_and_nothing_has_a_code_of_its_own() {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z] {
            assert_eq!(decode(encode(axis)), axis);
        }
        assert_eq!(decode(encode(Vec3::ZERO)), Vec3::ZERO);
        assert_eq!(encode(Vec3::NAN), NONE);
    }
}
