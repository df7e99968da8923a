//! Two resolutions of one scene: near a ray's origin all triangles, in chunks that are mapped when they are touched; beyond,
//! a proxy that is always in memory.
//!
//! This work is based on: Yoon, Lauterbach and Manocha, "R-LODs: Fast LOD-based Ray Tracing of Massive Models", 2006, and
//! Tabellion and Lamorlette, "An Approximate Global Illumination System for Computer Generated Films", SIGGRAPH 2004 (rays
//! of a gather start on the full surface and meet a simplified one). A gather's ray stands for a cone: with N rays to the
//! hemisphere its footprint at distance t is about t √(2π / N) wide, so that surfaces beyond [`REACH_CELLS`] cells of the
//! proxy need no detail below a cell (docs/scaling.md has what that costs).

use std::fmt::Debug;
use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;
use smallvec::SmallVec;

use super::{Bvh, BvhView, Hit, LANES, NO_TRIANGLE, Ray};
use crate::error::{Error, Result};
use crate::geometry::{LIFT, triangle};

/// All triangles answer up to this many cells of the proxy from a ray's origin.
pub const REACH_CELLS: f32 = 16.0;

/// The proxy begins to answer this many cells before the end of that reach: a ray that leaves the full surface between both
/// must not slip under the proxy's.
const OVERLAP_CELLS: f32 = 2.0;

/// The full surface and its proxy are looked for within this many cells of each other: close by first, which keeps other
/// surfaces that are near out of the way.
const APART_CELLS: [f32; 3] = [0.4, 1.0, 2.0];

/// Surfaces closer to each other than this many cells are not told apart by their proxies.
const TIGHT_CELLS: f32 = 2.0;

/// Boxes of the table that tells which chunks are near, along each axis.
const TABLE: usize = 48;

/// Chunks of triangles, each with a hierarchy whose triangles are numbered by their places ([`Bvh::number_by_place`]).
pub trait Chunks: Debug + Send + Sync {
    /// A chunk's hierarchy; None when it cannot be read, which the owner remembers as an error.
    fn view(&self, chunk: usize) -> Option<BvhView<'_>>;

    /// The first error that kept a chunk from being read, once.
    fn failure(&self) -> Option<Error>;
}

/// What answers near a ray's origin.
#[derive(Debug)]
pub struct Near {
    chunks: Box<dyn Chunks>,
    boxes: Vec<[Vec3; 2]>,
    /// Triangles that are in the scene as they are.
    resident: Bvh,
    /// By place, their numbers there.
    numbers: Vec<u32>,
    /// Edge of the proxy's cells, local units.
    cell: f32,
    table: Table,
}

/// A surface that was met, in full resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Met {
    /// Distance along the ray, local units.
    pub distance: f32,
    /// Unit normal of the side that the ray came from.
    pub normal: Vec3,
    /// What of the scene's own triangles is there, at that distance: None where the proxy has lost the place.
    pub hit: Option<Hit>,
}

impl Near {
    /// Over chunks within these boxes of local space, and the triangles that the scene holds as they are: their hierarchy,
    /// numbered by places, and by place their numbers in the scene.
    pub fn new(
        (chunks, boxes): (Box<dyn Chunks>, Vec<[Vec3; 2]>),
        (resident, numbers): (Bvh, Vec<u32>),
        cell: f32,
    ) -> Self {
        let table = Table::new(&boxes, REACH_CELLS * cell);
        Self { chunks, boxes, resident, numbers, cell, table }
    }

    /// Reads all chunks once, so that those that are damaged are known and no ray waits for the checks.
    pub fn touch(&self) {
        (0..self.boxes.len()).into_par_iter().for_each(|chunk| {
            // What cannot be read is remembered as a failure.
            let _ = self.chunks.view(chunk);
        });
    }

    /// Edge of the proxy's cells, local units.
    pub fn cell(&self) -> f32 {
        self.cell
    }

    /// Where full resolution ends, as a distance from a ray's origin, local units.
    pub fn reach(&self) -> f32 {
        REACH_CELLS * self.cell
    }

    /// How far the full surface and its proxy are looked for from each other, local units.
    pub fn apart(&self) -> f32 {
        APART_CELLS[APART_CELLS.len() - 1] * self.cell
    }

    /// The nearest of all triangles within reach; `far` names what of the proxy it is.
    fn closest(&self, far: BvhView<'_>, ray: &Ray) -> Option<Met> {
        let mut ray = Ray { t_max: ray.t_max.min(self.reach()), ..*ray };
        let resident = self.resident.closest(&ray);
        ray.t_max = resident.map_or(ray.t_max, |hit| hit.distance);
        let mut best = None;
        for chunk in self.around(&ray) {
            if let Some(view) = self.chunks.view(chunk)
                && let Some(hit) = view.closest(&ray)
            {
                ray.t_max = hit.distance;
                best = Some((view, hit));
            }
        }
        if let Some((view, hit)) = best {
            let normal = facing(view.normal_at(hit.triangle), &ray);
            let at = ray.origin + ray.direction * hit.distance;
            let named = self.beside(far, at, normal);
            let hit_there = named.map(|named| Hit { distance: hit.distance, ..named });
            return Some(Met { distance: hit.distance, normal, hit: hit_there });
        }
        resident.map(|hit| {
            let normal = facing(self.resident.view().normal_at(hit.triangle), &ray);
            let hit_there = Hit { triangle: self.numbers[hit.triangle as usize], ..hit };
            Met { distance: hit.distance, normal, hit: Some(hit_there) }
        })
    }

    /// What of the proxy lies next to a point of the full surface, along its normal, met from the side that the normal points
    /// to.
    fn beside(&self, far: BvhView<'_>, at: Vec3, normal: Vec3) -> Option<Hit> {
        let mut clear = f32::INFINITY;
        for (k, cells) in APART_CELLS.into_iter().enumerate() {
            if k == 1 {
                // What stands before the surface must not be taken for it.
                let out = Ray { t_max: self.reach(), ..Ray::new(at + normal * LIFT, normal) };
                clear = self.meets(&out).map_or(f32::INFINITY, |(distance, _)| distance);
            }
            let lift = (cells * self.cell).min(0.5 * clear);
            let down = Ray {
                origin: at + normal * lift,
                direction: -normal,
                t_min: 0.0,
                t_max: lift + cells * self.cell,
            };
            if let Some(hit) = far.closest(&down) {
                return Some(hit);
            }
        }
        None
    }

    /// How far the nearest of all triangles within reach is, and whether it turns its back.
    fn meets(&self, ray: &Ray) -> Option<(f32, bool)> {
        let mut ray = Ray { t_max: ray.t_max.min(self.reach()), ..*ray };
        let mut nearest = self.resident.closest(&ray).map(|hit| (hit.distance, hit.back));
        for chunk in self.around(&ray) {
            ray.t_max = nearest.map_or(ray.t_max, |(distance, _)| distance);
            let hit = self.chunks.view(chunk).and_then(|view| view.closest(&ray));
            nearest = hit.map(|hit| (hit.distance, hit.back)).or(nearest);
        }
        nearest
    }

    /// Whether any of all triangles within reach lies on the segment.
    fn occluded(&self, ray: &Ray) -> bool {
        let ray = Ray { t_max: ray.t_max.min(self.reach()), ..*ray };
        let blocks = |chunk| self.chunks.view(chunk).is_some_and(|view| view.occluded(&ray));
        self.resident.occluded(&ray) || self.around(&ray).any(blocks)
    }

    /// The chunks whose boxes a ray of at most the reach meets.
    fn around<'a>(&'a self, ray: &Ray) -> impl Iterator<Item = usize> + use<'a> {
        let (origin, t_min, t_max) = (ray.origin, ray.t_min, ray.t_max);
        let inverse = ray.direction.recip();
        self.table.at(origin).iter().map(|&chunk| chunk as usize).filter(move |&chunk| {
            let [low, high] = self.boxes[chunk];
            let (a, b) = ((low - origin) * inverse, (high - origin) * inverse);
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
            // Rounding may not lose a box; a direction within a face gives NaN, which excludes nothing.
            let slack = 1.0e-6 + 1.0e-5 * leave.abs();
            !(enter > leave + slack || enter > t_max + slack || leave < t_min - slack)
        })
    }
}

/// The normal turned to the side that a ray comes from.
fn facing(normal: Vec3, ray: &Ray) -> Vec3 {
    if normal.dot(ray.direction) > 0.0 { -normal } else { normal }
}

impl Bvh {
    /// Puts full resolution, if there is any, before this hierarchy, which becomes the proxy.
    #[must_use]
    pub fn with_near(self, near: Option<Arc<Near>>) -> Self {
        Self { near, ..self }
    }

    /// This hierarchy alone, and what was before it.
    #[must_use]
    pub fn without_near(mut self) -> (Self, Option<Arc<Near>>) {
        let near = self.near.take();
        (self, near)
    }

    /// Puts what answers near rays' origins in the place of what did, and gives that back.
    pub fn swap_near(&mut self, near: Option<Arc<Near>>) -> Option<Arc<Near>> {
        std::mem::replace(&mut self.near, near)
    }

    /// What answers near rays' origins, if that is more than this hierarchy.
    pub fn near(&self) -> Option<&Near> {
        self.near.as_deref()
    }

    /// Errors when some of the full resolution could not be read: what was traced since is not to be used.
    ///
    /// # Errors
    /// What the reader of the chunks found.
    pub fn sound(&self) -> Result<()> {
        self.near().and_then(|near| near.chunks.failure()).map_or(Ok(()), Err)
    }

    /// How far what this hierarchy holds may lie from the surface, local units: zero without a nearer resolution.
    pub fn blur(&self) -> f32 {
        self.near().map_or(0.0, Near::cell)
    }

    /// The nearest hit of a ray that starts on the full surface: full resolution near its origin, the proxy beyond. The
    /// distance, and what of the scene's triangles was met; None where the proxy has lost it.
    pub fn closest_fine(&self, ray: &Ray) -> Option<(f32, Option<Hit>)> {
        let whole = |hit: Hit| (hit.distance, Some(hit));
        let Some(near) = self.near() else { return self.closest(ray).map(whole) };
        if let Some(met) = near.closest(self.view(), ray) {
            return Some((met.distance, met.hit));
        }
        self.closest(&beyond(near, ray)?).map(whole)
    }

    /// Whether anything lies on a segment that starts on the full surface.
    pub fn occluded_fine(&self, ray: &Ray) -> bool {
        let Some(near) = self.near() else { return self.occluded(ray) };
        near.occluded(ray) || beyond(near, ray).is_some_and(|far| self.occluded(&far))
    }

    /// What of this hierarchy lies next to a point of the full surface; None without a nearer resolution.
    pub fn beside(&self, at: Vec3, normal: Vec3) -> Option<Hit> {
        self.near()?.beside(self.view(), at, normal)
    }

    /// Whether something stands so close before a point of the full surface that the proxy cannot tell the two apart.
    pub fn is_tight(&self, at: Vec3, normal: Vec3) -> bool {
        let Some(near) = self.near() else { return false };
        let out = Ray { t_max: TIGHT_CELLS * near.cell, ..Ray::new(at + normal * LIFT, normal) };
        near.occluded(&out)
    }

    /// Whether a point of the full surface looks at something close, as [`Bvh::is_tight`] has it, or at the back of anything,
    /// as those do that lie within another body.
    pub fn is_hidden(&self, at: Vec3, normal: Vec3) -> bool {
        let Some(near) = self.near() else { return false };
        let out = Ray::new(at + normal * LIFT, normal);
        match near.meets(&out) {
            Some((distance, back)) => back || distance < TIGHT_CELLS * near.cell,
            None => beyond(near, &out).and_then(|far| self.closest(&far)).is_some_and(|hit| hit.back),
        }
    }

    /// The full surface where a ray from anywhere meets the proxy first. None without a nearer resolution, and where
    /// nothing of the full surface is next to the proxy.
    pub fn surface(&self, ray: &Ray) -> Option<Met> {
        let near = self.near()?;
        let apart = near.apart();
        let about = self.closest(ray)?.distance;
        let start = (about - apart).max(ray.t_min);
        let look = Ray {
            origin: ray.origin + ray.direction * start,
            t_min: 0.0,
            t_max: (about + apart).min(ray.t_max) - start,
            ..*ray
        };
        let met = near.closest(self.view(), &look)?;
        let distance = met.distance + start;
        Some(Met { distance, hit: met.hit.map(|hit| Hit { distance, ..hit }), ..met })
    }

    /// Numbers the triangles anew, each by its place: packet · 4 + lane. Returns by place the numbers they had.
    pub fn number_by_place(&mut self) -> Vec<u32> {
        let packets = self.packets.slice_mut();
        let mut numbers = Vec::with_capacity(LANES * packets.len());
        for packet in packets {
            for number in &mut packet.triangle {
                let place = numbers.len() as u32;
                numbers.push(*number);
                if *number != NO_TRIANGLE {
                    *number = place;
                }
            }
        }
        numbers
    }
}

/// What of a ray lies beyond the full resolution's reach.
fn beyond(near: &Near, ray: &Ray) -> Option<Ray> {
    let start = near.reach() - OVERLAP_CELLS * near.cell;
    (ray.t_max > near.reach()).then(|| Ray { t_min: ray.t_min.max(start), ..*ray })
}

impl BvhView<'_> {
    /// The unit normal of a triangle that is numbered by its place; zero for a place that there is not.
    pub fn normal_at(&self, place: u32) -> Vec3 {
        let Some(packet) = self.packets.get(place as usize / LANES) else { return Vec3::ZERO };
        let lane = place as usize % LANES;
        triangle::normal(packet.corners.map(|corner| Vec3::from_array(corner.map(|axis| axis[lane]))))
    }
}

/// Which chunks are within reach of the boxes of a grid over the local unit cube.
#[derive(Debug)]
struct Table {
    starts: Vec<u32>,
    chunks: Vec<u32>,
}

impl Table {
    fn new(boxes: &[[Vec3; 2]], reach: f32) -> Self {
        let mut lists = vec![SmallVec::<[u32; 4]>::new(); TABLE * TABLE * TABLE];
        for (chunk, [low, high]) in boxes.iter().enumerate() {
            let (from, to) = (place(*low - reach), place(*high + reach));
            for z in from[2]..=to[2] {
                for y in from[1]..=to[1] {
                    for x in from[0]..=to[0] {
                        lists[(z * TABLE + y) * TABLE + x].push(chunk as u32);
                    }
                }
            }
        }
        let mut table = Self { starts: vec![0], chunks: Vec::new() };
        for list in lists {
            table.chunks.extend_from_slice(&list);
            table.starts.push(table.chunks.len() as u32);
        }
        table
    }

    fn at(&self, point: Vec3) -> &[u32] {
        let [x, y, z] = place(point);
        let at = (z * TABLE + y) * TABLE + x;
        &self.chunks[self.starts[at] as usize..self.starts[at + 1] as usize]
    }
}

/// The box of the grid that holds a point of the local unit cube, [−½, ½]³; points outside belong to the nearest.
fn place(point: Vec3) -> [usize; 3] {
    // Casts saturate.
    ((point + 0.5) * TABLE as f32).to_array().map(|v| (v as usize).min(TABLE - 1))
}
