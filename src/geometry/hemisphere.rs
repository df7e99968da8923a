//! Directions: low-discrepancy lattices on the square and their maps to the sphere and hemisphere.

use glam::Vec3;

/// The fractional part of the golden ratio: the Fibonacci lattice's step.
pub const GOLDEN: f32 = 0.618_034;

/// Point `i` of an `n`-point Fibonacci lattice on the unit square, shifted by `shift` modulo 1.
pub fn fibonacci(i: u32, n: u32, shift: [f32; 2]) -> [f32; 2] {
    let u = ((i as f32 + shift[0]) / n as f32).fract();
    // f64 keeps the lattice exact for n up to millions.
    let v = (f64::from(i) * 0.618_033_988_749_894_9 + f64::from(shift[1])).fract() as f32;
    [u, v.min(0.999_999_9)]
}

/// Point `i` of the R2 sequence (Roberts 2018), shifted by `shift` modulo 1: progressive, for unknown counts.
pub fn r2(i: u32, shift: [f32; 2]) -> [f32; 2] {
    let x = (f64::from(i) * 0.754_877_666_246_692_8 + f64::from(shift[0])).fract() as f32;
    let y = (f64::from(i) * 0.569_840_290_998_053_3 + f64::from(shift[1])).fract() as f32;
    [x.min(0.999_999_9), y.min(0.999_999_9)]
}

/// Maps the unit square to the hemisphere about +z with density cosθ/π, in polar coordinates.
pub fn cosine_hemisphere([u, v]: [f32; 2]) -> Vec3 {
    let r = u.sqrt();
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    Vec3::new(r * cos, r * sin, (1.0 - u).max(0.0).sqrt())
}

/// Maps the unit square to the unit sphere with uniform density 1/(4π).
pub fn uniform_sphere([u, v]: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattice_integrates_the_cosine_moments() {
        let n = 1024;
        let mut mean = Vec3::ZERO;
        let mut square = 0.0;
        for i in 0..n {
            let w = cosine_hemisphere(fibonacci(i, n, [0.3, 0.7]));
            mean += w / n as f32;
            square += w.z * w.z / n as f32;
        }
        // E[cosθ] = 2/3 and E[cos²θ] = 1/2 under density cosθ/π; a lattice errs by O(log n / n) ≈ 7e-3 at the most.
        assert!((mean.z - 2.0 / 3.0).abs() < 2e-3 && mean.x.abs() < 7e-3 && mean.y.abs() < 7e-3, "{mean}");
        assert!((square - 0.5).abs() < 2e-3, "{square}");
    }
}
