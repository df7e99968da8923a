//! The sites around a plot, laid out to be compared with many points.

use glam::Vec3;

use super::{Plot, REACH, SiteId, Sites};
use crate::geometry::SurfacePoint;

/// Sites compared at a time.
const LANES: usize = 8;

/// Plots with more sites around are long and thin, or crumpled; their points are looked up one by one.
const MOST: usize = 128;

/// A point's nearest site is within this many spacings of its plot, or looked for farther away.
const MARGIN: f32 = 1.3;

/// The sites around a plot.
#[derive(Default)]
pub(super) struct Crowd {
    position: [Vec<f32>; 3],
    normal: [Vec<f32>; 3],
    /// Squared spacing.
    square: Vec<f32>,
    ids: Vec<u32>,
    values: Vec<f32>,
    /// Whatever is as near as this has been gathered.
    margin: f32,
}

impl Crowd {
    /// Gathers the sites around some points of a plot.
    pub(super) fn gather(&mut self, sites: &Sites, plot: &Plot, points: &[SurfacePoint]) {
        self.margin = MARGIN * plot.spacing;
        let low = points.iter().map(|p| p.position).fold(Vec3::INFINITY, Vec3::min) - self.margin;
        let high = points.iter().map(|p| p.position).fold(Vec3::NEG_INFINITY, Vec3::max) + self.margin;
        self.position.iter_mut().chain(&mut self.normal).for_each(Vec::clear);
        self.square.clear();
        self.ids.clear();
        sites.near.within_box(low, high, |near| {
            if self.ids.len() <= MOST && near.position.cmpge(low).all() && near.position.cmple(high).all() {
                self.push(near.position, near.normal, near.spacing, near.id);
            }
        });
        if self.ids.len() > MOST {
            self.margin = 0.0;
        }
        while !self.ids.len().is_multiple_of(LANES) {
            self.push(Vec3::ZERO, Vec3::ZERO, 0.0, u32::MAX);
        }
        self.values.resize(self.ids.len(), 0.0);
    }

    fn push(&mut self, position: Vec3, normal: Vec3, spacing: f32, id: u32) {
        for axis in 0..3 {
            self.position[axis].push(position[axis]);
            self.normal[axis].push(normal[axis]);
        }
        self.square.push(spacing * spacing);
        self.ids.push(id);
    }

    /// What [`Sites::nearest`] says of a point of the plot.
    pub(super) fn nearest(&mut self, sites: &Sites, point: &SurfacePoint) -> Option<SiteId> {
        let mut least = [f32::INFINITY; LANES];
        for first in (0..self.values.len()).step_by(LANES) {
            let values = self.mismatches(first, point);
            for lane in 0..LANES {
                least[lane] = if values[lane] < least[lane] { values[lane] } else { least[lane] };
            }
            self.values[first..first + LANES].copy_from_slice(&values);
        }
        let least = least.into_iter().fold(f32::INFINITY, f32::min);
        if least > self.margin * self.margin || self.margin == 0.0 {
            return sites.nearest(point);
        }
        let ids = self.values.iter().zip(&self.ids).filter(|(v, _)| **v == least).map(|(_, id)| *id);
        ids.min().map(SiteId)
    }

    /// As `Near::mismatch`, of eight sites; infinite for those that do not match.
    #[inline]
    fn mismatches(&self, first: usize, point: &SurfacePoint) -> [f32; LANES] {
        let lanes = |column: &[f32]| -> [f32; LANES] {
            let mut out = [0.0; LANES];
            out.copy_from_slice(&column[first..first + LANES]);
            out
        };
        let [x, y, z] = [0, 1, 2].map(|axis| lanes(&self.position[axis]));
        let [a, b, c] = [0, 1, 2].map(|axis| lanes(&self.normal[axis]));
        let square = lanes(&self.square);
        let ([px, py, pz], [na, nb, nc]) = (point.position.to_array(), point.normal.to_array());
        let mut out = [0.0; LANES];
        for k in 0..LANES {
            let (dx, dy, dz) = (x[k] - px, y[k] - py, z[k] - pz);
            let distance = dx * dx + dy * dy + dz * dz;
            let cosine = a[k] * na + b[k] * nb + c[k] * nc;
            let offset = dx * (a[k] + na) + dy * (b[k] + nb) + dz * (c[k] + nc);
            let value = distance + offset * offset + 4.0 * square[k] * (1.0 - cosine);
            let matches = (distance < REACH * REACH * square[k]) & (cosine > 0.0);
            out[k] = if matches { value } else { f32::INFINITY };
        }
        out
    }
}
