//! A bake under way: its receivers may still be split.

pub mod alone;
pub mod grading;
pub mod refine;
pub mod switched;

use glam::Vec3;
use rayon::prelude::*;

use crate::archive::{Ledger, One, Tag};
use crate::bake::laws::Plan;
use crate::bake::model::materials;
use crate::bake::relight::mixture::Mixture;
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::links::Surroundings;
use crate::links::direct::{Direct, DirectParams, LampLink};
use crate::links::lamps::Lamp;
use crate::links::receivers::Receivers;
use crate::links::spread::Spread;
use crate::rays::Bvh;
use crate::scatter::Candidate;
use crate::scatter::surface::Surface;
use crate::scene::Scene;
use crate::sites::{Cells, Neighbours, Plot, Samples, SiteId, SiteParams, Sites};
use crate::solve::field::{self, Smooth};
use crate::solve::{Field, Problem, Solution};

/// What stays fixed all along.
#[derive(Clone, Copy)]
pub struct Grounds<'a> {
    /// Triangles, materials and lights.
    pub scene: &'a Scene,
    /// The ray engine.
    pub bvh: &'a Bvh,
    /// The surface in its spatial order.
    pub surface: &'a Surface<'a>,
    /// Lights aimed at.
    pub lamps: &'a [Lamp],
    /// Per mesh, whether rows meet its emission.
    pub glowing: &'a [bool],
}

/// Sites, what they are made of and what light the lamps send them.
pub struct Layout {
    /// Where radiosity is known.
    pub sites: Sites,
    /// Which sites see each other.
    pub graph: Neighbours,
    /// Which site speaks for which bit of surface.
    pub cells: Cells,
    /// How the surface was served.
    pub plots: Vec<Plot>,
    /// Albedo per site.
    pub albedo: Vec<Rgb>,
    /// Exitance per site where rows meet it.
    pub exitance: Vec<Rgb>,
    /// Mean point and mean normal of the surface that each site stands for.
    pub means: Vec<SurfacePoint>,
    /// Lamp links.
    pub direct: Direct,
    /// Which meshes each site stands for, where lights are to be known one by one.
    pub mixture: Option<Mixture>,
    /// Rays traced.
    pub rays: u64,
}

impl Layout {
    /// Lays sites out by a spacing and looks at the lamps from them.
    ///
    /// # Errors
    /// The ledger's.
    pub fn new(
        grounds: Grounds<'_>,
        plan: &Plan,
        (params, heard): (&SiteParams, &[Candidate]),
        spacing: impl Fn(&Candidate) -> Option<f32> + Sync,
        ledger: &Ledger<'_>,
    ) -> Result<Self> {
        let Grounds { scene, bvh, surface, lamps, glowing } = grounds;
        let (arrays, plots) = ledger.keep(Tag::new("sites"), 0..0, || {
            let (arrays, plots) = Sites::grow(surface, params, heard, spacing);
            // Who asks to stop got no sites.
            ledger.pause()?;
            Ok((arrays, plots.iter().map(Plot::to_words).collect::<Vec<_>>()))
        })?;
        let plots: Vec<Plot> = plots.iter().map(Plot::from_words).collect();
        let (sites, samples) = Sites::settle(arrays, surface, &plots, params.seed);
        let all = 0..sites.len() as u64;
        let (starts, targets, unclean, One(linked)) = ledger.keep(Tag::new("graph"), all, || {
            let (graph, report) = Neighbours::link(&sites, bvh);
            let (starts, targets, unclean) = graph.to_arrays();
            Ok((starts.to_vec(), targets.to_vec(), unclean, One(report.ray_count as u64)))
        })?;
        let graph = Neighbours::from_arrays(starts, targets, &unclean);
        let cells = Cells::new(surface, &plots);
        let means = means(&sites, &samples);
        let (albedo, exitance) = materials(scene, &sites, &samples, glowing);
        let around = Surroundings { scene, bvh, sites: &sites, graph: &graph, cells: &cells };
        let (direct, looked) = look(around, (&samples, lamps), &plan.direct, ledger)?;
        let mixture = plan.relightable.then(|| Mixture::new(scene, &sites, &samples));
        let rays = linked + looked;
        Ok(Self { sites, graph, cells, plots, albedo, exitance, means, direct, mixture, rays })
    }

    /// The rays' world.
    pub fn around<'a>(&'a self, grounds: Grounds<'a>) -> Surroundings<'a> {
        let (sites, graph, cells) = (&self.sites, &self.graph, &self.cells);
        Surroundings { scene: grounds.scene, bvh: grounds.bvh, sites, graph, cells }
    }
}

/// Looks at the lamps from every site, as one block; also says how many rays that took.
///
/// # Errors
/// The ledger's.
pub fn look(
    around: Surroundings<'_>,
    (samples, lamps): (&Samples, &[Lamp]),
    params: &DirectParams,
    ledger: &Ledger<'_>,
) -> Result<(Direct, u64)> {
    let all = 0..around.sites.len() as u64;
    let (offsets, clusters, factors, One(rays)) = ledger.keep(Tag::new("lamps"), all, || {
        let direct = Direct::look(around, samples, lamps, params);
        let (clusters, factors): (Vec<u32>, Vec<[f32; 2]>) =
            direct.links.iter().map(LampLink::to_words).unzip();
        Ok((direct.offsets, clusters, factors, One(direct.rays)))
    })?;
    let links = clusters.iter().zip(&factors).map(LampLink::from_words).collect();
    let direct = Direct { rays, ..Direct::from_links(around.scene, lamps, (offsets, links)) };
    Ok((direct, rays))
}

fn means(sites: &Sites, samples: &Samples) -> Vec<SurfacePoint> {
    let mean = |s: usize| {
        let own = sites.point(SiteId(s as u32));
        let (mut position, mut normal, mut area) = (Vec3::ZERO, Vec3::ZERO, 0.0);
        for (sample, part) in samples.of(s) {
            position += sample.point.position * *part;
            normal += sample.point.normal * *part;
            area += part;
        }
        if area > 0.0 { SurfacePoint { position: position / area, normal: normal / area } } else { own }
    };
    (0..sites.len()).into_par_iter().with_min_len(256).map(mean).collect()
}

/// All that a bake changes on its way.
pub struct Work<'a> {
    /// What it does not change.
    pub grounds: Grounds<'a>,
    /// Sites.
    pub layout: Layout,
    /// Receivers and their rows.
    pub receivers: Receivers,
    /// Interpolation to sites.
    pub spread: Spread,
    /// The light.
    pub solution: Solution,
}

impl Work<'_> {
    /// What there is to solve.
    pub fn problem(&self) -> Problem<'_> {
        Problem {
            around: self.layout.around(self.grounds),
            receivers: &self.receivers,
            spread: &self.spread,
            lamps: self.grounds.lamps,
            direct: &self.layout.direct,
            albedo: &self.layout.albedo,
            exitance: &self.layout.exitance,
            sky: self.layout.direct.sky.as_ref(),
        }
    }

    /// The function of a global basis.
    pub fn smooth(&self) -> Option<Smooth> {
        let basis = self.spread.basis;
        basis.is_global().then(|| field::smooth(basis, &self.receivers, &self.solution))
    }

    /// The solution, ready to answer. `smooth` is that of now.
    pub fn field<'a>(&'a self, plan: &Plan, smooth: &'a Option<Smooth>) -> Field<'a> {
        let smooth = smooth.as_ref().map(AsRef::as_ref);
        Field { problem: self.problem(), solution: &self.solution, params: plan.field(), smooth, judge: None }
    }

    /// The largest albedo channel of any site.
    pub fn largest_albedo(&self) -> f32 {
        self.layout.albedo.iter().map(|a| a.max_element()).fold(0.0, f32::max)
    }
}
