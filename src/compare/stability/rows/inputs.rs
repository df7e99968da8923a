//! Rows 10, 12 and 17: broken triangles, coincident surfaces, materials without a meaning.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3, Vec3};

use super::Numbers;
use crate::bake::Monitor;
use crate::compare::known::{self, Shape, box_faces, cuboid, icosphere, part, points_on, quad, with_sun};
use crate::compare::stability::Measured;
use crate::compare::stability::bakes::{apart, light, mean, on, planned};
use crate::compare::textbook::points;
use crate::error::{Error, Result};
use crate::geometry::{SurfacePoint, hemisphere, tangent_frame};
use crate::light::{Rgb, mean_channel};
use crate::rays::{Bvh, Ray};
use crate::scene;

/// Files that vanish with the row.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Result<Self> {
        tempfile::tempdir().map(Self).map_err(|e| Error::io(std::env::temp_dir(), "making a folder", e))
    }

    fn write(&self, name: &str, text: &str) -> Result<PathBuf> {
        let path = self.0.path().join(name);
        std::fs::write(&path, text).map_err(|e| Error::io(&path, "writing", e))?;
        Ok(path)
    }
}

/// A shape as an ASCII PLY.
fn ply(shape: &Shape) -> String {
    let (vertices, faces) = (shape.vertices.len(), shape.triangles.len());
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    );
    // Writing to a String cannot fail.
    shape.vertices.iter().for_each(|v| _ = writeln!(text, "{} {} {}", v.x, v.y, v.z));
    shape.triangles.iter().for_each(|t| _ = writeln!(text, "3 {} {} {}", t[0], t[1], t[2]));
    text
}

fn triangle(corners: [DVec3; 3]) -> Shape {
    Shape { vertices: corners.to_vec(), triangles: vec![[0, 1, 2]] }
}

/// A closed cube with everything wrong that does not open it.
fn shell() -> Shape {
    let mut shell = cuboid(DVec3::ZERO, DVec3::ONE, 1).flipped();
    // Two of its faces are there twice, half of one once more and inverted.
    let [a, b, c] = shell.triangles[0];
    shell.triangles.extend_from_within(0..4);
    shell.triangles.extend([[a, c, b], [a, a, b], [c, c, c]]);
    // Corners on one line, and a vertex of no triangle.
    let line = [0.1, 0.2, 0.3].map(|x| DVec3::new(x, 0.0, 0.0));
    let mut shell = shell.with(&triangle(line));
    shell.vertices.push(DVec3::new(0.5, 0.9, 0.5));
    shell
}

/// Slivers, T-junctions, three triangles on one edge, squares through each other, debris.
fn junk() -> Shape {
    let v = DVec3::new;
    let mut junk = quad(v(0.6, 0.6, 0.3), DVec3::X * 0.3, DVec3::Y * 0.3, 1);
    junk = junk.with(&quad(v(0.75, 0.55, 0.15), DVec3::Y * 0.3, DVec3::Z * 0.3, 1));
    for x in [0.2, 0.3, 0.4] {
        junk = junk.with(&triangle([v(0.3, 0.2, 0.4), v(0.3, 0.6, 0.4), v(x, 0.4, 0.6)]));
    }
    for k in 0..32 {
        // Slivers from 0.1 to 10⁻⁶ wide, which meet at T-junctions.
        let (x, width) = (0.1 + 0.02 * f64::from(k), 0.1 * 0.7f64.powi(k));
        junk = junk.with(&triangle([v(x, 0.1, 0.8), v(x + width, 0.1, 0.8), v(x, 0.5, 0.8)]));
    }
    for k in 0..100 {
        let share = |step: f64| 0.1 + 0.8 * (f64::from(k) * step + 0.5).fract();
        let at = v(share(0.819_172_5), share(0.671_043_6), share(0.549_700_5));
        let size = 10f64.powf(-2.0 - 3.0 * f64::from(k) / 99.0);
        junk = junk.with(&triangle([at, at + DVec3::X * size, at + v(0.0, size, size)]));
    }
    junk
}

/// One good triangle, and one that reaches to NaN and infinity.
fn reaching_nan() -> Shape {
    let bad = [DVec3::splat(0.2), DVec3::new(f64::NAN, 0.2, 0.2), DVec3::new(0.2, f64::INFINITY, 0.2)];
    triangle(bad).with(&triangle([DVec3::splat(0.3), DVec3::X * 0.3, DVec3::Y * 0.3]))
}

fn mesh(file: &str, rest: &str) -> String {
    format!("[[mesh]]\nfile = \"{file}\"\n{rest}\n")
}

/// A furnace of broken triangles bakes with counted warnings, finite everywhere and within the target; a file with a vertex
/// at NaN is refused by its name.
///
/// Seen to fail: on the textbook scheme, whose kernel between coincident points is 0/0.
pub fn broken(monitor: &dyn Monitor) -> Result<Numbers> {
    const TARGET: f64 = 0.03;
    let folder = Folder::new()?;
    folder.write("shell.ply", &ply(&shell()))?;
    folder.write("junk.ply", &ply(&junk()))?;
    let material = "albedo = 0.5\nradiance = [1, 1, 1]\nsides = 2";
    let whole: String = ["shell.ply", "junk.ply"].map(|file| mesh(file, material)).concat();
    let scene = scene::load(&folder.write("scene.toml", &whole)?)?;
    folder.write("bad.ply", &ply(&reaching_nan()))?;
    let with_nan = scene::load(&folder.write("nan.toml", &(whole + &mesh("bad.ply", material)))?);
    // No triangle can be made of such a vertex, and nobody can say what the surface should have been.
    let named = |e: Error| e.to_string().contains("bad.ply") && e.to_string().contains("finite");
    let uncounted = |w: &&scene::Warning| !w.message.contains(|c: char| c.is_ascii_digit());
    let refused = with_nan.err().is_some_and(named);
    let (warnings, silent) = (scene.warnings.len(), scene.warnings.iter().filter(uncounted).count());
    let (model, _) = planned(scene, TARGET, monitor)?;
    // The shell's inverted triangle looks out of the room, into the dark.
    let middle = model.scene.placement.to_local(DVec3::splat(0.5));
    let mut asked = on(&model, 0, 3000);
    asked.retain(|p| p.normal.dot(middle - p.position) > 0.0);
    asked.extend(on(&model, 1, 3000));
    let values = light(&model, &asked);
    let want = std::f64::consts::PI / 0.5;
    let square = mean(&values.iter().map(|v| (v / want - 1.0).powi(2)).collect::<Vec<_>>());
    let infinite = values.iter().filter(|v| !v.is_finite()).count();
    let ours = vec![
        Measured::plain("answers that are not finite", infinite as f64, 0.0),
        Measured::plain("warnings missing or without a count", silent as f64 + f64::from(warnings == 0), 0.0),
        Measured::share("irradiance, RMS", square.sqrt(), TARGET),
        Measured::plain("a vertex at NaN accepted, or refused without its place", f64::from(!refused), 0.0),
    ];
    let matrix = points::matrix(&points::of_parts(&[part("shell", shell(), 0.5), part("junk", junk(), 0.5)]));
    let nan = matrix.iter().flatten().filter(|f| f.is_nan()).count();
    Ok((vec![Measured::plain("form factors that are not finite", nan as f64, 0.0)], ours))
}

/// What contrast a flat, evenly lit surface may have.
const ACNE: f64 = 0.01;

/// (largest − smallest) / mean.
fn contrast(values: &[f64]) -> f64 {
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    if values.iter().any(|v| v.is_nan()) { f64::NAN } else { (most - least) / mean(values) }
}

/// No acne where a floor lies twice and where blocks go through each other: contrast under 1 %.
///
/// Under a sun from straight above the floor of a box without a ceiling has the same direct light everywhere; its indirect
/// light is that of a floor that lies there once. In a furnace all light is the same.
/// Seen to fail: on rays that start from the surface itself.
pub fn coincident(monitor: &dyn Monitor) -> Result<Numbers> {
    const TARGET: f64 = 0.02;
    let [(once, _), (twice, _)] =
        [planned(sunny_box(1), TARGET, monitor)?, planned(sunny_box(2), TARGET, monitor)?];
    let own = unlifted(&twice.scene);
    let points = on(&twice, 0, 3000);
    let [alone, doubled] = [&once, &twice].map(|model| model.field().evaluate(&points));
    let channel = |c: Rgb| f64::from(mean_channel(c));
    let direct: Vec<f64> = doubled.iter().map(|a| channel(a.direct)).collect();
    let [alone, indirect] =
        [&alone, &doubled].map(|all| all.iter().map(|a| channel(a.indirect)).collect::<Vec<_>>());
    let (model, _) = planned(known::scene(&intersecting()), TARGET, monitor)?;
    // Distance to the nearest solid of which a point is no part, and what it receives.
    let of_mesh = |mesh: usize| {
        let points = on(&model, mesh, 2000);
        let clear = points.iter().map(|p| clearance(model.scene.placement.to_world(p.position), mesh));
        let told: Vec<(f64, f64)> =
            clear.zip(light(&model, &points)).filter(|(clear, _)| *clear > 1e-4).collect();
        told
    };
    let outside: Vec<(f64, f64)> = (0..4).flat_map(of_mesh).collect();
    let all: Vec<f64> = outside.iter().map(|(_, light)| *light).collect();
    let flat: Vec<f64> =
        outside.iter().filter(|(clear, _)| *clear > CLEAR).map(|(_, light)| *light).collect();
    // B = H = E₀/(1 − ρ).
    let furnace = vec![2.0; all.len()];
    let ours = vec![
        Measured::share("floor twice: contrast of sunlight", contrast(&direct), ACNE),
        // Two bakes, each within the target.
        Measured::share("floor twice: indirect light from that of one", apart(&indirect, &alone), TARGET),
        Measured::share("blocks through each other: contrast of flat parts", contrast(&flat), ACNE),
        Measured::share("blocks through each other: RMS, edges included", apart(&all, &furnace), TARGET),
    ];
    Ok((vec![Measured::share("floor twice: contrast of open sky", own, ACNE)], ours))
}

/// A box without its ceiling, turned so that no coordinate is round, under a sun from its zenith; the floor lies there
/// `times`, each time in other triangles.
fn sunny_box(times: usize) -> scene::Scene {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.6);
    let turned = |shape: Shape| shape.mapped(|v| turn * v);
    let floors = [quad(DVec3::ZERO, DVec3::X, DVec3::Y, 7), quad(DVec3::ZERO, DVec3::X, DVec3::Y, 4)];
    let mut parts: Vec<known::Part> =
        floors.into_iter().take(times).map(|floor| part("floor", turned(floor), 0.5)).collect();
    let walls = box_faces(DVec3::ZERO, DVec3::ONE, 3).into_iter().take(4);
    parts.extend(walls.map(|wall| part("wall", turned(wall.flipped()), 0.5)));
    with_sun(known::scene(&parts), turn * DVec3::NEG_Z, 1.0)
}

const BLOCKS: [[DVec3; 2]; 2] = [
    [DVec3::new(0.2, 0.2, 0.0), DVec3::new(0.5, 0.5, 0.4)],
    [DVec3::new(0.4, 0.4, 0.0), DVec3::new(0.7, 0.7, 0.3)],
];
const BALL: (DVec3, f64) = (DVec3::new(0.7, 0.3, 0.1), 0.2);

/// A furnace with two blocks through each other, their bottoms in the floor, and a ball through the floor.
fn intersecting() -> Vec<known::Part> {
    let block = |[min, max]: [DVec3; 2]| cuboid(min, max, 2);
    let ball = icosphere(BALL.1, 3).translated(BALL.0);
    let room = cuboid(DVec3::ZERO, DVec3::ONE, 2).flipped();
    let shapes = [room, block(BLOCKS[0]), block(BLOCKS[1]), ball];
    shapes.map(|shape| part("solid", shape, 0.5).exitance(1.0)).into()
}

/// Flat parts are farther than this from other solids: about a site's spacing.
const CLEAR: f64 = 0.05;

/// Distance of a place on a mesh from the nearest other solid, negative within one or outside of the room.
fn clearance(at: DVec3, mesh: usize) -> f64 {
    let block = |[min, max]: [DVec3; 2]| (min - at).max(at - max).max_element();
    let others =
        [-block([DVec3::ZERO, DVec3::ONE]), block(BLOCKS[0]), block(BLOCKS[1]), at.distance(BALL.0) - BALL.1];
    (0..4).filter(|k| *k != mesh).map(|k| others[k]).fold(f64::INFINITY, f64::min)
}

/// The contrast of a floor whose rays start from it without a lift.
fn unlifted(scene: &scene::Scene) -> f64 {
    let bvh = Bvh::build(scene);
    let free = |p: &SurfacePoint| {
        let (s, t) = tangent_frame(p.normal);
        // Only the first 0.01 of the way counts: nothing is there but the floor itself.
        let escapes = |i: &u32| {
            let way = hemisphere::cosine_hemisphere(hemisphere::fibonacci(*i, 64, [0.3, 0.7]));
            let direction = s * way.x + t * way.y + p.normal * way.z;
            !bvh.occluded(&Ray { t_max: 0.01, ..Ray::new(p.position, direction) })
        };
        (0..64).filter(escapes).count() as f64
    };
    let mut points = points_on(scene, 0, 1000, 17);
    // Clear of the walls.
    let middle = points.iter().map(|p| p.position).sum::<Vec3>() / points.len() as f32;
    points.retain(|p| p.position.distance(middle) < 0.2);
    contrast(&points.iter().map(free).collect::<Vec<_>>())
}

/// Materials that light transport has no meaning for, and what the refusal must name.
const REFUSED: [(&str, &str); 7] = [
    ("albedo = 1.0", "albedo"),
    ("albedo = [0.5, 1.5, 0.5]", "albedo"),
    ("albedo = [0.5, nan, 0.5]", "albedo"),
    ("albedo = [0.5, inf, 0.5]", "albedo"),
    ("albedo = -0.1", "albedo"),
    ("radiance = [0, -1, 0]", "radiance"),
    ("radiance = [0, nan, 0]", "radiance"),
];

/// Albedo of 1 and above, negative light and NaN are refused by exit code 4, with file, line, key and remedy.
///
/// Seen to fail: the textbook's series at albedo 1 never ends.
pub fn refused(_: &dyn Monitor) -> Result<Numbers> {
    let folder = Folder::new()?;
    folder.write("square.ply", &ply(&quad(DVec3::ZERO, DVec3::X, DVec3::Y, 1)))?;
    let sky = "[sky]\nradiance = [1, 1, 1]\n";
    let good = scene::load(&folder.write("good.toml", &(mesh("square.ply", "albedo = 0.5") + sky))?);
    let mut unclear = usize::from(good.is_err());
    for (line, key) in REFUSED {
        let path = folder.write("bad.toml", &(mesh("square.ply", line) + sky))?;
        unclear += usize::from(!is_refused(&path, key));
    }
    let sphere = part("sphere", icosphere(1.0, 2).flipped(), 1.0).exitance(1.0);
    let series = points::irradiance(&points::of_parts(&[sphere]));
    let endless = if series.is_some() { 0.0 } else { f64::INFINITY };
    let textbook = vec![Measured::plain("light in a sphere of albedo 1", endless, 0.0)];
    Ok((textbook, vec![Measured::plain("accepted, or refused without a reason", unclear as f64, 0.0)]))
}

fn is_refused(path: &Path, key: &str) -> bool {
    match scene::load(path) {
        Err(Error::Input { file, place, problem, remedy }) => {
            file == path
                && format!("{place} {problem}").contains(key)
                && place.contains("line")
                && !remedy.is_empty()
        }
        _ => false,
    }
}
