//! Sites of graded spacing: spacing, coverage, areas, grading, look-up, determinism, odd surfaces.

use glam::{DVec3, Vec3};
use glowtree::bake::pipeline::leaf_order;
use glowtree::geometry::SurfacePoint;
use glowtree::geometry::hash::Stream;
use glowtree::geometry::hemisphere::uniform_sphere;
use glowtree::rays::Bvh;
use glowtree::scatter::Candidate;
use glowtree::scatter::surface::Surface;
use glowtree::scene::Scene;
use glowtree::sites::{Plot, REACH, Samples, SiteParams, Sites};
use shapes::{part, points_on, scene};

mod shapes;

/// Two points conflict when closer than the spacing and turned alike by more than this cosine.
const CONFLICT_COSINE: f32 = 0.7;

struct Scattered {
    sites: Sites,
    plots: Vec<Plot>,
    samples: Samples,
    /// Spacing of level 0.
    first: f32,
    /// Area of all sides, squared local units.
    area: f64,
}

fn scatter(scene: &Scene, params: &SiteParams, wanted: impl Fn(&Candidate) -> Option<f32> + Sync) -> Scattered {
    let bvh = Bvh::build(scene);
    let surface = Surface::new(scene, leaf_order(&bvh));
    let (sites, plots, samples) = Sites::scatter(&surface, params, wanted);
    let first = (0.76 * surface.area() / params.coarsest as f64).sqrt() as f32;
    Scattered { sites, plots, samples, first, area: surface.area() }
}

/// A bumpy sphere of 5,120 triangles.
fn bumpy() -> Scene {
    let bump = |v: DVec3| v * (1.0 + 0.15 * (5.0 * v.x).sin() * (4.0 * v.y).cos());
    scene(&[part("bumpy", shapes::icosphere(1.0, 4).mapped(bump), 0.5)])
}

/// Finer towards one end, by a factor of eight over the scene's length of one.
fn graded(at: &Candidate) -> Option<f32> {
    Some(0.008 * 8.0f32.powf(at.point.position.x + 0.5))
}

/// Pairs that are closer than `share` of the spacing of the finer of their levels, and turned alike.
fn conflicts(s: &Scattered, share: f32) -> usize {
    let sites = &s.sites;
    let spacing = |i: usize| share * s.first * 0.5f32.powi(i32::from(sites.levels[i]));
    let pair = |&(i, j): &(usize, usize)| {
        let limit = spacing(i).min(spacing(j));
        sites.positions[i].distance_squared(sites.positions[j]) < limit * limit
            && sites.normals[i].dot(sites.normals[j]) > CONFLICT_COSINE
    };
    (0..sites.len()).flat_map(|i| (0..i).map(move |j| (i, j))).filter(pair).count()
}

/// The share of points without a site within `reach` of the site's spacing that is turned alike.
fn uncovered(sites: &Sites, points: &[SurfacePoint], reach: f32) -> f64 {
    let covers = |p: &SurfacePoint, i: usize| {
        let limit = reach * sites.spacings[i];
        sites.positions[i].distance_squared(p.position) < limit * limit
            && sites.normals[i].dot(p.normal) > CONFLICT_COSINE
    };
    let bare = points.iter().filter(|p| !(0..sites.len()).any(|i| covers(p, i))).count();
    bare as f64 / points.len() as f64
}

#[test]
fn sites_of_a_level_keep_its_spacing() {
    for scene in [bumpy(), scene(&[part("box", shapes::cuboid(DVec3::ZERO, DVec3::new(1.0, 0.6, 0.4), 1), 0.5)])] {
        let s = scatter(&scene, &SiteParams::default(), graded);
        assert!(s.sites.len() > 2000, "only {} sites", s.sites.len());
        assert!(s.sites.level_count() > 3, "only {} levels", s.sites.level_count());
        // Distances are compared as f32 in both places: a rounding of 1e-7 of coordinates near one, over the finest
        // spacing of 5e-3, is 2e-5.
        assert_eq!(conflicts(&s, 1.0 - 1e-4), 0);
        // The test can fail: a tenth more and there are plenty.
        assert!(conflicts(&s, 1.1) > s.sites.len() / 20);
    }
}

#[test]
fn the_surface_is_covered() {
    for (scene, name) in [(bumpy(), "bumpy"), (scene(&[part("square", shapes::quad(DVec3::ZERO, DVec3::X, DVec3::Y, 1), 0.5)]), "square")] {
        let points = points_on(&scene, 0, 4000, 3);
        for (field, wanted) in [("uniform", None), ("graded", Some(()))] {
            let s = scatter(&scene, &SiteParams::default(), |c| wanted.map_or(Some(0.02), |()| graded(c)));
            let (one, more) = (uncovered(&s.sites, &points, 1.0), uncovered(&s.sites, &points, 1.2));
            let density = s.sites.spacings.iter().map(|h| f64::from(h * h)).sum::<f64>() / s.area;
            println!("{name} {field}: {} sites, {density:.3} a squared spacing, beyond 1: {one:.4}, 1.2: {more:.4}", s.sites.len());
        }
    }
}
