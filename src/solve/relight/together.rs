//! The light of several sources by the same rows, from a first guess: GMRES for each, in step, so that each product
//! serves them all.
//!
//! This work is based on: Saad and Schultz, "GMRES", 1986, in the form of [`crate::solve::iterate`]. The first product
//! takes the sources in, so that a good guess is a solution after one. Loose solutions stop by what the last step changed, as
//! Strakoš and Tichý, "Error Estimation in Preconditioned Conjugate Gradients", 2005, have it for another iteration, and are handed
//! out one bounce ahead, which the basis knows without a product.

use super::bounce::bounce;
use super::{Links, Source, Transfer};
use crate::light::Rgb;
use crate::solve::iterate::{Cycle, IterateReport, KRYLOV, ROUNDING, norms, relative};
use crate::solve::transport::Transport;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TogetherParams {
    /// Relative error of every source's irradiance at receivers that is aimed at, in the norm of squares: the residual, relative
    /// to the irradiance, is held to this times 1 − ρ, ρ the largest albedo. An estimate, not a bound: ‖K‖₂ may exceed ρ. From
    /// 0.1 % on, it is enough, too, that what the last step changed tells of no more.
    pub error: f64,
    /// Products with the operator at the most.
    pub most: usize,
    /// Bounces of light to keep; None until converged.
    pub bounces: Option<usize>,
    /// Largest albedo of any site.
    pub largest_albedo: f32,
}

/// Errors above this are not measured by one more product: what GMRES says of its residual is good to far less.
const LOOSE: f64 = 1.0e-3;

/// Steps that leave more than this share of the residual say nothing of the error.
const STEADY: f64 = 0.5;

/// The least of 1 − ρ that errors are divided by.
const LEAST_GAP: f64 = 1.0e-3;

/// Solves H = G·(E + ρ·P·H) + S for every source, from first guesses of the irradiance at receivers.
///
/// Products count once for up to five sources. `pause` is asked before each. Deterministic for any number of threads.
///
/// # Errors
/// What `pause` says.
///
/// # Panics
/// When there are not as many guesses as sources.
pub fn solve_together<E>(
    (transport, links): (&Transport<'_>, &Links),
    sources: &[Source],
    guesses: Vec<Vec<Rgb>>,
    params: &TogetherParams,
    pause: &dyn Fn() -> Result<(), E>,
) -> Result<(Vec<Transfer>, IterateReport), E> {
    assert_eq!(sources.len(), guesses.len(), "a first guess for each source");
    let (lights, report) = match params.bounces {
        Some(bounces) => follow((transport, links), sources, (bounces, pause))?,
        None => iterate((transport, links), sources, guesses, (params, pause))?,
    };
    let transfer = |(mut irradiance, source): (Vec<Rgb>, &Source)| {
        // Of light that is nowhere negative; skies of harmonics are.
        let negative = source.own.iter().chain(&source.sky).any(|light| light.min_element() < 0.0);
        irradiance.iter_mut().filter(|_| !negative).for_each(|h| *h = h.max(Rgb::ZERO));
        let radiosity = transport.pull(&transport.push(&irradiance), Some(&source.own));
        Transfer { irradiance, radiosity }
    };
    Ok((lights.into_iter().zip(sources).map(transfer).collect(), report))
}

/// The first few bounces.
fn follow<E>(
    (transport, links): (&Transport<'_>, &Links),
    sources: &[Source],
    (bounces, pause): (usize, &dyn Fn() -> Result<(), E>),
) -> Result<(Vec<Vec<Rgb>>, IterateReport), E> {
    let mut lights = vec![vec![Rgb::ZERO; transport.receivers.len()]; sources.len()];
    let iterations = bounces.max(1);
    for _ in 0..iterations {
        pause()?;
        lights = bounce((transport, links), &slices(&lights), sources);
    }
    Ok((
        lights,
        IterateReport { iterations, converged: true, error_bound: f64::INFINITY, ..Default::default() },
    ))
}

fn iterate<E>(
    (transport, links): (&Transport<'_>, &Links),
    sources: &[Source],
    mut lights: Vec<Vec<Rgb>>,
    (params, pause): (&TogetherParams, &dyn Fn() -> Result<(), E>),
) -> Result<(Vec<Vec<Rgb>>, IterateReport), E> {
    // What no source has stays none: its residual would never be small beside it.
    for (light, source) in lights.iter_mut().zip(sources) {
        let has = source.own.iter().chain(&source.sky).fold(Rgb::ZERO, |m, v| m.max(v.abs()));
        let mask = Rgb::select(has.cmpgt(Rgb::ZERO), Rgb::ONE, Rgb::ZERO);
        light.iter_mut().for_each(|h| *h *= mask);
    }
    let gap = (1.0 - f64::from(params.largest_albedo)).max(LEAST_GAP);
    let tolerance = (params.error * gap).max(f64::from(ROUNDING));
    let mut report = IterateReport { residual: 1.0, error_bound: f64::INFINITY, ..Default::default() };
    loop {
        pause()?;
        let images = bounce((transport, links), &slices(&lights), sources);
        report.iterations += 1;
        let residuals: Vec<Vec<Rgb>> =
            images.iter().zip(&lights).map(|(image, light)| minus(image, light)).collect();
        let scales: Vec<[f64; 3]> = images.iter().map(|image| norms(image)).collect();
        let worst = |all: &mut dyn Iterator<Item = [f64; 3]>| -> f64 {
            all.zip(&scales).map(|(norm, scale)| relative(norm, *scale)).fold(0.0, f64::max)
        };
        report.residual = worst(&mut residuals.iter().map(|r| norms(r)));
        report.history.push(report.residual);
        report.converged = report.residual <= tolerance;
        if report.converged || report.iterations >= params.most {
            // The images are one bounce ahead.
            return Ok((images, report));
        }
        let mut cycles: Vec<Cycle> = residuals.into_iter().map(Cycle::new).collect();
        let mut close = false;
        loop {
            pause()?;
            let directions: Vec<&[Rgb]> = cycles.iter().map(Cycle::last).collect();
            let images = bounce((transport, links), &directions, &[]);
            cycles.iter_mut().zip(&images).for_each(|(cycle, image)| cycle.take(image));
            report.iterations += 1;
            let before = report.residual;
            report.residual = worst(&mut cycles.iter().map(Cycle::residuals));
            report.history.push(report.residual);
            if params.error >= LOOSE {
                let change = worst(&mut cycles.iter().map(Cycle::change));
                close = is_close(params.error, (before, report.residual), change);
            }
            let full = cycles.iter().any(|cycle| cycle.steps() >= KRYLOV);
            // What is measured again may come out a little larger.
            let enough = if params.error >= LOOSE { tolerance } else { 0.5 * tolerance };
            if report.residual <= enough || close || full || report.iterations + 1 >= params.most {
                break;
            }
        }
        cycles.iter().zip(&mut lights).for_each(|(cycle, light)| cycle.correct(light));
        if params.error >= LOOSE && (report.residual <= tolerance || close) {
            cycles.iter().zip(&mut lights).for_each(|(cycle, light)| cycle.add_residual(light));
            report.converged = true;
            return Ok((lights, report));
        }
    }
}

/// Whether the error is as small as asked, by what the last step did: residuals that shrink by q a step leave an error of
/// `change`·q/(1 − q), and steps that help little say nothing. The bounce that comes after is not counted: it halves it again.
fn is_close(error: f64, (before, residual): (f64, f64), change: f64) -> bool {
    let q = residual / before;
    residual <= error && q <= STEADY && change * q / (1.0 - q) <= error
}

fn slices(lights: &[Vec<Rgb>]) -> Vec<&[Rgb]> {
    lights.iter().map(|light| &light[..]).collect()
}

fn minus(a: &[Rgb], b: &[Rgb]) -> Vec<Rgb> {
    a.iter().zip(b).map(|(a, b)| *a - *b).collect()
}
