//! Which surface every site stands for: a few points of each piece, given to the sites nearest to them.

use rayon::prelude::*;

use super::crowd::Crowd;
use super::{Plot, Sites};
use crate::geometry::SurfacePoint;
use crate::scatter::Candidate;
use crate::scatter::surface::{Spot, Surface};

/// Points of a piece that decide which sites its area goes to.
const AREA_POINTS: u32 = 48;

const NOBODY: u32 = u32::MAX;

/// Points of the surface by the site that stands for them.
#[derive(Debug, Clone, Default)]
pub struct Samples {
    /// Sites + 1 offsets.
    offsets: Vec<u32>,
    /// The points, and the area that each stands for.
    points: Vec<(Candidate, f32)>,
}

impl Samples {
    /// The points that a site stands for, each with its area; few, sometimes none.
    pub fn of(&self, site: usize) -> &[(Candidate, f32)] {
        &self.points[self.offsets[site] as usize..self.offsets[site + 1] as usize]
    }

    /// Gives every piece's area to the sites nearest to a few of its points, and sets the sites' areas by it.
    pub(super) fn share(sites: &mut Sites, surface: &Surface<'_>, plots: &[Plot], seed: u64) -> Self {
        let served: Vec<&Plot> = plots.iter().filter(|plot| plot.spacing > 0.0).collect();
        let seed = seed ^ 0xa2ea;
        // Plot after plot, point after point.
        let frozen = &*sites;
        let homes: Vec<[(u32, Spot); AREA_POINTS as usize]> = served
            .par_iter()
            .with_min_len(16)
            .map_init(Scratch::default, |scratch, plot| scratch.serve(frozen, surface, plot, seed))
            .collect();
        let found = |own: &[(u32, Spot)]| own.iter().filter(|home| home.0 != NOBODY).count();
        let parts: Vec<f32> =
            homes.iter().zip(&served).map(|(own, plot)| plot.piece.area / found(own) as f32).collect();
        let homes = homes.as_flattened();
        let mut offsets = vec![0u32; sites.len() + 1];
        homes.iter().filter(|h| h.0 != NOBODY).for_each(|h| offsets[h.0 as usize + 1] += 1);
        (0..sites.len()).for_each(|i| offsets[i + 1] += offsets[i]);
        let mut next = offsets.clone();
        let mut order = vec![0u32; offsets.last().map_or(0, |total| *total as usize)];
        for (number, home) in homes.iter().enumerate().filter(|(_, h)| h.0 != NOBODY) {
            let at = &mut next[home.0 as usize];
            order[*at as usize] = number as u32;
            *at += 1;
        }
        let points: Vec<(Candidate, f32)> = order
            .par_iter()
            .with_min_len(256)
            .map(|&number| {
                let candidate = surface.stand(0, &homes[number as usize].1);
                (candidate, parts[(number / AREA_POINTS) as usize])
            })
            .collect();
        let samples = Self { offsets, points };
        let area = |site| samples.of(site).iter().map(|(_, part)| f64::from(*part)).sum::<f64>() as f32;
        sites.areas = (0..sites.len()).into_par_iter().map(area).collect();
        samples
    }
}

#[derive(Default)]
struct Scratch {
    crowd: Crowd,
    points: Vec<SurfacePoint>,
}

impl Scratch {
    /// A plot's points, each with its site.
    fn serve(
        &mut self,
        sites: &Sites,
        surface: &Surface<'_>,
        plot: &Plot,
        seed: u64,
    ) -> [(u32, Spot); AREA_POINTS as usize] {
        let mut homes = [(NOBODY, Spot::default()); AREA_POINTS as usize];
        self.points.clear();
        for (home, spot) in homes.iter_mut().zip(surface.spots(&plot.piece, AREA_POINTS, seed)) {
            home.1 = spot;
            self.points.push(surface.stand(0, &spot).point);
        }
        self.crowd.gather(sites, plot, &self.points);
        for (home, point) in homes.iter_mut().zip(&self.points) {
            home.0 = self.crowd.nearest(sites, point).map_or(NOBODY, |s| s.0);
        }
        homes
    }
}
