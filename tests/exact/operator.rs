//! The operator and the solvers: against the dense matrix, against each other, truncated, and on any number of threads.

use glam::DVec3;
use glowtree::bake::Silent;
use glowtree::bake::laws::Plan;
use glowtree::bake::model::Model;
use glowtree::bake::pipeline::build;
use glowtree::geometry::hash;
use glowtree::light::Rgb;
use glowtree::links::dense;
use glowtree::scene::Scene;
use glowtree::solve::iterate::IterateParams;
use glowtree::solve::transport::Transport;

use crate::shapes::{self, part};

/// A room with a block, a small lamp and one glowing wall: every kind of light, three colours.
fn scene(albedo: f32) -> Scene {
    let room = shapes::cuboid(DVec3::ZERO, DVec3::ONE, 2).flipped();
    let block = shapes::cuboid(DVec3::new(0.3, 0.3, 0.0), DVec3::new(0.6, 0.6, 0.4), 2);
    let lamp = shapes::quad(DVec3::new(0.4, 0.4, 0.95), DVec3::Y * 0.2, DVec3::X * 0.2, 1);
    let wall = shapes::quad(DVec3::new(0.05, 0.2, 0.2), DVec3::Y * 0.7, DVec3::Z * 0.7, 1);
    shapes::scene(&[
        part("room", room, albedo).coloured([albedo, 0.5 * albedo, 0.1]),
        part("block", block, albedo),
        part("lamp", lamp, 0.0).exitance(5.0),
        part("wall", wall, 0.2).exitance(0.3).two_sided(),
    ])
}

fn baked(albedo: f32, error: f64, bounces: Option<usize>) -> Model {
    build(scene(albedo), &Plan::new(error, 1), bounces, &Silent).expect("nothing interrupts").0
}

fn transport(model: &Model) -> Transport<'_> {
    Transport { receivers: &model.receivers, spread: &model.spread, albedo: &model.albedo }
}

#[test]
fn the_product_is_the_dense_matrix() {
    let model = baked(0.8, 0.2, None);
    let (sites, transport) = (model.sites.len(), transport(&model));
    let matrix = dense::matrix(sites, &model.receivers, &model.spread);
    // Rows sum to the share of rays that met live surfaces; weights are f32 and sum to one within an ulp each.
    for (site, row) in matrix.iter().enumerate() {
        let sum: f64 = row.iter().sum();
        assert!(sum <= 1.0 + 1e-6 && row.iter().all(|&x| x >= 0.0), "row {site} sums to {sum}");
    }
    // Some light must arrive at all.
    assert!(matrix.iter().flatten().sum::<f64>() > 0.5 * sites as f64);
    let radiosity: Vec<Rgb> =
        (0..sites as u64).map(|s| Rgb::new(hash::unit(1, s), hash::unit(2, s), hash::unit(3, s))).collect();
    let got = transport.push(&transport.gather(&radiosity));
    for (site, row) in matrix.iter().enumerate() {
        let want: DVec3 = row.iter().zip(&radiosity).map(|(m, b)| b.as_dvec3() * *m).sum();
        // Sums of a few hundred f32 values up to 1, divided at the end: 1e-6 to 1e-5.
        assert!((got[site].as_dvec3() - want).abs().max_element() < 1e-5, "{site}: {} {want}", got[site]);
    }
}

/// Radiosity before any interreflection and the irradiance it sends to the receivers, from the parts alone.
fn first_light(model: &Model) -> Vec<Rgb> {
    let own =
        |site: usize| model.exitance[site] + model.albedo[site] * model.direct.at_site(&model.lamps, site);
    transport(model).gather(&(0..model.sites.len()).map(own).collect::<Vec<_>>())
}

fn largest(values: impl Iterator<Item = Rgb>) -> f32 {
    values.map(|v| v.abs().max_element()).fold(0.0, f32::max)
}

#[test]
fn bounces_truncate_the_series() {
    for bounces in [1, 2, 5] {
        let model = baked(0.8, 0.2, Some(bounces));
        let transport = transport(&model);
        let mut term = first_light(&model);
        let mut sum = term.clone();
        for _ in 1..bounces {
            term = transport.apply(&term);
            sum.iter_mut().zip(&term).for_each(|(s, t)| *s += *t);
        }
        let solved = &model.solution.irradiance;
        let difference = largest(sum.iter().zip(solved).map(|(a, b)| *a - *b));
        // The same f32 operations in the same order.
        assert!(difference <= 1e-6 * largest(sum.iter().copied()), "{bounces} bounces: {difference}");
    }
}

#[test]
fn a_furnace_fills_bounce_by_bounce() {
    // H after n gathers in a furnace: Σ ρᵏ, k < n.
    let room = shapes::cuboid(DVec3::ZERO, DVec3::ONE, 2).flipped();
    let scene = shapes::scene(&[part("room", room, 0.8).exitance(1.0)]);
    let mut last = 0.0;
    for bounces in 1..5 {
        let model = build(scene.clone(), &Plan::new(0.2, 1), Some(bounces), &Silent).expect("no signal").0;
        let want = (1.0 - 0.8f32.powi(bounces as i32)) / (1.0 - 0.8);
        let difference = largest(model.solution.irradiance.iter().map(|h| *h - Rgb::splat(want)));
        // Exact up to f32 rounding in a few hundred additions and one ray in a million through a crease.
        assert!(difference < 1e-3 * want, "{bounces} bounces: off by {difference} of {want}");
        assert!(want > last, "light only grows");
        last = want;
    }
}

#[test]
fn both_solvers_agree() {
    let model = baked(0.95, 0.2, None);
    let solve = |largest_albedo: f32| {
        let params = IterateParams { tolerance: 1e-6, most: 1000, bounces: None, largest_albedo };
        let (solution, report) = model.problem().solve(&params);
        assert!(report.converged, "{report:?}");
        (solution, report.iterations)
    };
    // A low albedo in the parameters alone selects Neumann's series.
    let (series, products) = solve(0.0);
    let (accelerated, fewer) = solve(0.95);
    let scale = largest(series.irradiance.iter().copied());
    let difference =
        largest(series.irradiance.iter().zip(&accelerated.irradiance).map(|(a, b)| *a - *b)) / scale;
    println!("{products} products in the series, {fewer} accelerated, {difference:e} apart");
    // Residual 1e-6 each, times 1/(1 − 0.95) for the error, times √n/… of the norm's spread: 5e-5 in all, doubled.
    assert!(difference < 1e-4, "{difference}");
    assert!(fewer < products, "{fewer} of {products}");
}

/// Bytes of everything that was solved.
fn bytes(model: &Model) -> Vec<u8> {
    let solution = &model.solution;
    let light = solution.irradiance.iter().chain(&solution.radiosity).flat_map(Rgb::to_array);
    let turns = solution.gradient.iter().flat_map(glam::Mat3::to_cols_array);
    let rest = solution.sky_visibility.iter().chain(&solution.surplus).copied();
    light.chain(turns).chain(rest).flat_map(f32::to_le_bytes).collect()
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let model = baked(0.8, 0.05, None);
            let points = shapes::points_on(&model.scene, 0, 500, 3);
            let answers = model.field().evaluate(&points);
            let seen: Vec<u8> =
                answers.iter().flat_map(|a| a.total().to_array()).flat_map(f32::to_le_bytes).collect();
            (bytes(&model), seen)
        })
    };
    let one = on(1);
    assert!(!one.0.is_empty() && one.0.iter().any(|b| *b != 0));
    for threads in [2, 3] {
        let many = on(threads);
        assert!(many.0 == one.0, "solution differs on {threads} threads");
        assert!(many.1 == one.1, "answers differ on {threads} threads");
    }
}
