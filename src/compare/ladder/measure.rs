//! One measurement: a bake or a path tracing, timed, and judged against the truth.

use std::path::Path;

use super::{Key, Measurement, Method, Subject, Truth, truth};
use crate::archive::{Digest, Digests};
use crate::bake::pipeline::{self, Target};
use crate::bake::{Monitor, Stopwatch, store};
use crate::error::{Error, Result};
use crate::light::{Rgb, mean_channel};
use crate::links::points::Operator;
use crate::solve::Irradiance;

/// Measures what a key asks for, on as many threads as it says.
pub fn measure(subject: &Subject, key: &Key, folder: &Path, monitor: &dyn Monitor) -> Result<Measurement> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(key.threads).build();
    let pool = pool.map_err(|e| Error::Usage(format!("{} threads: {e}", key.threads)))?;
    pool.install(|| match key.method {
        Method::Bake(basis) => {
            let target = Target {
                error: key.target,
                seed: key.seed,
                bounces: None,
                basis,
                operator: Operator::default(),
                relightable: false,
            };
            baked(subject, key, &target, (folder, monitor))
        }
        Method::Paths => traced(subject, key, monitor),
    })
}

fn blank(subject: &Subject, key: &Key) -> Measurement {
    let noise = subject.truth.noise.sqrt() / level(&subject.truth);
    Measurement { noise, ..Measurement::blank(key.clone(), &subject.name, subject.truth.points.len()) }
}

impl Measurement {
    /// Nothing measured yet of so many points of a scene.
    pub(super) fn blank(key: Key, scene: &str, points: usize) -> Self {
        Self {
            key,
            scene: scene.into(),
            seconds: 0.0,
            cpu_seconds: 0.0,
            answer_seconds: 0.0,
            points,
            rays: None,
            sites: None,
            links: None,
            bytes: None,
            true_error: 0.0,
            noise: 0.0,
            estimated_error: 0.0,
            residuals: Vec::new(),
        }
    }
}

fn baked(
    subject: &Subject,
    key: &Key,
    target: &Target,
    (folder, monitor): (&Path, &dyn Monitor),
) -> Result<Measurement> {
    let watch = Stopwatch::start();
    let (model, _, report) = pipeline::reach(&subject.scene, target, monitor)?;
    let (seconds, cpu_seconds) = (watch.seconds(), watch.cpu_seconds());
    let watch = Stopwatch::start();
    let answers = model.field().evaluate(&subject.truth.points);
    let answer_seconds = watch.seconds();
    let light: Vec<Rgb> = answers.iter().map(Irradiance::total).collect();
    // Only its size is wanted.
    let job = tempfile::tempdir_in(folder).map_err(|e| Error::io(folder, "making a folder", e))?;
    let digest = Digest::of_bytes(&[]);
    let stored = store::write(&model, job.path(), Digests { inputs: digest, options: digest })?;
    Ok(Measurement {
        seconds,
        cpu_seconds,
        answer_seconds,
        rays: Some(report.rays),
        sites: Some(model.sites.len() as u64),
        links: Some(stored.links),
        bytes: Some(stored.archive_bytes),
        true_error: error(&light, &subject.truth),
        estimated_error: report.estimate.error,
        residuals: report.iterate.history,
        ..blank(subject, key)
    })
}

fn traced(subject: &Subject, key: &Key, monitor: &dyn Monitor) -> Result<Measurement> {
    let watch = Stopwatch::start();
    let asked = (key.target as u32, key.seed);
    let estimates = truth::traced(&subject.scene, &subject.truth.points, asked, ("paths", monitor))?;
    let (seconds, cpu_seconds) = (watch.seconds(), watch.cpu_seconds());
    let light: Vec<Rgb> = estimates.iter().map(|e| e.mean).collect();
    let square = estimates.iter().map(|e| f64::from(e.standard_error.length_squared()) / 3.0).sum::<f64>();
    Ok(Measurement {
        seconds,
        cpu_seconds,
        answer_seconds: seconds,
        true_error: error(&light, &subject.truth),
        estimated_error: (square / light.len() as f64).sqrt() / level(&subject.truth),
        ..blank(subject, key)
    })
}

/// Mean irradiance over points and channels.
fn level(truth: &Truth) -> f64 {
    let sum = truth.irradiance.iter().map(|h| f64::from(mean_channel(*h))).sum::<f64>();
    (sum / truth.irradiance.len() as f64).max(f64::MIN_POSITIVE)
}

/// Root of the mean square difference over points and channels, the reference's noise taken out, over the mean irradiance.
fn error(light: &[Rgb], truth: &Truth) -> f64 {
    let apart = |(got, want): (&Rgb, &Rgb)| f64::from((*got - *want).length_squared()) / 3.0;
    let square = light.iter().zip(&truth.irradiance).map(apart).sum::<f64>() / light.len() as f64;
    (square - truth.noise).max(0.0).sqrt() / level(truth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::SurfacePoint;
    use glam::Vec3;

    #[test]
    fn errors_are_relative_and_free_of_the_references_noise() {
        let point = SurfacePoint { position: Vec3::ZERO, normal: Vec3::Z };
        let irradiance = vec![Vec3::splat(1.0), Vec3::splat(3.0)];
        let truth = Truth { points: vec![point; 2], irradiance, noise: 0.0, digest: Digest::of_bytes(&[]) };
        let light = [Vec3::splat(1.5), Vec3::splat(2.5)];
        assert!((error(&light, &truth) - 0.25).abs() < 1e-7);
        let noisy = Truth { noise: 0.09, ..truth };
        // √(0.25 − 0.09) of a mean of 2.
        assert!((error(&light, &noisy) - 0.2).abs() < 1e-7);
    }
}
