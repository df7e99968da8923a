//! Where distance is measured, and the functions of it.
//!
//! This work is based on: Wendland, "Piecewise polynomial, positive definite and compactly supported radial functions of
//! minimal degree", 1995. φ_{d,1}(r) = (1−r)₊^(l+1) ((l+1)r + 1), l = ⌊d/2⌋ + 2, is C² and positive definite on ℝᵈ and below,
//! and on no space of higher dimension in general. Positions alone lie in ℝ³: (1−r)₊⁴(4r+1). Positions with normals lie in ℝ⁶:
//! (1−r)₊⁶(6r+1).

use glam::Vec3;

use crate::geometry::SurfacePoint;

/// Wendland's C² function for up to three dimensions; one at 0, zero from 1 on.
pub fn wendland3(r: f64) -> f64 {
    let s = (1.0 - r).max(0.0).powi(2);
    s * s * (4.0 * r + 1.0)
}

/// Wendland's C² function for up to seven dimensions; one at 0, zero from 1 on.
pub fn wendland7(r: f64) -> f64 {
    let s = (1.0 - r).max(0.0).powi(2);
    s * s * s * (6.0 * r + 1.0)
}

/// Franke and Little's weight ((R − d)₊ / (R d))²: singular at the support, so that it is met, and smooth where it ends.
pub fn franke_little(distance: f64, reach: f64) -> f64 {
    let d = distance.max(COINCIDENT);
    ((reach - d).max(0.0) / (reach * d)).powi(2)
}

/// Closer than this, in radii, a point counts as the support itself.
const COINCIDENT: f64 = 1e-6;

/// A Euclidean space of positions and normals: (x, t n) with t a length.
///
/// The program's interpolation distance [`crate::tree::Support::distance`] is none of any Euclidean space (it is not even
/// symmetric where radii differ), so that a radial function of it need not be positive definite. This one is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Space {
    /// What a unit of difference between normals counts for, as a length in local units; zero for positions alone.
    pub turn: f32,
}

impl Space {
    /// Normals whose cosine is at most 0.2 lie at least `reach` apart, as [`crate::tree::Support::distance`] parts them.
    pub fn parting(reach: f32) -> Self {
        Self { turn: reach / PARTED }
    }

    /// Euclidean distance √(|x − x′|² + t² |n − n′|²), local units.
    #[inline]
    pub fn distance(&self, a: &SurfacePoint, b: &SurfacePoint) -> f64 {
        let d: Vec3 = a.position - b.position;
        let n: Vec3 = a.normal - b.normal;
        f64::from(d.length_squared() + self.turn * self.turn * n.length_squared()).sqrt()
    }
}

/// |n − n′| of normals whose cosine is 0.2: √1.6.
const PARTED: f32 = 1.264_911;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::basis::system::System;
    use crate::geometry::{hash, hemisphere};

    #[test]
    fn functions_are_one_at_zero_fall_and_end() {
        for kernel in [wendland3, wendland7] {
            assert_eq!((kernel(0.0), kernel(1.0), kernel(3.0)), (1.0, 0.0, 0.0));
            let steps: Vec<f64> = (0..=100).map(|i| kernel(0.01 * f64::from(i))).collect();
            assert!(steps.is_sorted_by(|a, b| a > b), "{steps:?}");
            // φ = 1 − c r² + O(r³): its slope at 0 vanishes.
            assert!((1.0 - kernel(1e-4)).abs() < 1e-6);
        }
        // ((3 − 1.5) / 4.5)² = 1/9.
        assert!((franke_little(1.5, 3.0) - 1.0 / 9.0).abs() < 1e-15 && franke_little(3.0, 3.0) == 0.0);
    }

    #[test]
    fn positions_with_normals_stay_positive_definite() {
        // 300 random points with random normals: a Cholesky factor exists only for positive definite matrices.
        let points: Vec<SurfacePoint> = (0..300)
            .map(|i| {
                let [x, y] = hash::unit_pair(1, i);
                let normal = hemisphere::uniform_sphere(hash::unit_pair(3, i));
                SurfacePoint { position: Vec3::new(x, y, hash::unit(2, i)), normal }
            })
            .collect();
        let space = Space { turn: 0.4 };
        let rows = points.iter().map(|a| {
            let entry = |(j, b)| (j, wendland7(space.distance(a, b) / 0.9));
            points.iter().enumerate().map(entry).collect()
        });
        let system = System::factor(rows.collect()).expect("a positive definite matrix");
        assert!(system.condition() > 1.0);
    }
}
