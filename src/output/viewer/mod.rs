//! A page that shows the light in a browser: one file without network, whose shader adds the lights up, so that each can
//! be dimmed and coloured while one looks.
//!
//! Light adds up: B = Σ w (e + ρ H / π), with a weight w of three channels for each light. The page holds the albedo ρ and
//! each light's irradiance H at every vertex as textures; moving a slider changes w, some bytes a light, and nothing else.

mod encode;
mod hidden;
pub mod mesh;
mod page;

use crate::light::Rgb;
use crate::output::picture::View;
use crate::scene::Scene;
use crate::sites::Sites;

pub use encode::Layer;
pub use hidden::Seams;
pub use mesh::ViewMesh;
pub use page::{served, write};

/// Vertices that a scene of few is cut to: two pixels apart on a wall that fills the screen.
pub const VERTICES: usize = 200_000;

/// Sites that are shown at the most, those of the coarse levels first: more are no longer told apart.
pub const MOST_SITES: usize = 300_000;

/// Places of a turned sky that a page holds, so far as its vertices are few: the waves of light over a turn up to the fourth.
const MOST_TURNS: usize = 9;

/// Colours of turned skies in a page at the most: 32 MiB.
const TURNED_COLOURS: usize = 8 << 20;

/// Into how many parts a turn of the sky is cut for a page of so many vertices: odd; 1 where there is no room.
pub fn turns(vertices: usize) -> usize {
    let room = TURNED_COLOURS / vertices.max(1);
    (room / 2 * 2 + 1).min(MOST_TURNS)
}

/// One light, by what it does at the vertices of a [`ViewMesh`].
#[derive(Debug, Clone)]
pub struct ViewLight {
    /// The slider's label.
    pub name: String,
    /// What falls on each vertex at weight 1 by this light alone, all bounces together, W·m⁻².
    pub irradiance: Vec<Rgb>,
    /// For a sky that may be turned: the same with the sky turned about the scene's up by each multiple but 0 of equal parts of a
    /// full turn, an even number; else nothing.
    pub turned: Vec<Vec<Rgb>>,
    /// The meshes of the scene whose own radiance is this light's.
    pub glowing: Vec<u32>,
    /// Whether the sky behind the scene is this light's.
    pub is_sky: bool,
}

impl ViewLight {
    fn all(&self) -> impl Iterator<Item = &[Rgb]> {
        [&self.irradiance].into_iter().chain(&self.turned).map(Vec::as_slice)
    }

    fn all_mut(&mut self) -> impl Iterator<Item = &mut Vec<Rgb>> {
        [&mut self.irradiance].into_iter().chain(&mut self.turned)
    }
}

/// What is known at the vertices of a [`ViewMesh`].
#[derive(Debug, Clone)]
pub struct Lit {
    /// The lights, in the order of their sliders; the picture at weights 1 is their sum.
    pub lights: Vec<ViewLight>,
    /// Cosine-weighted share of the sky that each vertex sees, in [0, 1].
    pub ambient: Vec<f32>,
    /// Estimated standard error of the mean-channel irradiance at each, W·m⁻².
    pub error: Vec<f32>,
}

/// A site as a dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dot {
    /// Local position, lifted off the surface by a tenth of the spacing.
    pub position: [f32; 3],
    /// Level, root = 0.
    pub level: f32,
    /// Poisson spacing, local units.
    pub spacing: f32,
}

/// The sites as dots: the first [`MOST_SITES`] by level.
pub fn dots(sites: &Sites) -> Vec<Dot> {
    let mut order: Vec<usize> = (0..sites.len()).collect();
    order.sort_by_key(|&k| sites.levels[k]);
    order.truncate(MOST_SITES);
    let dot = |k: usize| Dot {
        position: (sites.positions[k] + 0.1 * sites.spacings[k] * sites.normals[k]).to_array(),
        level: f32::from(sites.levels[k]),
        spacing: sites.spacings[k],
    };
    order.into_iter().map(dot).collect()
}

/// Everything that the page shows.
pub struct Picture<'a> {
    /// The page's title.
    pub title: String,
    /// Whose materials and sky are shown.
    pub scene: &'a Scene,
    /// Vertices and triangles.
    pub mesh: ViewMesh,
    /// Light at the vertices.
    pub lit: Lit,
    /// The sites.
    pub dots: Vec<Dot>,
    /// Where the page looks from at first.
    pub view: View,
    /// The factor from radiance to the display's linear range that the page begins with.
    pub exposure: f32,
    /// Mean irradiance that errors are shown relative to, W·m⁻².
    pub level: f32,
}

impl Picture<'_> {
    /// Gives vertices without light the mean of their neighbours' that have some: those under what stands on a surface would
    /// darken it as far as the next vertex.
    pub fn lighten_hidden(&mut self) {
        let lights: Vec<&[Rgb]> = self.lit.lights.iter().flat_map(ViewLight::all).collect();
        let seams = Seams::new(&self.mesh, &lights, self.level);
        self.lit.lights.iter_mut().flat_map(ViewLight::all_mut).for_each(|light| seams.lighten(light));
    }
}

impl Lit {
    /// Leaves out the turned triangles of two-sided meshes whose corners no light reaches, as within a solid: their other
    /// side's back is black, as it would be. `scene` tells which meshes glow.
    pub fn drop_dark_backs(&mut self, mesh: &mut ViewMesh, scene: &Scene) {
        let dark = |v: u32| {
            let v = v as usize;
            let unlit = self.lights.iter().flat_map(ViewLight::all).all(|h| h[v].max_element() <= 0.0);
            unlit && scene.meshes[mesh.meshes[v] as usize].radiance == Rgb::ZERO
        };
        // Fronts and backs take turns.
        let (mut kept, mut alone) = (Vec::new(), Vec::new());
        for pair in mesh.two_sided.chunks_exact(2) {
            match [0, 1].map(|side| pair[side].iter().all(|&v| dark(v))) {
                [_, true] => alone.push(pair[0]),
                [true, false] => alone.push(pair[1]),
                [false, false] => kept.extend_from_slice(pair),
            }
        }
        mesh.two_sided = kept;
        mesh.one_sided.extend(alone);
        self.drop_unused(mesh);
    }

    /// Leaves out the vertices that no triangle uses.
    fn drop_unused(&mut self, mesh: &mut ViewMesh) {
        let mut used = vec![false; mesh.points.len()];
        let triangles = mesh.one_sided.iter().chain(&mesh.two_sided);
        triangles.flatten().for_each(|&v| used[v as usize] = true);
        let mut next = 0;
        let place: Vec<u32> = used.iter().map(|&used| (next, next += u32::from(used)).0).collect();
        for triangle in mesh.one_sided.iter_mut().chain(&mut mesh.two_sided) {
            *triangle = triangle.map(|v| place[v as usize]);
        }
        keep(&mut mesh.points, &used);
        keep(&mut mesh.asked, &used);
        keep(&mut mesh.albedo, &used);
        keep(&mut mesh.meshes, &used);
        keep(&mut self.ambient, &used);
        keep(&mut self.error, &used);
        self.lights.iter_mut().flat_map(ViewLight::all_mut).for_each(|light| keep(light, &used));
    }
}

/// Keeps the values whose place is used.
fn keep<T>(values: &mut Vec<T>, used: &[bool]) {
    let mut used = used.iter();
    values.retain(|_| used.next().is_some_and(|&used| used));
}
