//! Chooses a view: a camera of the scene by name, or one that shows the scene well.
//!
//! Solids are seen from outside, from where they show their fronts. Closed rooms are seen from inside. Open boxes are
//! seen through their opening, or through their near walls' backs when the walls hide everything else.

use glam::Vec3;

use crate::error::{Error, Result};
use crate::geometry::hemisphere;
use crate::rays::{Bvh, Ray};
use crate::scene::{Camera, Scene};

/// Vertical field of view from outside: a portrait lens.
const OUTSIDE_FOV: f32 = 35.0;

/// Vertical field of view within a room: a wide lens, about 24 mm.
const INSIDE_FOV: f32 = 65.0;

/// A room is sealed when this share of all directions meets fronts: more than an open box offers, whose opening takes
/// a tenth of the directions even from its far end.
const SEALED: f32 = 0.97;

/// A room with windows and doors still has this share.
const ENCLOSED: f32 = 0.85;

/// An outside view is good when this share of what it meets are fronts.
const MOSTLY: f32 = 0.7;

/// A later candidate replaces an earlier, more usual one only when it shows that much more.
const CLEARLY: f32 = 0.05;

/// Up to that many vertices are fitted into the picture, evenly spread over all.
const FITTED_VERTICES: usize = 100_000;

/// A camera and whether it looks through backs of surfaces.
#[derive(Debug, Clone)]
pub struct View {
    /// Where from, where to, how large.
    pub camera: Camera,
    /// Surfaces that show their back to the camera are left out.
    pub see_through: bool,
}

impl View {
    /// The camera of that name; without a name the scene's first, or a framed view of `size` if it has none.
    ///
    /// # Errors
    /// [`Error::Usage`] that lists the cameras when none has this name.
    pub fn choose(scene: &Scene, bvh: &Bvh, name: Option<&str>, size: [u32; 2]) -> Result<Self> {
        let Some(name) = name else {
            let first =
                scene.cameras.first().map(|camera| Self { camera: camera.clone(), see_through: false });
            return Ok(first.unwrap_or_else(|| frame(scene, bvh, size)));
        };
        if let Some(camera) = scene.cameras.iter().find(|camera| camera.name == name) {
            return Ok(Self { camera: camera.clone(), see_through: false });
        }
        let names: Vec<&str> = scene.cameras.iter().map(|camera| camera.name.as_str()).collect();
        let known =
            if names.is_empty() { "it has none".to_owned() } else { format!("it has {}", names.join(", ")) };
        Err(Error::Usage(format!("the scene has no camera {name:?}; {known}")))
    }
}

/// A view of `size` pixels that shows the scene well.
pub fn frame(scene: &Scene, bvh: &Bvh, size: [u32; 2]) -> View {
    let Some(setting) = Setting::of(scene, size) else {
        let camera = camera(Vec3::Z, Vec3::ZERO, (Vec3::Y, OUTSIDE_FOV, size));
        return View { camera, see_through: false };
    };
    if let Some(view) = inside(scene, bvh, &setting, SEALED) {
        return view;
    }
    let (fronts, camera) = outside(scene, bvh, &setting);
    if fronts < MOSTLY
        && let Some(view) = inside(scene, bvh, &setting, ENCLOSED)
    {
        return view;
    }
    let one_sided = scene.meshes.iter().all(|mesh| !mesh.two_sided);
    View { camera, see_through: one_sided && fronts > 0.0 && fronts < MOSTLY }
}

/// The scene's box, its axes, and the picture's size.
struct Setting {
    low: Vec3,
    high: Vec3,
    up: Vec3,
    front: Vec3,
    size: [u32; 2],
}

impl Setting {
    /// None for a scene without triangles.
    fn of(scene: &Scene, size: [u32; 2]) -> Option<Self> {
        let mut corners = scene.triangles.iter().flatten().map(|&k| scene.vertices[k as usize]);
        let first = corners.next()?;
        let (low, high) = corners.fold((first, first), |(low, high), p| (low.min(p), high.max(p)));
        let up = scene.up.normalize_or(Vec3::Y);
        // What modellers call front: +z when y is up, −y when z is.
        let front = if up.z.abs() > 0.9 { Vec3::NEG_Y } else { Vec3::Z };
        let front = (front - up * front.dot(up)).normalize_or(up.any_orthonormal_vector());
        Some(Self { low, high, up, front, size })
    }

    fn centre(&self) -> Vec3 {
        0.5 * (self.low + self.high)
    }

    /// The direction at `azimuth` (counter-clockwise from front, seen from above) and `elevation`, in degrees.
    fn direction(&self, azimuth: f32, elevation: f32) -> Vec3 {
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let flat = self.front * cos + self.up.cross(self.front) * sin;
        let (sin, cos) = elevation.to_radians().sin_cos();
        flat * cos + self.up * sin
    }
}

fn camera(eye: Vec3, target: Vec3, (up, fov_degrees, size): (Vec3, f32, [u32; 2])) -> Camera {
    Camera { name: "auto".into(), eye, target, up, fov_degrees, size }
}

/// What a bundle of rays sees.
#[derive(Default)]
struct Outlook {
    hits: f32,
    fronts: f32,
    rays: f32,
    distance: f32,
    nearest: f32,
}

impl Outlook {
    fn of(scene: &Scene, bvh: &Bvh, rays: impl Iterator<Item = Ray>) -> Self {
        let mut seen = Self { nearest: f32::INFINITY, ..Self::default() };
        for ray in rays {
            seen.rays += 1.0;
            let Some(hit) = bvh.closest(&ray) else { continue };
            seen.hits += 1.0;
            seen.distance += hit.distance;
            seen.nearest = seen.nearest.min(hit.distance);
            if scene.normal(hit.triangle).dot(ray.direction) < 0.0 {
                seen.fronts += 1.0;
            }
        }
        seen
    }

    /// A bundle over a camera's image.
    fn through(scene: &Scene, bvh: &Bvh, camera: &Camera) -> Self {
        let Ok(pinhole) = super::Pinhole::new(camera) else { return Self::default() };
        let [width, height] = camera.size.map(|pixels| pixels as f32);
        let at = |i: u32| pinhole.ray((i % 24) as f32 / 24.0 * width, (i / 24) as f32 / 16.0 * height);
        Self::of(scene, bvh, (0..24 * 16).map(at))
    }
}

/// A view from within, if the scene is a room at that share of fronts: the longest from a point that nothing crowds.
fn inside(scene: &Scene, bvh: &Bvh, setting: &Setting, share: f32) -> Option<View> {
    let extent = setting.high - setting.low;
    let along = [0.12, 0.3, 0.5, 0.7, 0.88];
    let points = (0..125usize).map(|i| {
        let place = Vec3::new(along[i % 5], along[i / 5 % 5], along[i / 25]);
        setting.low + extent * place
    });
    let sphere = |eye: Vec3| {
        (0..128).map(move |i| {
            Ray::new(eye, hemisphere::uniform_sphere(hemisphere::fibonacci(i, 128, [0.5, 0.5])))
        })
    };
    let enclosed: Vec<(Vec3, Outlook)> = points
        .map(|eye| (eye, Outlook::of(scene, bvh, sphere(eye))))
        .filter(|(_, seen)| seen.fronts >= share * seen.rays)
        .collect();
    // Furniture and odd plans take some of the box; a fifth of it must be room.
    if enclosed.len() < 25 {
        return None;
    }
    let mut best: Option<(f32, Camera)> = None;
    for (eye, around) in &enclosed {
        for turn in 0..8 {
            let forward = setting.direction(45.0 * turn as f32, -8.0);
            let camera = camera(*eye, *eye + forward, (setting.up, INSIDE_FOV, setting.size));
            let seen = Outlook::through(scene, bvh, &camera);
            let crowded = (around.nearest / (0.1 * extent.max_element())).min(1.0);
            let score =
                seen.distance / seen.hits.max(1.0) * crowded.min(1.0) * (seen.fronts / seen.rays.max(1.0));
            if best.as_ref().is_none_or(|(most, _)| score > *most * (1.0 + CLEARLY)) {
                best = Some((score, camera));
            }
        }
    }
    best.map(|(_, camera)| View { camera, see_through: false })
}

/// The camera outside from where the largest share of what it meets are fronts, and that share.
fn outside(scene: &Scene, bvh: &Bvh, setting: &Setting) -> (f32, Camera) {
    let mut best: Option<(f32, Camera)> = None;
    for elevation in [15.0, 0.0, 50.0, -40.0] {
        for turn in 0..16 {
            // 22.5, −22.5, 0, 45, …: a little from the side first, then all around.
            let step = [1, 15, 0, 2, 14, 3, 13, 4, 12, 5, 11, 6, 10, 7, 9, 8][turn];
            let camera = fit(scene, setting, setting.direction(22.5 * step as f32, elevation));
            let seen = Outlook::through(scene, bvh, &camera);
            let score = if seen.hits > 0.0 { seen.fronts / seen.hits } else { 0.0 };
            if best.as_ref().is_none_or(|(most, _)| score > most + CLEARLY) {
                best = Some((score, camera));
            }
        }
    }
    best.unwrap_or_else(|| (1.0, fit(scene, setting, setting.front)))
}

/// The camera looking against `towards` from just so far that all fits, the outline in the middle.
fn fit(scene: &Scene, setting: &Setting, towards: Vec3) -> Camera {
    let right = setting.up.cross(towards).normalize_or(towards.any_orthonormal_vector());
    let above = towards.cross(right);
    let tan_y = (0.5 * OUTSIDE_FOV.to_radians()).tan();
    let tan_x = tan_y * setting.size[0] as f32 / setting.size[1].max(1) as f32;
    let stride = scene.triangles.len().div_ceil(FITTED_VERTICES / 3).max(1);
    let used = || scene.triangles.iter().step_by(stride).flatten().map(|&k| scene.vertices[k as usize]);
    // A point p is inside the picture's left edge when −p·right ≤ tan (d − p·towards) for an eye at distance d: four
    // planes touch the scene, and opposite ones meet in the line that the eye must lie on or behind.
    let mut reach = [f32::NEG_INFINITY; 4];
    for p in used() {
        let (x, y, z) = (p.dot(right), p.dot(above), p.dot(towards));
        let edges = [x + tan_x * z, tan_x * z - x, y + tan_y * z, tan_y * z - y];
        for (most, edge) in reach.iter_mut().zip(edges) {
            *most = most.max(edge);
        }
    }
    let [to_right, to_left, to_top, to_bottom] = reach;
    let (x, y) = (0.5 * (to_right - to_left), 0.5 * (to_top - to_bottom));
    let needed = (0.5 * (to_right + to_left) / tan_x).max(0.5 * (to_top + to_bottom) / tan_y);
    let depth = setting.centre().dot(towards);
    let target = right * x + above * y + towards * depth;
    let least = 1e-3 * (setting.high - setting.low).length();
    let distance = (1.06 * (needed - depth)).max(least).max(1e-6);
    camera(target + towards * distance, target, (setting.up, OUTSIDE_FOV, setting.size))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::picture::Pinhole;
    use crate::output::synthetic;

    fn framed(scene: &Scene) -> View {
        frame(scene, &Bvh::build(scene), [300, 200])
    }

    #[test]
    fn a_block_is_seen_from_outside_and_whole() {
        let scene = synthetic::block();
        let view = framed(&scene);
        assert!(!view.see_through && (view.camera.eye - Vec3::splat(0.5)).length() > 1.0, "{view:?}");
        // No ray through the image's border meets it.
        let (pinhole, bvh) = (Pinhole::new(&view.camera).unwrap(), Bvh::build(&scene));
        for x in 0..=300 {
            assert!(bvh.closest(&pinhole.ray(x as f32, 0.0)).is_none());
            assert!(bvh.closest(&pinhole.ray(x as f32, 200.0)).is_none());
        }
        assert!(bvh.closest(&pinhole.ray(150.0, 100.0)).is_some());
    }

    #[test]
    fn a_closed_room_is_seen_from_inside() {
        let scene = synthetic::room();
        let eye = framed(&scene).camera.eye;
        assert!(eye.cmpgt(Vec3::ZERO).all() && eye.cmplt(Vec3::ONE).all(), "{eye}");
    }

    #[test]
    fn an_open_box_is_seen_through_its_opening() {
        let mut scene = synthetic::room();
        // Drop the wall x = 0: the first two triangles.
        scene.triangles.drain(..2);
        scene.meshes[0].triangles.end -= 2;
        let view = framed(&scene);
        assert!(view.camera.eye.x < 0.0 && !view.see_through, "{view:?}");
    }

    #[test]
    fn an_empty_scene_has_a_view_too() {
        let view = framed(&synthetic::scene(vec![], vec![]));
        assert!(Pinhole::new(&view.camera).is_ok());
    }

    #[test]
    fn unknown_cameras_are_usage_errors_that_list_the_known() {
        let mut scene = synthetic::square();
        scene.cameras = vec![framed(&scene).camera];
        let error = View::choose(&scene, &Bvh::build(&scene), Some("bakc"), [4, 4]).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        assert!(error.to_string().contains("auto"), "{error}");
    }
}
