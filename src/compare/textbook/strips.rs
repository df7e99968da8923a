//! Two long walls that meet at a right angle, both glowing alike, in uniform strips of constant radiosity.
//!
//! Strips have their exact form factors between centre and strip, F = ½ |sinθ₁ − sinθ₂|; what is textbook about them is that
//! they are equally wide and that light is constant on each, although B ~ r^β at the edge.

/// Radiosity at the middles of `count` strips of each of two walls of width 1, exitance 1.
pub fn radiosity(count: usize, albedo: f64) -> Vec<f64> {
    let edge = |j: usize| j as f64 / count as f64;
    let middle = |i: usize| (i as f64 + 0.5) / count as f64;
    let factor = |i: usize, j: usize| {
        let sine = |s: f64| middle(i) / middle(i).hypot(s);
        0.5 * (sine(edge(j)) - sine(edge(j + 1)))
    };
    let mut light = vec![1.0; count];
    // Rows sum to ½ at the most: 40 terms leave (ρ/2)⁴⁰ < 1e-12.
    for _ in 0..40 {
        let sum = |i: usize| (0..count).map(|j| factor(i, j) * light[j]).sum::<f64>();
        light = (0..count).map(|i| 1.0 + albedo * sum(i)).collect();
    }
    light
}

/// Linear interpolation between the strips' middles, constant beyond the outermost.
pub fn interpolated(light: &[f64], r: f64) -> f64 {
    let at = (r * light.len() as f64 - 0.5).clamp(0.0, light.len() as f64 - 1.0);
    let (low, share) = (at.floor() as usize, at.fract());
    let high = (low + 1).min(light.len() - 1);
    light[low] * (1.0 - share) + light[high] * share
}
