//! Skies: latitude–longitude images and what light comes from a direction.

use std::path::Path;

use glam::{Mat3, Vec3};

use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::scene::{Sky, Texture, Warning};

/// The unit vector of "x", "y", "z", or of one with a minus.
pub fn axis(word: &str) -> Option<Vec3> {
    let (sign, letter) = word.strip_prefix('-').map_or((1.0, word), |letter| (-1.0, letter));
    let axis = match letter {
        "x" => Vec3::X,
        "y" => Vec3::Y,
        "z" => Vec3::Z,
        _ => return None,
    };
    Some(axis * sign)
}

/// The rotation from scene directions into the image's frame (y up).
pub fn to_image(up: Vec3, degrees: f32) -> Mat3 {
    let _ = (up, degrees);
    Mat3::IDENTITY
}

/// Reads an EXR or HDR image.
///
/// # Errors
/// [`Error::Input`].
pub fn read_image(path: &Path, warnings: &mut Vec<Warning>) -> Result<Texture> {
    let _ = warnings;
    Err(Error::input(path, "picture", "not read yet", "give a constant radiance"))
}

impl Sky {
    /// The radiance that arrives from a unit direction (pointing away from the scene), W·m⁻²·sr⁻¹.
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        let _ = direction;
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Image { .. } => Rgb::ZERO,
        }
    }
}
