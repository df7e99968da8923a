//! Point-to-point form factors between the centres of triangles, as a dense matrix, and the Neumann series over it.
//!
//! This work is based on: the seed paper's formula (3), G(x, y) = cosθ cosθ′ / (π r²) times the source's area. It knows neither
//! the extent of what is near nor visibility: for convex scenes only.

use std::f64::consts::PI;

use glam::DVec3;

use crate::compare::known::Part;
use crate::light::mean_channel;

/// A point that stands for a bit of surface.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Where, world units.
    pub position: DVec3,
    /// Unit normal of the front.
    pub normal: DVec3,
    /// The area it stands for.
    pub area: f64,
    /// Exitance, mean channel.
    pub exitance: f64,
    /// Albedo, mean channel.
    pub albedo: f64,
}

/// The form factor from `receiver` to `source` by the kernel between their centres; NaN where they coincide.
pub fn factor(receiver: &Point, source: &Point) -> f64 {
    let way = source.position - receiver.position;
    let square = way.length_squared();
    let here = way.dot(receiver.normal);
    let there = -way.dot(source.normal);
    // Both cosines carry a length of the way; coincident points divide nothing by nothing.
    here.max(0.0) * there.max(0.0) / (PI * square * square) * source.area
}

/// One point a triangle, at its centre.
pub fn of_parts(parts: &[Part]) -> Vec<Point> {
    let of_part = |part: &Part| {
        let (shape, albedo) = (part.shape.clone(), f64::from(mean_channel(part.albedo)));
        let exitance = f64::from(mean_channel(part.radiance)) * PI;
        let point = move |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| shape.vertices[v as usize]);
            let area = (b - a).cross(c - a);
            let (position, normal) = ((a + b + c) / 3.0, area.normalize_or_zero());
            Point { position, normal, area: 0.5 * area.length(), exitance, albedo }
        };
        part.shape.triangles.iter().map(point).collect::<Vec<_>>()
    };
    parts.iter().flat_map(of_part).collect()
}

/// Form factors from each point to each, row by row.
pub fn matrix(points: &[Point]) -> Vec<Vec<f64>> {
    let row = |(i, receiver): (usize, &Point)| {
        let entry = |(j, source): (usize, &Point)| if i == j { 0.0 } else { factor(receiver, source) };
        points.iter().enumerate().map(entry).collect()
    };
    points.iter().enumerate().map(row).collect()
}

/// Terms of the series at the most.
const TERMS: usize = 20_000;

/// Irradiance at each point by the Neumann series; None when it diverges.
pub fn irradiance(points: &[Point]) -> Option<Vec<f64>> {
    let matrix = matrix(points);
    let mut term: Vec<f64> = points.iter().map(|p| p.exitance).collect();
    let mut sum = vec![0.0; points.len()];
    let first = largest(&term);
    for _ in 0..TERMS {
        let light: Vec<f64> =
            matrix.iter().map(|row| row.iter().zip(&term).map(|(f, b)| f * b).sum()).collect();
        sum.iter_mut().zip(&light).for_each(|(s, h)| *s += h);
        term = light.iter().zip(points).map(|(h, p)| h * p.albedo).collect();
        let left = largest(&term);
        if left < 1e-9 * first {
            return Some(sum);
        }
        // Of a convergent series no term exceeds the sum of all, first / (1 − ρ); NaN is no convergence either.
        if left.is_nan() || left > 1e6 * first {
            return None;
        }
    }
    None
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, v| if v.is_nan() { f64::NAN } else { most.max(v.abs()) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::known::{parallel_rectangles, part};

    #[test]
    fn facing_unit_squares_get_one_over_pi() {
        let [floor, top] = parallel_rectangles(1.0, 1.0, 1.0, 1);
        let points = |shape| {
            let all = of_parts(&[part("square", shape, 0.0)]);
            Point { position: (all[0].position + all[1].position) * 0.5, area: 1.0, ..all[0] }
        };
        let factor = factor(&points(floor), &points(top));
        assert!((factor - 1.0 / PI).abs() < 1e-12, "{factor}");
    }
}
