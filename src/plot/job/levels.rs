//! How many sites, receivers and links there are at each level: histograms over octaves.

use rayon::prelude::*;

use super::{links_of, row};
use crate::plot::Axis;
use crate::plot::canvas::{Figure, Rect};
use crate::plot::chart::{Chart, Series, Style};
use crate::solve::Field;

/// Octaves are counted from 2⁻⁴⁰ to 2⁸⁷: beyond lie no lengths of f32 that mean anything.
const OCTAVES: usize = 128;
const ZEROTH: i32 = 40;

/// Counts by octave: how many values lie nearest to each power of two times `unit`.
#[derive(Debug, Clone, PartialEq)]
struct Histogram {
    unit: f64,
    counts: Vec<u64>,
}

impl Histogram {
    fn new(unit: f64) -> Self {
        Self { unit, counts: vec![0; OCTAVES] }
    }

    fn add(&mut self, value: f64, count: u64) {
        let octave = (value / self.unit).log2().round();
        if octave.is_finite() {
            let slot = (octave as i32).saturating_add(ZEROTH).clamp(0, OCTAVES as i32 - 1);
            self.counts[slot as usize] += count;
        }
    }

    fn merged(mut self, other: &Self) -> Self {
        self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
        self
    }

    /// The octaves' middles and their counts, without empty ones.
    fn bars(&self) -> Vec<[f64; 2]> {
        let middle = |slot: usize| self.unit * 2f64.powi(slot as i32 - ZEROTH);
        let filled = self.counts.iter().enumerate().filter(|(_, count)| **count > 0);
        filled.map(|(slot, &count)| [middle(slot), count as f64]).collect()
    }
}

/// Sites by spacing and receivers by radius.
pub fn of_sites(field: &Field<'_>) -> Figure {
    let around = field.problem.around;
    let scale = around.scene.placement.scale;
    let coarsest = around.sites.spacings.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
    // Spacings are the coarsest over powers of two: each falls on the middle of its octave.
    let counted = |values: &mut dyn Iterator<Item = f32>| {
        let mut histogram = Histogram::new(f64::from(coarsest) * scale);
        values.for_each(|v| histogram.add(f64::from(v) * scale, 1));
        histogram.bars()
    };
    let supports = field.problem.receivers.index.supports();
    let mut chart = Chart::new(
        "Levels of sites and receivers",
        Axis::log("spacing of sites, radius of receivers (scene units)"),
        Axis::log("count per octave"),
    );
    let sites = counted(&mut around.sites.spacings.iter().copied());
    let receivers = counted(&mut supports.iter().map(|s| s.radius));
    chart.series.push(Series::new(format!("{} sites", around.sites.len()), Style::Bars, sites));
    chart.series.push(Series::new(format!("{} receivers", supports.len()), Style::Bars, receivers));
    chart.figure()
}

/// A page of two charts.
const PAGE: [f64; 2] = [860.0, 400.0];

/// Links by distance over the spacing of the site that is met, and by how many rays they have.
pub fn of_links(field: &Field<'_>) -> Figure {
    let receivers = 0..field.problem.receivers.len() as u32;
    let none = || [(); 3].map(|()| Histogram::new(1.0));
    let [by_distance, rays_by_distance, by_rays] = receivers
        .into_par_iter()
        .fold(none, |counts, receiver| counted(field, receiver, counts))
        .reduce(none, |[a, b, c], [x, y, z]| [a.merged(&x), b.merged(&y), c.merged(&z)]);
    let sum = |h: &Histogram| h.counts.iter().sum::<u64>();
    let (links, rays) = (sum(&by_distance), sum(&rays_by_distance));
    let mut far = Chart::new(
        "How far links reach",
        Axis::log("distance / spacing of the site met"),
        Axis::log("count per octave"),
    );
    far.series.push(Series::new(format!("{links} links"), Style::Bars, by_distance.bars()));
    far.series.push(Series::new(format!("{rays} rays"), Style::Bars, rays_by_distance.bars()));
    let mut thick =
        Chart::new("How many rays they share", Axis::log("rays of a link"), Axis::log("links per octave"));
    let mean = rays as f64 / links.max(1) as f64;
    let name = if links > 0 { format!("{mean:.2} rays in the mean") } else { String::new() };
    thick.series.push(Series { tint: Some(2), ..Series::new(name, Style::Bars, by_rays.bars()) });
    let mut figure = Figure::new(PAGE, "Levels of links");
    let half = 0.5 * PAGE[0];
    for (k, chart) in [far, thick].iter().enumerate() {
        let area = Rect::sized([half * k as f64, 0.0], [half, PAGE[1]]);
        chart.draw(&mut figure, &area.grown(-10.0));
    }
    figure
}

/// Adds a receiver's links.
fn counted(
    field: &Field<'_>,
    receiver: u32,
    [mut near, mut rays, mut thick]: [Histogram; 3],
) -> [Histogram; 3] {
    let sites = field.problem.around.sites;
    let from = field.problem.receivers.index.supports()[receiver as usize].point.position;
    for (site, count) in links_of(row(field, receiver).0) {
        let site = site as usize;
        let ratio = f64::from(sites.positions[site].distance(from)) / f64::from(sites.spacings[site]);
        near.add(ratio, 1);
        rays.add(ratio, u64::from(count));
        thick.add(f64::from(count), 1);
    }
    [near, rays, thick]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_fall_on_the_nearest_octave() {
        let mut histogram = Histogram::new(3.0);
        // Halfway, in ratios, between 3 and 6 lies 4.24.
        for (value, count) in [(3.0, 2), (4.2, 1), (4.3, 5), (0.75, 7), (0.0, 9), (f64::NAN, 9)] {
            histogram.add(value, count);
        }
        assert_eq!(histogram.bars(), [[0.75, 7.0], [3.0, 3.0], [6.0, 5.0]]);
        assert_eq!(histogram.clone().merged(&histogram).bars()[2], [6.0, 10.0]);
    }
}
