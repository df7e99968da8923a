//! One bounce of several lights at once: each row is read once for all of them.

use rayon::prelude::*;

use super::Source;
use crate::light::Rgb;
use crate::links::rows::LOST;
use crate::solve::transport::Transport;

/// Lights that share a pass over the rows: with the count of known rays they fill a line of the cache.
pub const ABREAST: usize = 5;

/// Entries added up in f32 before f64 takes over, as [`Transport::gather`] does.
const PART: usize = 16;

/// Up to five lights' colours at one place, and in the last lane a one where it is known.
#[derive(Clone, Copy, Default)]
#[repr(align(64))]
struct Line([f32; 16]);

impl Line {
    fn of(lights: &[&[Rgb]], k: usize) -> Self {
        let mut line = Self::default();
        lights.iter().enumerate().for_each(|(l, light)| line.set(l, light[k]));
        line
    }

    fn set(&mut self, light: usize, value: Rgb) {
        self.0[3 * light..3 * light + 3].copy_from_slice(&value.to_array());
    }

    fn colour(&self, light: usize) -> Rgb {
        Rgb::from_slice(&self.0[3 * light..])
    }
}

/// Irradiance at receivers one bounce later, G·(E + ρ·P·H) + S of each light; without E and S where `sources` is empty.
pub fn bounce(transport: &Transport<'_>, lights: &[&[Rgb]], sources: &[Source]) -> Vec<Vec<Rgb>> {
    let mut images: Vec<Vec<Rgb>> = Vec::with_capacity(lights.len());
    for (part, lights) in lights.chunks(ABREAST).enumerate() {
        let own = sources.get(part * ABREAST..).unwrap_or_default();
        match lights {
            [one] => {
                let own = own.first().map(|source| &source.own[..]);
                images.push(transport.gather(&transport.pull(&transport.push(one), own)));
            }
            several => images.extend(gather(transport, &reflected(transport, several, own), several.len())),
        }
    }
    for (image, source) in images.iter_mut().zip(sources).filter(|(_, source)| !source.sky.is_empty()) {
        image.par_iter_mut().zip(&source.sky).with_min_len(1 << 14).for_each(|(h, sky)| *h += *sky);
    }
    images
}

/// Radiosity of the sites under some lights, and what marks of rows stand for after them, in the order of their numbers:
/// lost, black, sky.
fn reflected(transport: &Transport<'_>, lights: &[&[Rgb]], sources: &[Source]) -> Vec<Line> {
    let receivers: Vec<Line> =
        (0..transport.receivers.len()).into_par_iter().map(|r| Line::of(lights, r)).collect();
    let site = |s: usize| {
        let mut sum = Line::default();
        for (&r, &w) in transport.spread.receivers_of(s).iter().zip(transport.spread.weights_of(s)) {
            let light = &receivers[r as usize].0;
            (0..16).for_each(|k| sum.0[k] += light[k] * w);
        }
        for l in 0..lights.len() {
            let own = sources.get(l).map_or(Rgb::ZERO, |source| source.own[s]);
            sum.set(l, transport.albedo[s] * sum.colour(l) + own);
        }
        sum.0[15] = 1.0;
        sum
    };
    let mut black = Line::default();
    black.0[15] = 1.0;
    let mut lines: Vec<Line> = Vec::with_capacity(transport.albedo.len() + 3);
    (0..transport.albedo.len()).into_par_iter().with_min_len(1024).map(site).collect_into_vec(&mut lines);
    lines.extend([Line::default(), black, Line::default()]);
    lines
}

/// G·B of some lights, from the sites' lines.
fn gather(transport: &Transport<'_>, lines: &[Line], lights: usize) -> Vec<Vec<Rgb>> {
    let first_mark = lines.len() - 3;
    let line = |met: u32| &lines[(met as usize).min(first_mark + met.wrapping_sub(LOST) as usize)].0;
    let mut sums = Vec::new();
    (0..transport.receivers.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|r| {
            let (rows, r) = transport.receivers.row(r);
            let mut sum = [0.0f64; 16];
            for part in rows.row(r).chunks(PART) {
                let mut few = [0.0f32; 16];
                for &met in part {
                    let line = line(met);
                    (0..16).for_each(|k| few[k] += line[k]);
                }
                (0..16).for_each(|k| sum[k] += f64::from(few[k]));
            }
            // Lost rays count as the mean of those that met known surfaces.
            let rays = f64::from(rows.rays.saturating_sub(rows.summaries[r].escaped));
            let weight = rays / (sum[15].max(1.0) * f64::from(rows.rays.max(1)));
            Line(sum.map(|sum| (sum * weight) as f32))
        })
        .collect_into_vec(&mut sums);
    (0..lights).map(|l| sums.par_iter().with_min_len(4096).map(|sum| sum.colour(l)).collect()).collect()
}
