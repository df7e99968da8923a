//! Solving H = K·H + b for the irradiance at receivers: Neumann's series, or GMRES where albedos are high.
//!
//! This work is based on: Saad and Schultz, "GMRES", 1986. Three channels share each product with the operator and
//! have their own small least-squares problems. Basis vectors are f32, inner products f64.

use std::convert::Infallible;

use crate::light::Rgb;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IterateParams {
    /// Residual, relative to the right-hand side's mean, at which to stop.
    pub tolerance: f64,
    /// Products with the operator at the most.
    pub most: usize,
    /// Bounces of light to keep; None until converged. Selects Neumann's series.
    pub bounces: Option<usize>,
    /// Largest albedo: above [`ACCELERATE_FROM`] GMRES takes over.
    pub largest_albedo: f32,
}

/// What the iteration did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct IterateReport {
    /// Products with the operator.
    pub iterations: usize,
    /// Largest channel's ‖b + K·H − H‖₂ / ‖b‖₂ (of Neumann's series its bound, the last term).
    pub residual: f64,
    /// No value of H is farther from the solution than this, W·m⁻²: ‖b + K·H − H‖∞ / (1 − ρ), ρ the largest albedo, and what
    /// rounding adds. It is the norm of the largest value in which ‖K‖ ≤ ρ, not that of squares. Infinite at ρ ≥ 1 and where
    /// bounces are limited.
    pub error_bound: f64,
    /// Whether the tolerance was reached (or the bounces asked for were done).
    pub converged: bool,
    /// The relative residual after each product.
    pub history: Vec<f64>,
}

/// Neumann needs 15 products at 0.4, 20 at 0.5, 62 at 0.8 and 131 at 0.9 for 1e-6; GMRES saves a third of them here, and more
/// above, for the price of its vectors.
pub const ACCELERATE_FROM: f32 = 0.4;

/// Solves H = b + K·H.
pub fn solve(
    apply: impl Fn(&[Rgb]) -> Vec<Rgb>,
    b: &[Rgb],
    params: &IterateParams,
) -> (Vec<Rgb>, IterateReport) {
    let Ok(solved) = try_solve(|x| Ok::<_, Infallible>(apply(x)), b, params);
    solved
}

/// Solves H = b + K·H. The product may fail, as when a run is asked to stop between two of them.
///
/// # Errors
/// What `apply` says.
pub fn try_solve<E>(
    apply: impl Fn(&[Rgb]) -> Result<Vec<Rgb>, E>,
    b: &[Rgb],
    params: &IterateParams,
) -> Result<(Vec<Rgb>, IterateReport), E> {
    if b.is_empty() || norms(b).iter().all(|&n| n == 0.0) {
        return Ok((b.to_vec(), IterateReport { converged: true, ..IterateReport::default() }));
    }
    if params.bounces.is_some() || params.largest_albedo < ACCELERATE_FROM {
        neumann(apply, b, params)
    } else {
        gmres(apply, b, params)
    }
}

fn neumann<E>(
    apply: impl Fn(&[Rgb]) -> Result<Vec<Rgb>, E>,
    b: &[Rgb],
    params: &IterateParams,
) -> Result<(Vec<Rgb>, IterateReport), E> {
    let scale = norms(b);
    let mut sum = b.to_vec();
    let mut term = b.to_vec();
    let mut report = IterateReport { residual: 1.0, ..IterateReport::default() };
    let most = params.bounces.map_or(params.most, |n| n.saturating_sub(1));
    while report.iterations < most {
        term = apply(&term)?;
        sum.iter_mut().zip(&term).for_each(|(s, t)| *s += *t);
        report.iterations += 1;
        report.residual = relative(norms(&term), scale);
        report.history.push(report.residual);
        if report.residual <= params.tolerance {
            report.converged = true;
            break;
        }
    }
    // What is left out is K·term + K²·term + …
    let left = f64::from(params.largest_albedo) * largest(&term) + f64::from(ROUNDING) * largest(&sum);
    report.error_bound = if params.bounces.is_some() { f64::INFINITY } else { amplified(left, params) };
    report.converged |= params.bounces.is_some();
    Ok((sum, report))
}

/// Residuals below this share of the solution are rounding: x = b + K·x in f32, sums of a few hundred terms. Without it
/// a furnace at ρ = 0.99, where x is a hundred times b, asked for 3e-6 of b and went round 2,000 times.
pub(super) const ROUNDING: f32 = 8.0 * f32::EPSILON;

/// Directions kept before a restart; 60 cover ρ = 0.99 without one.
pub(super) const KRYLOV: usize = 60;

fn gmres<E>(
    apply: impl Fn(&[Rgb]) -> Result<Vec<Rgb>, E>,
    b: &[Rgb],
    params: &IterateParams,
) -> Result<(Vec<Rgb>, IterateReport), E> {
    let scale = norms(b);
    let mut x = b.to_vec();
    let mut report = IterateReport { residual: 1.0, ..IterateReport::default() };
    loop {
        let image = apply(&x)?;
        let residual: Vec<Rgb> = (0..b.len()).map(|i| b[i] + image[i] - x[i]).collect();
        report.iterations += 1;
        report.residual = relative(norms(&residual), scale);
        report.error_bound = amplified(largest(&residual) + f64::from(ROUNDING) * largest(&x), params);
        let floor = f64::from(ROUNDING) * relative(norms(&x), scale);
        report.converged = report.residual <= params.tolerance.max(floor);
        if report.converged || report.iterations >= params.most {
            break;
        }
        let mut cycle = Cycle::new(residual);
        // The last product measures what came out.
        while cycle.steps() < KRYLOV && report.iterations + 1 < params.most {
            cycle.step(&apply)?;
            report.iterations += 1;
            report.residual = relative(cycle.residuals(), scale);
            report.history.push(report.residual);
            if report.residual <= 0.5 * params.tolerance {
                break;
            }
        }
        cycle.correct(&mut x);
    }
    Ok((x, report))
}

/// One GMRES cycle for three channels at once: an Arnoldi basis each, QR by Givens rotations.
pub(super) struct Cycle {
    basis: Vec<Vec<Rgb>>,
    /// Per channel the columns of the rotated Hessenberg matrix.
    columns: [Vec<Vec<f64>>; 3],
    rotations: [Vec<(f64, f64)>; 3],
    right: [Vec<f64>; 3],
}

impl Cycle {
    pub(super) fn new(mut residual: Vec<Rgb>) -> Self {
        let norm = norms(&residual);
        divide(&mut residual, norm);
        Self {
            basis: vec![residual],
            columns: Default::default(),
            rotations: Default::default(),
            right: norm.map(|n| vec![n]),
        }
    }

    pub(super) fn steps(&self) -> usize {
        self.columns[0].len()
    }

    pub(super) fn residuals(&self) -> [f64; 3] {
        std::array::from_fn(|c| self.right[c][self.steps()].abs())
    }

    fn step<E>(&mut self, apply: &impl Fn(&[Rgb]) -> Result<Vec<Rgb>, E>) -> Result<(), E> {
        let image = apply(self.last())?;
        self.take(&image);
        Ok(())
    }

    /// The direction whose image is wanted next.
    pub(super) fn last(&self) -> &[Rgb] {
        &self.basis[self.steps()]
    }

    /// Takes in the image of [`Cycle::last`].
    pub(super) fn take(&mut self, image: &[Rgb]) {
        let k = self.steps();
        let mut w: Vec<Rgb> = self.basis[k].iter().zip(image).map(|(v, kv)| *v - *kv).collect();
        let mut h: [Vec<f64>; 3] = Default::default();
        for v in &self.basis {
            let d = dots(&w, v);
            let along = Rgb::new(d[0] as f32, d[1] as f32, d[2] as f32);
            w.iter_mut().zip(v).for_each(|(w, v)| *w -= *v * along);
            (0..3).for_each(|c| h[c].push(d[c]));
        }
        let norm = norms(&w);
        divide(&mut w, norm);
        self.basis.push(w);
        for (c, mut column) in h.into_iter().enumerate() {
            for (i, (cos, sin)) in self.rotations[c].iter().enumerate() {
                let (a, b) = (column[i], column[i + 1..].first().copied().unwrap_or(0.0));
                column[i] = cos * a + sin * b;
                column[i + 1] = cos * b - sin * a;
            }
            let length = column[k].hypot(norm[c]);
            let (cos, sin) = if length > 0.0 { (column[k] / length, norm[c] / length) } else { (1.0, 0.0) };
            column[k] = length;
            let g = self.right[c][k];
            self.right[c][k] = cos * g;
            self.right[c].push(-sin * g);
            self.rotations[c].push((cos, sin));
            self.columns[c].push(column);
        }
    }

    /// Adds the least-squares combination of the basis to `x`.
    pub(super) fn correct(&self, x: &mut [Rgb]) {
        self.add(&self.weights(self.steps()), x);
    }

    /// Adds what is left, b + K·x − x of the corrected x: it is one bounce ahead then, for no product.
    pub(super) fn add_residual(&self, x: &mut [Rgb]) {
        let k = self.steps();
        let left = |c: usize| {
            let mut left = vec![0.0; k + 1];
            left[k] = self.right[c][k];
            for (i, (cos, sin)) in self.rotations[c].iter().enumerate().rev() {
                (left[i], left[i + 1]) =
                    (cos * left[i] - sin * left[i + 1], sin * left[i] + cos * left[i + 1]);
            }
            left
        };
        self.add(&std::array::from_fn(left), x);
    }

    /// The norm of what the last step changed of the combination: nearly the error before it, where steps help much.
    pub(super) fn change(&self) -> [f64; 3] {
        let k = self.steps();
        let (now, before) = (self.weights(k), self.weights(k.saturating_sub(1)));
        let square = |c: usize| {
            let earlier = before[c].iter().copied().chain([0.0]);
            now[c].iter().zip(earlier).map(|(a, b)| (a - b).powi(2)).sum::<f64>()
        };
        std::array::from_fn(|c| square(c).sqrt())
    }

    /// Per channel the weights of the first `k` directions that leave the least.
    fn weights(&self, k: usize) -> [Vec<f64>; 3] {
        let weights = |c: usize| {
            let mut y = vec![0.0; k];
            for i in (0..k).rev() {
                let known: f64 = (i + 1..k).map(|j| self.columns[c][j][i] * y[j]).sum();
                let pivot = self.columns[c][i][i];
                y[i] = if pivot.abs() > 0.0 { (self.right[c][i] - known) / pivot } else { 0.0 };
            }
            y
        };
        std::array::from_fn(weights)
    }

    fn add(&self, weights: &[Vec<f64>; 3], x: &mut [Rgb]) {
        for (j, v) in self.basis.iter().take(weights[0].len()).enumerate() {
            let along = Rgb::new(weights[0][j] as f32, weights[1][j] as f32, weights[2][j] as f32);
            x.iter_mut().zip(v).for_each(|(x, v)| *x += *v * along);
        }
    }
}

/// Inner product per channel, accumulated in f64 in index order.
fn dots(a: &[Rgb], b: &[Rgb]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (a, b) in a.iter().zip(b) {
        sum[0] += f64::from(a.x) * f64::from(b.x);
        sum[1] += f64::from(a.y) * f64::from(b.y);
        sum[2] += f64::from(a.z) * f64::from(b.z);
    }
    sum
}

/// The largest value of any channel.
pub(super) fn largest(a: &[Rgb]) -> f64 {
    a.iter().fold(0.0, |m, v| f64::from(v.abs().max_element()).max(m))
}

/// A residual as an error: the series 1 + ρ + ρ² + …
pub(super) fn amplified(residual: f64, params: &IterateParams) -> f64 {
    let gap = 1.0 - f64::from(params.largest_albedo);
    if gap > 0.0 { residual / gap } else { f64::INFINITY }
}

pub(super) fn norms(a: &[Rgb]) -> [f64; 3] {
    dots(a, a).map(f64::sqrt)
}

fn divide(v: &mut [Rgb], norm: [f64; 3]) {
    let inverse = norm.map(|n| if n > 0.0 { (1.0 / n) as f32 } else { 0.0 });
    let inverse = Rgb::from_array(inverse);
    v.iter_mut().for_each(|v| *v *= inverse);
}

/// The largest channel's ratio; a channel without light counts as solved.
pub(super) fn relative(norm: [f64; 3], scale: [f64; 3]) -> f64 {
    (0..3).map(|c| if scale[c] > 0.0 { norm[c] / scale[c] } else { 0.0 }).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash;

    /// A seeded row-stochastic matrix times ρ, dense.
    fn operator(n: usize, albedo: f32) -> impl Fn(&[Rgb]) -> Vec<Rgb> {
        let rows: Vec<Vec<f32>> = (0..n)
            .map(|i| {
                let mut row: Vec<f32> = (0..n)
                    .map(|j| {
                        // A ring with local coupling: a slowly mixing operator, hard for Neumann.
                        let d = (i as i64 - j as i64)
                            .rem_euclid(n as i64)
                            .min((j as i64 - i as i64).rem_euclid(n as i64));
                        if d <= 3 { 0.2 + hash::unit(5, (i * n + j) as u64) } else { 0.0 }
                    })
                    .collect();
                let sum: f32 = row.iter().sum();
                row.iter_mut().for_each(|x| *x *= albedo / sum);
                row
            })
            .collect();
        move |x| rows.iter().map(|r| r.iter().zip(x).map(|(w, x)| *x * *w).sum()).collect()
    }

    #[test]
    fn both_solvers_find_the_same_answer() {
        let apply = operator(200, 0.9);
        let b: Vec<Rgb> =
            (0..200).map(|i| Rgb::new(hash::unit(1, i), hash::unit(2, i), f32::from(i == 7))).collect();
        let params = IterateParams { tolerance: 1e-6, most: 1000, bounces: None, largest_albedo: 0.9 };
        let apply = |x: &[Rgb]| Ok::<_, Infallible>(apply(x));
        let Ok((slow, a)) = neumann(apply, &b, &params);
        let Ok((fast, c)) = gmres(apply, &b, &params);
        assert!(
            a.converged && c.converged && c.iterations < a.iterations,
            "{} against {}",
            c.iterations,
            a.iterations
        );
        for (s, f) in slow.iter().zip(&fast) {
            // Residual 1e-6 of ‖b‖ over (1 − ρ) = 0.1, ‖b‖ ≈ 8: 1e-4.
            assert!((*s - *f).abs().max_element() < 1e-4, "{s} and {f}");
        }
    }

    #[test]
    fn a_bounce_limit_is_a_truncated_series() {
        let apply = operator(20, 0.5);
        let b = vec![Rgb::ONE; 20];
        let params = IterateParams { tolerance: 0.0, most: 100, bounces: Some(3), largest_albedo: 0.5 };
        let (x, report) = solve(&apply, &b, &params);
        // 1 + 0.5 + 0.25, rows sum to 0.5 within f32.
        assert!(report.converged && (x[4].x - 1.75).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn darkness_is_solved_at_once() {
        let (x, report) = solve(
            operator(5, 0.9),
            &[Rgb::ZERO; 5],
            &IterateParams { tolerance: 1e-6, most: 10, bounces: None, largest_albedo: 0.9 },
        );
        assert!(report.converged && x.iter().all(|v| *v == Rgb::ZERO));
    }
}
