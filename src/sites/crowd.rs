//! The sites around a plot, laid out to be compared with many points.

use glam::Vec3;

use super::{Near, Plot, REACH, SiteId, Sites};
use crate::geometry::SurfacePoint;

/// Sites compared at a time.
const LANES: usize = 8;

/// Plots with more sites around are long and thin, or crumpled; their points are looked up one by one.
const MOST: usize = 256;

/// A point's nearest site is within this many spacings of its plot, or looked for farther away.
const MARGIN: f32 = 1.1;

/// Some numbers, eight sites at a time.
type Column = [[f32; LANES]; MOST / LANES];

/// The sites around a plot.
pub(super) struct Crowd {
    position: [Column; 3],
    normal: [Column; 3],
    /// Squared spacing; zero where there is no site.
    square: Column,
    ids: [[u32; LANES]; MOST / LANES],
    values: Column,
    count: usize,
    /// Whatever is as near as this has been gathered.
    margin: f32,
}

impl Default for Crowd {
    fn default() -> Self {
        let zero = [[0.0; LANES]; MOST / LANES];
        Self {
            position: [zero; 3],
            normal: [zero; 3],
            square: zero,
            ids: [[0; LANES]; MOST / LANES],
            values: zero,
            count: 0,
            margin: 0.0,
        }
    }
}

impl Crowd {
    /// Gathers the sites around some points of a plot.
    pub(super) fn gather(&mut self, sites: &Sites, plot: &Plot, points: &[SurfacePoint]) {
        self.margin = MARGIN * plot.spacing;
        let low = points.iter().map(|p| p.position).fold(Vec3::INFINITY, Vec3::min) - self.margin;
        let high = points.iter().map(|p| p.position).fold(Vec3::NEG_INFINITY, Vec3::max) + self.margin;
        let (axis, sine) = cone(points);
        self.count = 0;
        sites.near.within_box(low, high, |near| {
            let p = near.position;
            let inside = (p.x >= low.x) & (p.y >= low.y) & (p.z >= low.z);
            let turned = near.normal.dot(axis) < sine;
            if inside & (p.x <= high.x) & (p.y <= high.y) & (p.z <= high.z) & !turned {
                if self.count < MOST {
                    self.set(self.count, near);
                }
                self.count += 1;
            }
            self.count <= MOST
        });
        if self.count > MOST {
            self.margin = 0.0;
        }
        for k in self.count..self.count.next_multiple_of(LANES).min(MOST) {
            self.square[k / LANES][k % LANES] = 0.0;
        }
    }

    #[inline]
    fn set(&mut self, at: usize, near: &Near) {
        let (group, lane) = (at / LANES, at % LANES);
        for axis in 0..3 {
            self.position[axis][group][lane] = near.position[axis];
            self.normal[axis][group][lane] = near.normal[axis];
        }
        self.square[group][lane] = near.spacing * near.spacing;
        self.ids[group][lane] = near.id;
    }

    /// Whether there are more sites around than can be compared with every point.
    pub(super) fn overflows(&self) -> bool {
        self.count > MOST
    }

    /// What [`Sites::nearest`] says of a point of the plot.
    pub(super) fn nearest(&mut self, sites: &Sites, point: &SurfacePoint) -> Option<SiteId> {
        if self.margin == 0.0 {
            return sites.nearest(point);
        }
        let mut least = [f32::INFINITY; LANES];
        let groups = self.count.div_ceil(LANES);
        for group in 0..groups {
            let values = self.mismatches(group, point);
            for lane in 0..LANES {
                least[lane] = if values[lane] < least[lane] { values[lane] } else { least[lane] };
            }
            self.values[group] = values;
        }
        let least = least.into_iter().fold(f32::INFINITY, |a, b| if b < a { b } else { a });
        if least > self.margin * self.margin {
            return sites.nearest(point);
        }
        let mut id = u32::MAX;
        for (values, ids) in self.values.iter().zip(&self.ids).take(groups) {
            for lane in 0..LANES {
                let candidate = if values[lane] == least { ids[lane] } else { u32::MAX };
                id = id.min(candidate);
            }
        }
        Some(SiteId(id))
    }

    /// As [`Near::mismatch`], of eight sites; infinite for those that do not match.
    #[inline]
    fn mismatches(&self, group: usize, point: &SurfacePoint) -> [f32; LANES] {
        let [x, y, z] = [&self.position[0][group], &self.position[1][group], &self.position[2][group]];
        let [a, b, c] = [&self.normal[0][group], &self.normal[1][group], &self.normal[2][group]];
        let square = &self.square[group];
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

/// The axis of a cone about the points' normals, and a cosine with it below which no normal matches any of them.
fn cone(points: &[SurfacePoint]) -> (Vec3, f32) {
    let axis = points.iter().map(|p| p.normal).sum::<Vec3>().normalize_or_zero();
    let cosine = points.iter().map(|p| p.normal.dot(axis)).fold(1.0, f32::min);
    // A thousandth makes up for rounding: near the axis, cosines hold no angles below 3e-4.
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt() + 1e-3;
    (axis, if cosine > 0.0 { -sine } else { -2.0 })
}
