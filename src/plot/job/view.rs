//! The picture of the scene that figures draw upon, and where points of the scene are in it.

use glam::Vec3;

use crate::error::Result;
use crate::output::picture::{Film, Pinhole, Quality, View, render};
use crate::output::{Advance, exposure};
use crate::plot::canvas::{At, Colour, Picture, Rect};
use crate::rays::Ray;
use crate::solve::Field;

/// Pixels along the longer side of the picture.
const PIXELS: f32 = 640.0;

/// The size of a picture of a scene without cameras.
const FRAMED: [u32; 2] = [640, 480];

/// Layers of backs that are looked through at most.
const THROUGH: usize = 64;

/// A point is seen when what is met before it is closer to it than this share of the way: rounding, and the lift of points.
const NEARLY: f32 = 1.0e-3;

/// A picture of the scene from its first camera, or from where it shows well.
pub struct Shot {
    pub film: Film,
    view: View,
    eye: Vec3,
    forward: Vec3,
    /// To the picture's right and lower side at distance one.
    sides: [Vec3; 2],
}

impl Shot {
    /// Takes the picture.
    pub fn of(field: &Field<'_>, advance: &Advance<'_>) -> Result<Self> {
        let around = field.problem.around;
        let mut view = View::choose(around.scene, around.bvh, None, FRAMED)?;
        let longer = view.camera.size[0].max(view.camera.size[1]).max(1) as f32;
        view.camera.size = view.camera.size.map(|v| (v as f32 * PIXELS / longer).round().max(1.0) as u32);
        let quality = Quality { rays_across: 2, lights_across: 1 };
        let evaluate = |points: &[_]| field.evaluate(points);
        let film = render(around.scene, around.bvh, &evaluate, (&view, quality), advance)?;
        let pinhole = Pinhole::new(&view.camera)?;
        let [width, height] = view.camera.size.map(|v| v as f32);
        let towards = |x, y| pinhole.ray(x, y).direction;
        let forward = towards(0.5 * width, 0.5 * height);
        let side = |at: Vec3| at / at.dot(forward) - forward;
        let sides = [side(towards(width, 0.5 * height)), side(towards(0.5 * width, height))];
        Ok(Self { film, eye: view.camera.eye, view, forward, sides })
    }

    /// Where a point of the scene is on a page that shows the picture at `place`; none outside of it.
    pub fn at(&self, point: Vec3, place: &Rect) -> Option<At> {
        let way = point - self.eye;
        let depth = way.dot(self.forward);
        if depth <= 0.0 {
            return None;
        }
        let share = self.sides.map(|s| 0.5 + 0.5 * f64::from(way.dot(s) / (s.length_squared() * depth)));
        let at = [place.low[0] + share[0] * place.width(), place.low[1] + share[1] * place.height()];
        place.holds(at).then_some(at)
    }

    /// Whether the camera sees a point of a surface.
    pub fn sees(&self, field: &Field<'_>, point: Vec3) -> bool {
        let around = field.problem.around;
        let mut ray = Ray::between(self.eye, point);
        ray.t_max *= 1.0 - NEARLY;
        for _ in 0..THROUGH {
            let Some(hit) = around.bvh.closest(&ray) else { return true };
            let back = around.scene.normal(hit.triangle).dot(ray.direction) > 0.0;
            if !(self.view.see_through && back) {
                return false;
            }
            ray.t_min = hit.distance;
        }
        false
    }

    /// Whether a receiver is in the picture, with the side that looks to the camera.
    pub fn shows_receiver(&self, field: &Field<'_>, receiver: u32) -> bool {
        let point = field.problem.receivers.index.supports()[receiver as usize].point;
        let unit = Rect::sized([0.0, 0.0], [1.0, 1.0]);
        let turned = point.normal.dot(self.eye - point.position) > 0.0;
        turned && self.at(point.position, &unit).is_some() && self.sees(field, point.position)
    }

    /// The picture's box of this width on the page.
    pub fn place(&self, low: At, longer: f64) -> Rect {
        let [width, height] = [f64::from(self.film.width), f64::from(self.film.height)];
        let scale = longer / width.max(height);
        Rect::sized(low, [width * scale, height * scale])
    }

    /// The picture in pale greys, for marks to stand out on.
    pub fn pale(&self) -> Picture {
        let exposure = self.film.exposure();
        let pale = |p: &crate::output::picture::film::Pixel| {
            let [red, green, blue] = exposure::srgb(p.radiance(), exposure).map(f32::from);
            let grey = 0.3 * red + 0.6 * green + 0.1 * blue;
            [(105.0 + 150.0 * grey / 255.0) as u8; 3]
        };
        self.picture(self.film.pixels.iter().flat_map(pale).collect())
    }

    /// A picture of a colour per pixel.
    pub fn coloured(&self, colour: impl Fn(&crate::output::picture::film::Pixel) -> Colour) -> Picture {
        let bytes = self.film.pixels.iter().map(colour).flat_map(|c| [c.red, c.green, c.blue]).collect();
        self.picture(bytes)
    }

    fn picture(&self, bytes: Vec<u8>) -> Picture {
        Picture { width: self.film.width, height: self.film.height, bytes }
    }
}
