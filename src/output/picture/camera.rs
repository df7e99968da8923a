//! A pinhole camera: from a point of the image to a ray.

use glam::Vec3;

use crate::error::{Error, Result};
use crate::rays::Ray;
use crate::scene::Camera;

/// A camera ready to shoot: its axes scaled by the tangent of half the field of view.
#[derive(Debug, Clone, Copy)]
pub struct Pinhole {
    eye: Vec3,
    forward: Vec3,
    right: Vec3,
    down: Vec3,
    width: f32,
    height: f32,
}

impl Pinhole {
    /// Prepares a camera. Pixels are square; the field of view is vertical.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the camera when it has no extent or looks nowhere.
    pub fn new(camera: &Camera) -> Result<Self> {
        let refuse = |problem: &str| Err(Error::Usage(format!("camera {:?}: {problem}", camera.name)));
        let [width, height] = camera.size.map(|pixels| pixels as f32);
        let forward = (camera.target - camera.eye).normalize_or_zero();
        if camera.size.contains(&0) {
            return refuse("its size is zero");
        }
        if forward == Vec3::ZERO || !camera.eye.is_finite() {
            return refuse("eye and target are the same point");
        }
        if !(camera.fov_degrees > 0.0 && camera.fov_degrees < 180.0) {
            return refuse("its field of view is not between 0 and 180 degrees");
        }
        // Looking along up leaves the picture's turn open: any other axis will do.
        let right = match forward.cross(camera.up).normalize_or_zero() {
            Vec3::ZERO => forward.any_orthonormal_vector(),
            right => right,
        };
        let half = (0.5 * camera.fov_degrees.to_radians()).tan();
        Ok(Self {
            eye: camera.eye,
            forward,
            right: right * (half * width / height),
            down: forward.cross(right) * half,
            width,
            height,
        })
    }

    /// The ray through image position (x, y) in pixels, (0, 0) at the top left corner of the image.
    pub fn ray(&self, x: f32, y: f32) -> Ray {
        let across = 2.0 * x / self.width - 1.0;
        let along = 2.0 * y / self.height - 1.0;
        Ray::new(self.eye, (self.forward + self.right * across + self.down * along).normalize())
    }

    /// The distance along the viewing axis of the point at `distance` along `ray`.
    pub fn depth(&self, ray: &Ray, distance: f32) -> f32 {
        distance * ray.direction.dot(self.forward)
    }

    /// The length that one pixel covers at `depth`.
    pub fn footprint(&self, depth: f32) -> f32 {
        2.0 * depth * self.down.length() / self.height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            name: "front".into(),
            eye: Vec3::new(0.0, 0.0, 5.0),
            target: Vec3::ZERO,
            up: Vec3::Y,
            fov_degrees: 90.0,
            size: [200, 100],
        }
    }

    #[test]
    fn corners_of_the_image_look_where_they_should() {
        let pinhole = Pinhole::new(&camera()).unwrap();
        // 90 degrees vertical: at depth 1 the image spans ±1 in y and ±2 in x; x grows to the right, y downwards.
        let ray = pinhole.ray(0.0, 0.0);
        let at = ray.direction / -ray.direction.z;
        assert!((at - Vec3::new(-2.0, 1.0, -1.0)).length() < 1e-5, "{at}");
        assert!((pinhole.depth(&ray, 6.0f32.sqrt()) - 1.0).abs() < 1e-5);
        assert!((pinhole.footprint(5.0) - 0.1).abs() < 1e-5);
    }

    #[test]
    fn cameras_without_extent_are_refused() {
        for broken in [
            Camera { size: [0, 4], ..camera() },
            Camera { target: camera().eye, ..camera() },
            Camera { fov_degrees: f32::NAN, ..camera() },
        ] {
            assert_eq!(Pinhole::new(&broken).unwrap_err().exit_code(), 2);
        }
        let along_up = Camera { up: Vec3::Z, ..camera() };
        assert!(Pinhole::new(&along_up).unwrap().ray(3.0, 4.0).direction.is_finite());
    }
}
