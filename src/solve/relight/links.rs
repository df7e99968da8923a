//! The rows without their rays' order: each site that a row meets once, with the number of its rays.

use rayon::prelude::*;

use crate::links::receivers::Receivers;
use crate::links::rows::{FIRST_MARK, LOST, SKY};

/// G as the product alone needs it, in memory: links of a receiver and a site, ordered by receiver.
///
/// Memory: 6 B a link, of which there are two to three times fewer than rays.
#[derive(Debug, Clone, Default)]
pub struct Links {
    /// Receivers + 1 offsets.
    offsets: Vec<usize>,
    sites: Vec<u32>,
    /// Rays that met the site.
    counts: Vec<u16>,
    /// Per receiver what multiplies the sum: lost rays count as the mean of those that met known surfaces.
    shares: Vec<f32>,
}

impl Links {
    /// From the rows. Cost: sorting each, some 10 ns a ray.
    pub fn new(receivers: &Receivers) -> Self {
        let row = |r: usize| {
            let (rows, r) = receivers.row(r);
            let met = rows.row(r);
            let mut sites: Vec<u32> = met.iter().copied().filter(|&met| met < FIRST_MARK).collect();
            sites.sort_unstable();
            // Of rays beyond the counter's range there are several links.
            let runs = sites.chunk_by(|a, b| a == b).flat_map(|run| run.chunks(usize::from(u16::MAX)));
            let links: Vec<(u32, u16)> = runs.map(|run| (run[0], run.len() as u16)).collect();
            let known = met.iter().filter(|&&met| met != LOST && met != SKY).count().max(1);
            let arrived = f64::from(rows.rays.saturating_sub(rows.summaries[r].escaped));
            (links, (arrived / (known as f64 * f64::from(rows.rays.max(1)))) as f32)
        };
        let rows: Vec<_> = (0..receivers.len()).into_par_iter().with_min_len(64).map(row).collect();
        let mut all = Self { offsets: vec![0], ..Self::default() };
        for (links, share) in rows {
            all.sites.extend(links.iter().map(|link| link.0));
            all.counts.extend(links.iter().map(|link| link.1));
            all.offsets.push(all.sites.len());
            all.shares.push(share);
        }
        all
    }

    /// The sites that a receiver's row meets, by how many of its rays, and what multiplies the sum of their light.
    #[inline]
    pub(super) fn row(&self, receiver: usize) -> (&[u32], &[u16], f32) {
        let own = self.offsets[receiver]..self.offsets[receiver + 1];
        (&self.sites[own.clone()], &self.counts[own], self.shares[receiver])
    }
}
