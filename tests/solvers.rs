//! The solvers: how many products they need, that none diverges, and that what they say of their error holds.

mod shapes;

use glam::DVec3;
use glowtree::bake::Silent;
use glowtree::bake::laws::Plan;
use glowtree::bake::model::Model;
use glowtree::bake::pipeline::build;
use glowtree::geometry::hash;
use glowtree::light::Rgb;
use glowtree::solve::iterate::{IterateParams, IterateReport, solve};
use glowtree::solve::transport::Transport;

/// Products for 1e-6 by conjugate gradients' bound, by albedo (docs/theory.md, "Solving").
const BOUNDS: [(f32, usize); 6] = [(0.5, 13), (0.8, 22), (0.9, 32), (0.95, 45), (0.99, 102), (0.999, 324)];

fn params(albedo: f32, tolerance: f64) -> IterateParams {
    IterateParams { tolerance, most: 3000, bounces: None, largest_albedo: albedo }
}

/// A room with two blocks, closed, or without its ceiling.
fn room(closed: bool) -> Model {
    let mut parts: Vec<_> = shapes::box_faces(DVec3::ZERO, DVec3::ONE, 1)
        .into_iter()
        .enumerate()
        .filter(|(k, _)| closed || *k != 5)
        .map(|(k, face)| shapes::part("shell", face.flipped(), 0.7).exitance(if k == 0 { 1.0 } else { 0.0 }))
        .collect();
    let block = |from, to| shapes::part("block", shapes::cuboid(from, to, 1), 0.7);
    parts.push(block(DVec3::new(0.2, 0.5, 0.0), DVec3::new(0.4, 0.8, 0.6)));
    parts.push(block(DVec3::new(0.5, 0.1, 0.0), DVec3::new(0.9, 0.4, 0.3)));
    build(shapes::scene(&parts), &Plan::new(0.03, 1), None, &Silent).expect("nothing interrupts").0
}

fn transport<'a>(model: &'a Model, albedo: &'a [Rgb]) -> Transport<'a> {
    Transport { receivers: &model.receivers, spread: &model.spread, albedo }
}

/// Solves a model's operator with one albedo everywhere for light that differs from site to site and channel to channel:
/// a lit wall, sparks here and there, and a slow wave.
fn light(model: &Model, albedo: f32, tolerance: f64) -> (Vec<Rgb>, Vec<Rgb>, IterateReport) {
    let sites = model.sites.len();
    let spark = |s: usize| if hash::mix2(4, s as u64).is_multiple_of(50) { 3.0 } else { 0.0 };
    let wave = |s: usize| 1.0 + (5.0 * model.sites.positions[s].x).sin();
    let own: Vec<Rgb> = (0..sites).map(|s| Rgb::new(model.exitance[s].x, spark(s), wave(s))).collect();
    let albedo_of_sites = vec![Rgb::splat(albedo); sites];
    let transport = transport(model, &albedo_of_sites);
    let b = transport.gather(&own);
    let (x, report) = solve(|x| transport.apply(x), &b, &params(albedo, tolerance));
    (b, x, report)
}

#[test]
fn products_stay_within_the_bound() {
    let model = room(true);
    for (albedo, bound) in BOUNDS {
        let (b, x, report) = light(&model, albedo, 1e-6);
        println!(
            "albedo {albedo}: {} products, bound {bound}, residual {:.1e}, error below {:.1e}",
            report.iterations, report.residual, report.error_bound
        );
        assert!(report.converged, "albedo {albedo}: {report:?}");
        assert!(2 * report.iterations <= 3 * bound, "albedo {albedo}: {} products", report.iterations);
        // Seen from outside: f32 holds no residual below 8 ε = 9.5e-7 of the solution, which above 0.9 is larger than 1e-6 of b.
        let image = transport(&model, &vec![Rgb::splat(albedo); model.sites.len()]).apply(&x);
        for c in 0..3 {
            let norm = |v: &mut dyn Iterator<Item = f32>| v.map(|v| f64::from(v).powi(2)).sum::<f64>().sqrt();
            let residual = norm(&mut (0..b.len()).map(|i| b[i][c] + image[i][c] - x[i][c]));
            let scale = norm(&mut b.iter().map(|b| b[c])).max(norm(&mut x.iter().map(|x| x[c])));
            assert!(residual <= 1e-6 * scale, "albedo {albedo}, channel {c}: {residual} of {scale}");
        }
        // A closed room keeps its light, on average 1/(1 − albedo) of what comes in; receivers are not spread by area.
        let sum = |v: &[Rgb]| v.iter().map(|v| v.z).sum::<f32>();
        let kept = sum(&x) / sum(&b) * (1.0 - albedo);
        assert!((0.5..1.5).contains(&kept), "albedo {albedo}: {kept}");
    }
}

#[test]
fn an_open_room_converges_at_any_albedo() {
    let model = room(false);
    for albedo in [0.3, 0.7, 0.999] {
        let (b, x, report) = light(&model, albedo, 1e-6);
        println!("open, albedo {albedo}: {} products", report.iterations);
        assert!(report.converged && report.iterations < 60, "albedo {albedo}: {report:?}");
        // Light that leaves does not pile up: every bounce loses what the missing ceiling sees.
        let most = |v: &[Rgb]| v.iter().map(|h| h.max_element()).fold(0.0, f32::max);
        assert!(most(&x) < 100.0 * most(&b), "albedo {albedo}");
    }
}

/// A seeded operator of `n` rows with sums of at most `albedo`, as dense f64 and f32 alike.
struct Dense {
    rows: Vec<Vec<f32>>,
}

impl Dense {
    /// Kinds: 0 a random few links a row, 1 a ring of neighbours, 2 a cycle that no polynomial of low degree tames, 3 rows of
    /// very different sums.
    fn new(kind: u64, n: usize, albedo: f32) -> Self {
        let row = |i: usize| {
            let random = |k: u64| hash::mix2(kind * 1000 + i as u64, k);
            let mut row = vec![0.0f32; n];
            match kind {
                0 => (0..8).for_each(|k| row[random(k) as usize % n] += 1.0 + (random(k + 99) % 9) as f32),
                1 => (0..7).for_each(|k| row[(i + n + k - 3) % n] += 1.0 + (random(k as u64) % 3) as f32),
                2 => row[(i + 1) % n] = 1.0,
                _ => (0..5).for_each(|k| row[random(k) as usize % n] += 1.0),
            }
            let sum: f32 = row.iter().sum();
            let share = if kind == 3 { (random(7) % 1000) as f32 / 1000.0 } else { 1.0 };
            // Rounding down keeps sums at most the albedo.
            row.iter_mut().for_each(|w| *w *= albedo * share / sum * (1.0 - 1e-6));
            row
        };
        Self { rows: (0..n).map(row).collect() }
    }

    fn apply(&self, x: &[Rgb]) -> Vec<Rgb> {
        let row = |row: &Vec<f32>| {
            let term = |(&w, x): (&f32, &Rgb)| x.as_dvec3() * f64::from(w);
            row.iter().zip(x).filter(|(w, _)| **w != 0.0).map(term).sum::<DVec3>().as_vec3()
        };
        self.rows.iter().map(row).collect()
    }

    /// (1 − K)⁻¹ b by elimination with pivots, in f64.
    fn exact(&self, b: &[Rgb]) -> Vec<DVec3> {
        let n = b.len();
        let mut a: Vec<Vec<f64>> =
            self.rows.iter().map(|r| r.iter().map(|&w| -f64::from(w)).collect()).collect();
        (0..n).for_each(|i| a[i][i] += 1.0);
        let mut x: Vec<DVec3> = b.iter().map(|b| b.as_dvec3()).collect();
        for i in 0..n {
            let pivot = (i..n).max_by(|&p, &q| a[p][i].abs().total_cmp(&a[q][i].abs())).expect("rows");
            a.swap(i, pivot);
            x.swap(i, pivot);
            let (above, below) = a.split_at_mut(i + 1);
            for (j, row) in below.iter_mut().enumerate() {
                let factor = row[i] / above[i][i];
                if factor != 0.0 {
                    (i..n).for_each(|k| row[k] -= factor * above[i][k]);
                    let own = x[i];
                    x[i + 1 + j] -= factor * own;
                }
            }
        }
        for i in (0..n).rev() {
            let known: DVec3 = (i + 1..n).map(|k| x[k] * a[i][k]).sum();
            x[i] = (x[i] - known) / a[i][i];
        }
        x
    }
}

fn source(n: usize) -> Vec<Rgb> {
    (0..n as u64)
        .map(|i| Rgb::new(hash::unit(1, i), f32::from(i == 7), 1.0 + 0.1 * hash::unit(3, i)))
        .collect()
}

/// The largest difference of any value from the exact one.
fn error(x: &[Rgb], exact: &[DVec3]) -> f64 {
    x.iter().zip(exact).map(|(x, e)| (x.as_dvec3() - *e).abs().max_element()).fold(0.0, f64::max)
}

#[test]
fn no_choice_diverges_and_the_error_is_bounded() {
    const N: usize = 150;
    for kind in 0..4 {
        for albedo in [0.3, 0.39, 0.41, 0.6, 0.9, 0.99, 0.999] {
            let operator = Dense::new(kind, N, albedo);
            let (b, exact) = (source(N), operator.exact(&source(N)));
            for tolerance in [1e-2, 1e-4, 1e-6] {
                for most in [5, 3000] {
                    let params = IterateParams { most, ..params(albedo, tolerance) };
                    let (x, report) = solve(|x| operator.apply(x), &b, &params);
                    let name = format!("kind {kind}, albedo {albedo}, tolerance {tolerance}, most {most}");
                    // x = b is the first guess of both, with a residual of ‖K b‖₂ ≤ √(most links a column) ‖b‖₂; neither may
                    // leave a larger one than a single bounce has.
                    assert!(report.residual < 3.0 && x.iter().all(|v| v.is_finite()), "{name}: {report:?}");
                    assert!(report.iterations <= most.max(6), "{name}: {} products", report.iterations);
                    let (error, bound) = (error(&x, &exact), report.error_bound);
                    assert!(error <= bound, "{name}: error {error}, said to be below {bound}");
                    let steps = report.history.windows(2).all(|w| w[1] <= 1.01 * w[0] + 1e-5);
                    assert!(steps || report.history.len() > 60, "{name}: {:?}", report.history);
                }
            }
        }
    }
}

#[test]
fn the_bound_is_of_use() {
    // Light that is the same everywhere is the eigenvector of ρ, where the bound is sharp: error = residual / (1 − ρ).
    let operator = Dense::new(1, 150, 0.9);
    let b = vec![Rgb::ONE; 150];
    let exact = operator.exact(&b);
    // Neumann's series, its albedo hidden: its error after n products is ρⁿ⁺¹/(1 − ρ), all of one sign.
    for most in [3, 10, 30] {
        let truthful = IterateParams { most, ..params(0.9, 1e-9) };
        let (x, report) =
            solve(|x| operator.apply(x), &b, &IterateParams { bounces: Some(most + 1), ..truthful });
        assert_eq!(report.error_bound, f64::INFINITY, "a limit on bounces is no solution");
        let residual: Vec<Rgb> =
            operator.apply(&x).iter().zip(&b).zip(&x).map(|((k, b), x)| *k + *b - *x).collect();
        let largest = residual.iter().map(|r| f64::from(r.abs().max_element())).fold(0.0, f64::max);
        let error = error(&x, &exact);
        // Rounding of values up to 10: 1e-5 of the error's least size, 0.9³¹/0.1 = 0.38.
        assert!((error / (largest / 0.1) - 1.0).abs() < 1e-4, "error {error}, residual {largest}");
    }
    let (x, report) = solve(|x| operator.apply(x), &b, &params(0.9, 1e-4));
    let error = error(&x, &exact);
    assert!(
        error <= report.error_bound && report.error_bound < 0.01 * 10.0,
        "{error} below {}",
        report.error_bound
    );
}
