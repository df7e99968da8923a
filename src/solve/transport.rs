//! The operator's product in three calls: pull, gather, push.

use rayon::prelude::*;

use crate::light::Rgb;
use crate::links::compress::merged::{Block, RUN};
use crate::links::receivers::Receivers;
use crate::links::rows::{BLACK, LOST, SKY};
use crate::links::spread::Spread;

/// The linear map from irradiance at receivers to irradiance at receivers, one bounce later.
///
/// H′ = G·ρ·P·H, without lamps and sky. ‖GP‖∞ ≤ 1, so the spectral radius is at most the largest albedo.
pub struct Transport<'a> {
    /// Rows G.
    pub receivers: &'a Receivers,
    /// Interpolation P.
    pub spread: &'a Spread,
    /// ρ per site.
    pub albedo: &'a [Rgb],
}

impl Transport<'_> {
    /// Interpolates irradiance from receivers to sites: P·H. Sites without receivers get none.
    pub fn push(&self, receivers: &[Rgb]) -> Vec<Rgb> {
        (0..self.albedo.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|site| {
                let weights = self.spread.weights_of(site);
                self.spread
                    .receivers_of(site)
                    .iter()
                    .zip(weights)
                    .map(|(&r, &w)| receivers[r as usize] * w)
                    .sum()
            })
            .collect()
    }

    /// Radiosity that leaves the sites under the given irradiance: ρ·H + E.
    pub fn pull(&self, irradiance: &[Rgb], own: Option<&[Rgb]>) -> Vec<Rgb> {
        let reflected = |site: usize| self.albedo[site] * irradiance[site];
        (0..self.albedo.len())
            .into_par_iter()
            .with_min_len(4096)
            .map(|site| reflected(site) + own.map_or(Rgb::ZERO, |own| own[site]))
            .collect()
    }

    /// Irradiance at receivers from the sites' radiosity: G·B.
    ///
    /// Accuracy: a row's sum errs by less than 9 ε of the sum of magnitudes. The same for any number of threads.
    pub fn gather(&self, radiosity: &[Rgb]) -> Vec<Rgb> {
        let slots = Slots::new(radiosity);
        (0..self.receivers.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|r| {
                let (rows, r) = self.receivers.row(r);
                let mut sum = Sum::default();
                for part in rows.row(r).chunks(PART) {
                    sum.add(part.iter().fold([0.0; 4], |sum, &met| plus(sum, slots.of(met))));
                }
                sum.mean(rows.rays, rows.summaries[r].escaped)
            })
            .collect()
    }

    /// One bounce: H ↦ G·ρ·P·H.
    pub fn apply(&self, receivers: &[Rgb]) -> Vec<Rgb> {
        self.gather(&self.pull(&self.push(receivers), None))
    }
}

/// G·B from links as they are stored: blocks of all rows in order, each read once from front to back. Of the receivers
/// only the rows' summaries are asked.
///
/// The same rows as [`Transport::gather`] has, hence the same sums but for rounding, and the same for any number of threads.
/// Errors with a description when a block is damaged.
pub fn gather_stored(
    blocks: &[Block<'_>],
    receivers: &Receivers,
    radiosity: &[Rgb],
) -> Result<Vec<Rgb>, String> {
    let slots = Slots::new(radiosity);
    let mut irradiance = vec![Rgb::ZERO; blocks.iter().map(Block::rows).sum()];
    if receivers.len() != irradiance.len() {
        return Err(format!("{} summaries of {} rows", receivers.len(), irradiance.len()));
    }
    let mut rest = irradiance.as_mut_slice();
    let mut first = 0;
    let mut runs = Vec::new();
    for block in blocks {
        let (own, others) = rest.split_at_mut(block.rows());
        runs.extend(own.chunks_mut(RUN).enumerate().map(|(run, out)| (block, first, run, out)));
        first += block.rows();
        rest = others;
    }
    runs.into_par_iter().try_for_each(|(block, first, run, out)| {
        let link = |sum: &mut Sum, site: u32, count: u32| match slots.0.get(site as usize) {
            Some(&slot) if (site as usize) < radiosity.len() => {
                sum.link(slot, count as f32);
                true
            }
            _ => false,
        };
        let row = |r: usize, mut sum: Sum, lost: u32| {
            let (rows, own) = receivers.row(first + r);
            let escaped = rows.summaries[own].escaped;
            let known = block.rays().saturating_sub(lost).saturating_sub(escaped);
            sum.0[3] = f64::from(known);
            out[r - run * RUN] = sum.mean(block.rays(), escaped);
        };
        block.fold(run, link, row)
    })?;
    Ok(irradiance)
}

/// Entries added up in f32 before f64 takes over.
const PART: usize = 16;

/// Marks are the last three numbers, in this order: [`Slots::of`] counts on it.
const _: () = assert!(LOST == u32::MAX - 2 && BLACK == u32::MAX - 1 && SKY == u32::MAX);

/// What entries of rows stand for: a site's radiosity and one ray that met a known surface; nothing and such a ray; nothing. Marks are
/// slots like any other, so that no entry needs a branch.
struct Slots(Vec<[f32; 4]>);

impl Slots {
    fn new(radiosity: &[Rgb]) -> Self {
        let sites = radiosity.iter().map(|b| [b.x, b.y, b.z, 1.0]);
        // In the order of the marks' numbers: lost, black, sky.
        Self(sites.chain([[0.0; 4], [0.0, 0.0, 0.0, 1.0], [0.0; 4]]).collect())
    }

    #[inline]
    fn of(&self, met: u32) -> [f32; 4] {
        let mark = self.0.len() - 3 + met.wrapping_sub(LOST) as usize;
        self.0[(met as usize).min(mark)]
    }
}

/// Sums of three channels and of rays that met known surfaces.
#[derive(Default)]
struct Sum([f64; 4]);

impl Sum {
    fn add(&mut self, part: [f32; 4]) {
        self.0.iter_mut().zip(part).for_each(|(sum, part)| *sum += f64::from(part));
    }

    #[inline]
    fn link(&mut self, slot: [f32; 4], count: f32) {
        self.0.iter_mut().zip(slot).for_each(|(sum, slot)| *sum += f64::from(slot * count));
    }

    /// The row's value; lost rays count as the mean of those that met known surfaces.
    fn mean(&self, rays: u32, escaped: u32) -> Rgb {
        let [x, y, z, known] = self.0;
        let weight = f64::from(rays.saturating_sub(escaped)) / (known.max(1.0) * f64::from(rays.max(1)));
        Rgb::new((x * weight) as f32, (y * weight) as f32, (z * weight) as f32)
    }
}

#[inline]
fn plus(sum: [f32; 4], slot: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|k| sum[k] + slot[k])
}
