//! Shoots a camera's rays and shades what they meet.
//!
//! This work is based on: Ernst, Stamminger and Greiner, "Filter Importance Sampling", IEEE Symposium on Interactive Ray
//! Tracing 2006: samples are placed by the reconstruction filter (a tent of one pixel's radius), so that each weighs the
//! same and pixels do not depend on each other. Visibility, albedo and emission are found per sample; irradiance, which
//! costs more and varies less, once per cell of the pixel and surface.

use glam::Vec3;
use rayon::prelude::*;

use super::camera::Pinhole;
use super::film::{Film, Pixel};
use super::framing::View;
use crate::error::Result;
use crate::geometry::{SurfacePoint, hash, triangle};
use crate::light::Rgb;
use crate::output::normals::{Weight, smooth_normal, vertex_normals};
use crate::output::{Advance, Evaluate};
use crate::rays::{Bvh, Hit, Ray};
use crate::scene::Scene;

/// Pixels along the edge of a tile: 1,024 pixels give the evaluation a batch worth its overhead and still spread a small
/// picture over many threads.
const TILE: u32 = 32;

/// Layers of backs that a see-through view looks through before it gives up.
const THROUGH_LIMIT: u32 = 64;

/// How well a picture is sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quality {
    /// Rays per pixel across (their number is the square).
    pub rays_across: u32,
    /// Irradiance evaluations per pixel and surface across, at the most `rays_across`.
    pub lights_across: u32,
}

impl Quality {
    /// 9 rays and one evaluation: the picture that a bake leaves behind.
    pub const PREVIEW: Self = Self { rays_across: 3, lights_across: 1 };
    /// 16 rays and four evaluations: sharp shadows are smoothed too.
    pub const FINE: Self = Self { rays_across: 4, lights_across: 2 };
}

/// What one ray met.
struct Sample {
    pixel: usize,
    cell: u32,
    mesh: usize,
    point: SurfacePoint,
    albedo: Rgb,
    emitted: Rgb,
    depth: f32,
    /// Where its irradiance is among the tile's evaluations; none for black backs.
    light: Option<usize>,
}

/// Everything a tile needs.
struct Renderer<'a> {
    scene: &'a Scene,
    bvh: &'a Bvh,
    evaluate: &'a Evaluate<'a>,
    normals: Vec<Vec3>,
    pinhole: Pinhole,
    see_through: bool,
    quality: Quality,
    width: u32,
    height: u32,
}

/// The picture that a view sees. Depth comes in world units, directions in scene axes. `advance` counts pixels.
///
/// Deterministic: a pixel depends on the scene, the view and the quality alone.
///
/// # Errors
/// A camera without extent, or what `advance` says.
pub fn render(
    scene: &Scene,
    bvh: &Bvh,
    evaluate: &Evaluate<'_>,
    (view, quality): (&View, Quality),
    advance: &Advance<'_>,
) -> Result<Film> {
    let [width, height] = view.camera.size;
    let renderer = Renderer {
        scene,
        bvh,
        evaluate,
        normals: vertex_normals(scene, Weight::Angle),
        pinhole: Pinhole::new(&view.camera)?,
        see_through: view.see_through,
        quality,
        width,
        height,
    };
    let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
    let tiles: Vec<[u32; 2]> =
        (0..columns * rows).map(|i| [i % columns * TILE, i / columns * TILE]).collect();
    let shaded: Vec<Vec<Pixel>> = tiles
        .par_iter()
        .map(|&corner| {
            let pixels = renderer.tile(corner);
            advance(pixels.len() as u64).map(|()| pixels)
        })
        .collect::<Result<_>>()?;
    let mut film = Film { width, height, pixels: vec![Pixel::default(); width as usize * height as usize] };
    for (corner, pixels) in tiles.iter().zip(&shaded) {
        let across = renderer.extent(*corner)[0] as usize;
        for (row, line) in pixels.chunks(across).enumerate() {
            let start = (corner[1] as usize + row) * width as usize + corner[0] as usize;
            film.pixels[start..start + across].copy_from_slice(line);
        }
    }
    Ok(film)
}

impl Renderer<'_> {
    /// Columns and rows of the tile at `corner`.
    fn extent(&self, corner: [u32; 2]) -> [u32; 2] {
        [TILE.min(self.width - corner[0]), TILE.min(self.height - corner[1])]
    }

    /// The finished pixels of one tile, row by row.
    fn tile(&self, corner: [u32; 2]) -> Vec<Pixel> {
        let [across, down] = self.extent(corner);
        let mut sums = vec![Pixel::default(); (across * down) as usize];
        let mut samples = Vec::new();
        let mut points = Vec::new();
        for pixel in 0..across * down {
            let first = samples.len();
            let at = [corner[0] + pixel % across, corner[1] + pixel / across];
            self.shoot(at, pixel as usize, &mut samples, &mut sums[pixel as usize]);
            self.share_lights(&mut samples[first..], &mut points);
        }
        let lights = (self.evaluate)(&points);
        assert_eq!(lights.len(), points.len(), "one irradiance per point");
        for sample in &samples {
            let reflected = sample.albedo / std::f32::consts::PI;
            let light = sample.light.map(|k| lights[k]);
            let direct = light.map_or(Vec3::ZERO, |l| reflected * l.direct);
            sums[sample.pixel].add(&Pixel {
                direct: direct + sample.emitted,
                indirect: light.map_or(Vec3::ZERO, |l| reflected * l.indirect),
                albedo: sample.albedo,
                normal: sample.point.normal,
                depth: sample.depth * self.scene.placement.scale as f32,
                error: light.map_or(0.0, |l| crate::light::mean_channel(reflected) * l.error),
                coverage: 1.0,
            });
        }
        let count = self.quality.rays_across.pow(2);
        sums.iter().map(|sum| sum.resolve(count)).collect()
    }

    /// Shoots one pixel's rays; what meets nothing adds the sky to `sum`.
    fn shoot(&self, at: [u32; 2], pixel: usize, samples: &mut Vec<Sample>, sum: &mut Pixel) {
        let across = self.quality.rays_across;
        let key = u64::from(at[1]) << 32 | u64::from(at[0]);
        for stratum in 0..across * across {
            let [dx, dy] = [stratum % across, stratum / across];
            let [jx, jy] = hash::unit_pair(key, u64::from(stratum));
            let x = at[0] as f32 + 0.5 + tent((dx as f32 + jx) / across as f32);
            let y = at[1] as f32 + 0.5 + tent((dy as f32 + jy) / across as f32);
            let ray = self.pinhole.ray(x, y);
            let lights = self.quality.lights_across.clamp(1, across);
            let cell = dy * lights / across * lights + dx * lights / across;
            match self.first_hit(ray) {
                Some(hit) => samples.push(self.surface(&ray, &hit, pixel, cell)),
                None => {
                    sum.direct +=
                        self.scene.sky.as_ref().map_or(Rgb::ZERO, |sky| sky.radiance(ray.direction));
                }
            }
        }
    }

    /// The first hit that the view does not look through.
    fn first_hit(&self, mut ray: Ray) -> Option<Hit> {
        for _ in 0..THROUGH_LIMIT {
            let hit = self.bvh.closest(&ray)?;
            let back = self.scene.normal(hit.triangle).dot(ray.direction) > 0.0;
            // A proxy may stand out from the surface.
            let gone = self.bvh.near().is_some() && self.bvh.surface(&ray).is_none();
            if !(self.see_through && back || gone) {
                return Some(hit);
            }
            ray.t_min = hit.distance;
        }
        None
    }

    /// The surface at a hit, seen from the ray's side; the back of a one-sided mesh is black.
    fn surface(&self, ray: &Ray, hit: &Hit, pixel: usize, cell: u32) -> Sample {
        let mesh = self.scene.mesh_of(hit.triangle);
        let material = &self.scene.meshes[mesh];
        let back = self.scene.normal(hit.triangle).dot(ray.direction) > 0.0;
        let black = back && !material.two_sided;
        let front = smooth_normal(self.scene, &self.normals, hit.triangle, [hit.u, hit.v]);
        let albedo = self.scene.albedo(hit.triangle, hit.u, hit.v);
        // Where the scene is a proxy, the surface itself is shown.
        let near = Ray { t_min: hit.distance - 1.0e-5, ..*ray };
        let met = self.bvh.surface(&near);
        let point = match met {
            Some(met) => {
                SurfacePoint { position: ray.origin + ray.direction * met.distance, normal: met.normal }
            }
            None => SurfacePoint {
                position: triangle::point(self.scene.corners(hit.triangle), hit.u, hit.v),
                normal: if back { -front } else { front },
            },
        };
        Sample {
            pixel,
            cell,
            mesh,
            point,
            albedo: if black { Vec3::ZERO } else { albedo },
            emitted: if black { Vec3::ZERO } else { material.radiance },
            depth: self.pinhole.depth(ray, hit.distance),
            light: if black { None } else { Some(usize::MAX) },
        }
    }

    /// Gives each lit sample of a pixel an evaluation: samples of one cell on one smooth stretch of a mesh share theirs.
    fn share_lights(&self, samples: &mut [Sample], points: &mut Vec<SurfacePoint>) {
        for k in 0..samples.len() {
            if samples[k].light.is_none() {
                continue;
            }
            let (earlier, rest) = samples.split_at(k);
            let near = self.pinhole.footprint(rest[0].depth);
            let shared = earlier.iter().find(|other| other.light.is_some() && alike(other, &rest[0], near));
            samples[k].light = shared.map_or(Some(points.len()), |other| other.light);
            if samples[k].light == Some(points.len()) {
                points.push(samples[k].point);
            }
        }
    }
}

/// Whether two samples lie on one stretch of surface, within a pixel's footprint `near` of one plane and 18 degrees.
fn alike(a: &Sample, b: &Sample, near: f32) -> bool {
    a.cell == b.cell
        && a.mesh == b.mesh
        && a.point.normal.dot(b.point.normal) > 0.95
        && (a.point.position - b.point.position).dot(b.point.normal).abs() < near
}

/// Maps [0, 1) to (−1, 1) with the density of a tent.
fn tent(u: f32) -> f32 {
    if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * u).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::synthetic;
    use crate::scene::Camera;

    fn view() -> View {
        let camera = Camera {
            name: "front".into(),
            eye: Vec3::new(0.5, 0.5, 2.0),
            target: Vec3::new(0.5, 0.5, 0.0),
            up: Vec3::Y,
            fov_degrees: 45.0,
            size: [50, 40],
        };
        View { camera, see_through: false }
    }

    #[test]
    fn a_square_shows_its_light_and_its_depth_and_the_sky_around() {
        let scene = synthetic::square();
        let film =
            render(&scene, &Bvh::build(&scene), &synthetic::light, (&view(), Quality::PREVIEW), &|_| Ok(()))
                .unwrap();
        let pixel = film.pixels[20 * 50 + 25];
        // Albedo 0.5, direct (0.5, 0.5, 1) and indirect 0.25 on a surface that looks to +z.
        let direct = Vec3::new(0.25, 0.25, 0.5) / std::f32::consts::PI;
        assert!((pixel.direct - direct).length() < 1e-6, "{pixel:?}");
        assert!((pixel.indirect - Vec3::splat(0.125 / std::f32::consts::PI)).length() < 1e-6);
        assert!((pixel.depth - 2.0).abs() < 1e-5 && (pixel.normal - Vec3::Z).length() < 1e-6);
        assert_eq!(film.pixels[0].direct, Vec3::ONE);
        assert_eq!((film.pixels[0].coverage, film.pixels[0].normal), (0.0, Vec3::ZERO));
    }

    #[test]
    fn backs_are_black_unless_seen_through() {
        let scene = synthetic::block();
        let mut view = view();
        view.camera.eye = Vec3::splat(0.5);
        view.camera.target = Vec3::new(0.5, 0.5, 0.0);
        let shoot = |view: &View| {
            let bvh = Bvh::build(&scene);
            render(&scene, &bvh, &synthetic::light, (view, Quality::FINE), &|_| Ok(())).unwrap().pixels[0]
        };
        assert_eq!((shoot(&view).radiance(), shoot(&view).coverage), (Vec3::ZERO, 1.0));
        view.see_through = true;
        assert_eq!((shoot(&view).radiance(), shoot(&view).coverage), (Vec3::ONE, 0.0));
    }

    #[test]
    fn one_evaluation_serves_a_pixel_of_one_surface() {
        let scene = synthetic::square();
        let count = std::sync::atomic::AtomicUsize::new(0);
        let counted = |points: &[SurfacePoint]| {
            count.fetch_add(points.len(), std::sync::atomic::Ordering::Relaxed);
            synthetic::light(points)
        };
        let mut close = view();
        close.camera.eye.z = 0.5;
        let quality = Quality { rays_across: 4, lights_across: 2 };
        render(&scene, &Bvh::build(&scene), &counted, (&close, quality), &|_| Ok(())).unwrap();
        assert_eq!(count.into_inner(), 50 * 40 * 4);
    }

    #[test]
    fn an_asking_to_stop_stops() {
        let scene = synthetic::square();
        let stop = |_| Err(crate::Error::Interrupted { terminated: false });
        let outcome =
            render(&scene, &Bvh::build(&scene), &synthetic::light, (&view(), Quality::PREVIEW), &stop);
        assert_eq!(outcome.unwrap_err().exit_code(), 130);
    }

    #[test]
    fn tent_is_symmetric_and_covers_two_pixels() {
        for i in 0..=100 {
            let u = i as f32 / 100.0;
            assert!((tent(u) + tent(1.0 - u)).abs() < 1e-3 && tent(u).abs() <= 1.0, "{u}: {}", tent(u));
        }
    }
}
