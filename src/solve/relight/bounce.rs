//! One bounce of several lights at once: each row is read once for all of them.

use rayon::prelude::*;

use super::{Links, Source};
use crate::light::Rgb;
use crate::solve::transport::Transport;

/// Lights that share a pass over the rows: they fill a line of the cache.
pub const ABREAST: usize = 5;

/// Links added up in f32 before f64 takes over.
const PART: usize = 16;

/// Up to five lights' colours at one place.
#[derive(Clone, Copy, Default)]
#[repr(align(64))]
struct Line([f32; 16]);

/// One light's colour.
#[derive(Clone, Copy, Default)]
#[repr(align(16))]
struct Slot([f32; 4]);

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
pub fn bounce(
    (transport, links): (&Transport<'_>, &Links),
    lights: &[&[Rgb]],
    sources: &[Source],
) -> Vec<Vec<Rgb>> {
    let mut images: Vec<Vec<Rgb>> = Vec::with_capacity(lights.len());
    for (part, lights) in lights.chunks(ABREAST).enumerate() {
        let own = sources.get(part * ABREAST..).unwrap_or_default();
        match lights {
            [one] => {
                let slots = reflected_one(transport, one, own.first());
                images.push(gather_one(links, &slots, transport.receivers.len()));
            }
            several => {
                let lines = reflected(transport, several, own);
                images.extend(gather(links, &lines, (transport.receivers.len(), several.len())));
            }
        }
    }
    for (image, source) in images.iter_mut().zip(sources).filter(|(_, source)| !source.sky.is_empty()) {
        image.par_iter_mut().zip(&source.sky).with_min_len(1 << 14).for_each(|(h, sky)| *h += *sky);
    }
    images
}

/// Radiosity of the sites under some lights.
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
        sum
    };
    (0..transport.albedo.len()).into_par_iter().with_min_len(1024).map(site).collect()
}

/// G·B of some lights, from the sites' lines.
fn gather(links: &Links, lines: &[Line], (receivers, lights): (usize, usize)) -> Vec<Vec<Rgb>> {
    let row = |r: usize| Line(sum_of_row(links, r, |site| &lines[site as usize].0));
    let sums: Vec<Line> = (0..receivers).into_par_iter().with_min_len(64).map(row).collect();
    (0..lights).map(|l| sums.par_iter().with_min_len(4096).map(|sum| sum.colour(l)).collect()).collect()
}

/// Radiosity of the sites under one light.
fn reflected_one(transport: &Transport<'_>, light: &[Rgb], source: Option<&Source>) -> Vec<Slot> {
    let site = |s: usize| {
        let near = transport.spread.receivers_of(s).iter().zip(transport.spread.weights_of(s));
        let irradiance: Rgb = near.map(|(&r, &w)| light[r as usize] * w).sum();
        let b = transport.albedo[s] * irradiance + source.map_or(Rgb::ZERO, |source| source.own[s]);
        Slot([b.x, b.y, b.z, 0.0])
    };
    (0..transport.albedo.len()).into_par_iter().with_min_len(1024).map(site).collect()
}

/// G·B of one light, from the sites' slots.
fn gather_one(links: &Links, slots: &[Slot], receivers: usize) -> Vec<Rgb> {
    let row = |r: usize| {
        let [x, y, z, _] = sum_of_row(links, r, |site| &slots[site as usize].0);
        Rgb::new(x, y, z)
    };
    (0..receivers).into_par_iter().with_min_len(64).map(row).collect()
}

/// A row's sum over the sites that it meets: in f32 for a few links at a time, then in f64.
#[inline]
fn sum_of_row<'a, const N: usize>(
    links: &Links,
    receiver: usize,
    light: impl Fn(u32) -> &'a [f32; N],
) -> [f32; N] {
    let (sites, counts, share) = links.row(receiver);
    let mut sum = [0.0f64; N];
    for (sites, counts) in sites.chunks(PART).zip(counts.chunks(PART)) {
        let mut few = [0.0f32; N];
        for (&site, &count) in sites.iter().zip(counts) {
            let (light, count) = (light(site), f32::from(count));
            (0..N).for_each(|k| few[k] += light[k] * count);
        }
        (0..N).for_each(|k| sum[k] += f64::from(few[k]));
    }
    sum.map(|sum| (sum * f64::from(share)) as f32)
}
