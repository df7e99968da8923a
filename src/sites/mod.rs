//! Sites: the points at which light is known, nested in levels, in Morton order.
//!
//! [`Sites::scatter`] throws them over the surfaces, [`neighbours`] links those that see each other, and [`cells`]
//! answers which site stands for the bit of surface that a ray met.

mod candidates;
pub mod cells;
mod darts;
mod grid;
mod levels;
pub mod neighbours;
mod poisson;

use glam::Vec3;

use crate::geometry::SurfacePoint;
use crate::scene::Scene;

pub use cells::{Cells, Ground};
pub use neighbours::Neighbours;

use grid::{Frame, SiteGrid};

/// The index of a site.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SiteId(pub u32);

impl SiteId {
    /// The id as an index into the arrays of [`Sites`].
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// By how much the spacing shrinks from one level to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LevelRatio {
    /// Spacing halves: about four times the sites.
    #[default]
    Two,
    /// Spacing shrinks by √2: about twice the sites.
    RootTwo,
}

impl LevelRatio {
    /// Coarser spacing over finer spacing.
    pub fn factor(self) -> f32 {
        match self {
            Self::Two => 2.0,
            Self::RootTwo => std::f32::consts::SQRT_2,
        }
    }

    /// (coarser spacing / finer spacing)^`steps`, exact for whole powers of two.
    pub fn power(self, steps: u32) -> f32 {
        match self {
            Self::Two => 2f32.powi(steps as i32),
            Self::RootTwo if steps.is_multiple_of(2) => 2f32.powi(steps as i32 / 2),
            Self::RootTwo => 2f32.powi(steps as i32 / 2) * std::f32::consts::SQRT_2,
        }
    }
}

/// What to scatter.
#[derive(Debug, Clone, PartialEq)]
pub struct SiteParams {
    /// Wanted sites on the fronts; the spacing follows as √(0.76 A / count) and about 0.9 of them are reached on smooth
    /// surfaces, more where normals vary below the spacing.
    pub count: usize,
    /// Keys every random number.
    pub seed: u64,
    /// Between one level and the next.
    pub ratio: LevelRatio,
    /// Level 0 has at least about this many sites (and less than ratio² times as many on smooth surfaces).
    pub coarsest: usize,
    /// Candidates thrown per wanted site. Fewer leave gaps, more cost time: 8 covers all but a few per mille of the surface.
    pub candidates_per_site: f32,
}

impl Default for SiteParams {
    fn default() -> Self {
        Self { count: 10_000, seed: 1, ratio: LevelRatio::Two, coarsest: 64, candidates_per_site: 8.0 }
    }
}

/// What [`Sites::scatter`] reached.
#[derive(Debug, Clone, PartialEq)]
pub struct SiteReport {
    /// Sites asked for on the fronts.
    pub wanted_count: usize,
    /// Sites on the fronts.
    pub front_count: usize,
    /// Their copies on the backs of two-sided meshes.
    pub back_count: usize,
    /// Candidates thrown.
    pub candidate_count: usize,
    /// Triangles without area: they carry no sites.
    pub degenerate_count: usize,
    /// Front area, squared local units.
    pub front_area: f64,
    /// How many sites (both sides) take part in each level: prefix sets, root first.
    pub level_counts: Vec<usize>,
    /// Wall time.
    pub elapsed_seconds: f64,
}

/// The plain arrays of [`Sites`], as stored in an archive; see there for each field.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SiteArrays {
    /// See [`Sites::positions`].
    pub positions: Vec<Vec3>,
    /// See [`Sites::normals`].
    pub normals: Vec<Vec3>,
    /// See [`Sites::areas`].
    pub areas: Vec<f32>,
    /// See [`Sites::triangles`].
    pub triangles: Vec<u32>,
    /// See [`Sites::barycentrics`].
    pub barycentrics: Vec<[f32; 2]>,
    /// See [`Sites::levels`].
    pub levels: Vec<u8>,
    /// See [`Sites::front_of`].
    pub front_of: Vec<u32>,
    /// See [`Sites::spacing`].
    pub spacing: f32,
    /// See [`Sites::finest`].
    pub finest: u8,
    /// See [`Sites::ratio`].
    pub ratio: LevelRatio,
    /// See [`Sites::corner`].
    pub corner: Vec3,
}

/// Nested Poisson-disk sites over the surfaces, structure of arrays.
///
/// The sites on the fronts come first, in Morton order of cells of about one spacing; their copies on the backs of
/// two-sided meshes follow, in the same order. Two sites conflict at a spacing when they are closer than it and
/// n·n′ > 0.7; the sites of levels ≤ l are free of conflicts at the spacing of l, and nearly maximal.
pub struct Sites {
    /// Local positions.
    pub positions: Vec<Vec3>,
    /// Unit normals of the sides the sites belong to.
    pub normals: Vec<Vec3>,
    /// Surface area each stands for, squared local units; they sum to the area of all sides that carry sites.
    pub areas: Vec<f32>,
    /// The triangle each lies on.
    pub triangles: Vec<u32>,
    /// Barycentric (u, v) on that triangle.
    pub barycentrics: Vec<[f32; 2]>,
    /// The coarsest level at which each takes part, root = 0.
    pub levels: Vec<u8>,
    /// For each site on a back (site `front_count + i`) the site on the front it mirrors; ascending.
    pub front_of: Vec<u32>,
    /// Poisson spacing of the finest level, local units; level l has spacing · ratio^(finest − l).
    pub spacing: f32,
    /// The finest level.
    pub finest: u8,
    /// Spacing of a level over that of the next finer one.
    pub ratio: LevelRatio,
    /// The corner of the grid whose Morton order the sites are in.
    pub corner: Vec3,
    fronts: SiteGrid,
    backs: SiteGrid,
}

impl Sites {
    /// Scatters sites over the scene's surfaces.
    ///
    /// The result depends on the scene and the parameters alone, to the bit, whatever the number of threads. A scene
    /// without area gets no sites. Cost: about 1–2 CPU-µs a site, and 64 bytes a site of scratch.
    pub fn scatter(scene: &Scene, params: &SiteParams) -> (Self, SiteReport) {
        let started = std::time::Instant::now();
        let (mut arrays, mut report) = poisson::scatter_fronts(scene, params);
        levels::assign(&mut arrays, scene, params.coarsest);
        mirror_backs(&mut arrays, scene);
        let sites = Self::from_arrays(arrays);
        report.back_count = sites.front_of.len();
        report.level_counts = (0..sites.level_count()).map(|l| sites.count_at(l)).collect();
        report.elapsed_seconds = started.elapsed().as_secs_f64();
        (sites, report)
    }

    /// Sites from arrays that [`Sites::to_arrays`] gave, with the look-up grid built anew.
    pub fn from_arrays(arrays: SiteArrays) -> Self {
        let a = arrays;
        let front_count = a.positions.len() - a.front_of.len();
        let frame = Frame::new(a.corner, a.spacing);
        let (fronts, backs) = a.positions.split_at(front_count);
        let fronts = SiteGrid::build(frame, fronts, 0);
        let backs = SiteGrid::build(frame, backs, front_count as u32);
        Self {
            positions: a.positions,
            normals: a.normals,
            areas: a.areas,
            triangles: a.triangles,
            barycentrics: a.barycentrics,
            levels: a.levels,
            front_of: a.front_of,
            spacing: a.spacing,
            finest: a.finest,
            ratio: a.ratio,
            corner: a.corner,
            fronts,
            backs,
        }
    }

    /// The plain arrays, for storage and comparison.
    pub fn to_arrays(&self) -> SiteArrays {
        SiteArrays {
            positions: self.positions.clone(),
            normals: self.normals.clone(),
            areas: self.areas.clone(),
            triangles: self.triangles.clone(),
            barycentrics: self.barycentrics.clone(),
            levels: self.levels.clone(),
            front_of: self.front_of.clone(),
            spacing: self.spacing,
            finest: self.finest,
            ratio: self.ratio,
            corner: self.corner,
        }
    }

    /// How many sites there are, backs included.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is none, as in a scene without area.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// How many lie on fronts; they come first.
    pub fn front_count(&self) -> usize {
        self.positions.len() - self.front_of.len()
    }

    /// Position and normal of a site.
    pub fn point(&self, site: SiteId) -> SurfacePoint {
        SurfacePoint { position: self.positions[site.index()], normal: self.normals[site.index()] }
    }

    /// The site at the same place on the other side, if that side carries sites.
    pub fn twin(&self, site: SiteId) -> Option<SiteId> {
        let front_count = self.front_count();
        if let Some(back) = site.index().checked_sub(front_count) {
            return Some(SiteId(self.front_of[back]));
        }
        self.front_of.binary_search(&site.0).ok().map(|back| SiteId((front_count + back) as u32))
    }

    /// Number of levels.
    pub fn level_count(&self) -> usize {
        usize::from(self.finest) + 1
    }

    /// Poisson spacing of level `level`, local units.
    pub fn level_spacing(&self, level: usize) -> f32 {
        self.spacing * self.ratio.power((usize::from(self.finest) - level) as u32)
    }

    /// How many sites have a level ≤ `level`.
    pub fn count_at(&self, level: usize) -> usize {
        self.levels.iter().filter(|&&l| usize::from(l) <= level).count()
    }

    /// The site that minimises d² + 4h²(1 − n·n′) among those with n·n′ > 0 and d ≤ [`grid::SEARCH_SPACINGS`] h;
    /// ties go to the lower id. No visibility test: [`Cells::represent`] makes one where it is needed.
    pub fn nearest(&self, point: SurfacePoint) -> Option<SiteId> {
        grid::nearest(self, point).map(|(site, _)| site)
    }

    /// Calls `visit` with every site within `radius` ≤ 4 spacings of `position` (and some further ones).
    pub fn visit_near(&self, position: Vec3, radius: f32, mut visit: impl FnMut(SiteId)) {
        let reach = (radius / (self.spacing * grid::CELL_MARGIN)).ceil().clamp(1.0, 4.0) as u32;
        self.fronts.visit(position, reach, |s| visit(SiteId(s)));
        self.backs.visit(position, reach, |s| visit(SiteId(s)));
    }
}

/// Appends the mirrored copies of the sites on two-sided meshes.
fn mirror_backs(arrays: &mut SiteArrays, scene: &Scene) {
    let sides = candidates::Sides::new(scene);
    if !sides.any() {
        return;
    }
    for i in 0..arrays.positions.len() {
        if sides.two_sided(arrays.triangles[i]) {
            arrays.positions.push(arrays.positions[i]);
            arrays.normals.push(-arrays.normals[i]);
            arrays.areas.push(arrays.areas[i]);
            arrays.triangles.push(arrays.triangles[i]);
            arrays.barycentrics.push(arrays.barycentrics[i]);
            arrays.levels.push(arrays.levels[i]);
            arrays.front_of.push(i as u32);
        }
    }
}
