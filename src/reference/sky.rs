//! Light from outside: looked up along directions, and image skies drawn by their brightness.

use std::f32::consts::{PI, TAU};

use glam::{Mat3, Vec2, Vec3};

use super::pattern::Density;
use crate::light::{Rgb, mean_channel};
use crate::scene::{Sky, Texture};

/// A sky with what it takes to aim at it.
pub(super) enum SkyLight<'a> {
    /// None, or one that is black.
    Dark,
    /// The same from everywhere: cosine-distributed directions already are its best samples.
    Even(Rgb),
    /// An image with a density over its texels.
    Image(Panorama<'a>),
}

/// A latitude–longitude image and a density over the sphere that is constant within each texel.
pub(super) struct Panorama<'a> {
    sky: &'a Sky,
    image: &'a Texture,
    to_image: Mat3,
    rows: Density,
    columns: Vec<Option<Density>>,
}

impl<'a> SkyLight<'a> {
    /// Tabulates the sky.
    pub fn new(sky: Option<&'a Sky>) -> Self {
        match sky {
            Some(Sky::Constant(radiance)) if mean_channel(*radiance) > 0.0 => Self::Even(*radiance),
            Some(sky @ Sky::Image { image, to_image }) => {
                Panorama::new(sky, image, *to_image).map_or(Self::Dark, Self::Image)
            }
            _ => Self::Dark,
        }
    }
}

impl<'a> Panorama<'a> {
    fn new(sky: &'a Sky, image: &'a Texture, to_image: Mat3) -> Option<Self> {
        let rows = 0..image.height;
        let columns: Vec<Option<Density>> = rows
            .clone()
            .map(|row| Density::new((0..image.width).map(|column| brightness(image, column, row))))
            .collect();
        let weight = |row: u32| columns[row as usize].as_ref().map_or(0.0, Density::total) * band(image, row);
        let rows = Density::new(rows.map(weight))?;
        Some(Self { sky, image, to_image, rows, columns })
    }

    /// The radiance that arrives against `direction` (unit, scene's frame).
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        self.sky.radiance(direction)
    }

    /// A direction at two numbers given in 32-bit fractions of one, with its density by solid angle.
    pub fn draw(&self, [x, y]: [u32; 2]) -> Option<(Vec3, f32)> {
        let row = self.rows.pick(y);
        let column = self.columns[row.entry].as_ref()?.pick(x);
        let u = (column.entry as f32 + column.rest as f32) / self.image.width as f32;
        // Uniform in the cosine within the row, as the solid angle is.
        let edge = |k: usize| (PI * k as f32 / self.image.height as f32).cos();
        let cosine = edge(row.entry) + (edge(row.entry + 1) - edge(row.entry)) * row.rest as f32;
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let (x, z) = (TAU * (u - 0.5)).sin_cos();
        let direction = self.to_image.transpose() * Vec3::new(sine * x, cosine, -sine * z);
        let share = row.probability * column.probability;
        Some((direction, self.by_solid_angle(share, row.entry as u32)))
    }

    /// The density by solid angle with which a direction is drawn.
    pub fn density(&self, direction: Vec3) -> f32 {
        let at = on_image(self.to_image * direction);
        let row = ((at.y * self.image.height as f32) as u32).min(self.image.height - 1);
        let column = ((at.x * self.image.width as f32) as u32).min(self.image.width - 1);
        let across = self.columns[row as usize].as_ref().map_or(0.0, |d| d.probability(column as usize));
        self.by_solid_angle(self.rows.probability(row as usize) * across, row)
    }

    fn by_solid_angle(&self, probability: f64, row: u32) -> f32 {
        let texel = f64::from(TAU) / f64::from(self.image.width) * band(self.image, row);
        (probability / texel) as f32
    }
}

/// Where a direction of the image's frame (y up, −z at the centre column, +x to the right of it) lies on the image.
fn on_image(d: Vec3) -> Vec2 {
    Vec2::new(0.5 + d.x.atan2(-d.z) / TAU, d.y.clamp(-1.0, 1.0).acos() / PI)
}

/// Solid angle of a row of texels over 2π: the difference of its edges' cosines.
fn band(image: &Texture, row: u32) -> f64 {
    let edge = |k: u32| (std::f64::consts::PI * f64::from(k) / f64::from(image.height)).cos();
    edge(row) - edge(row + 1)
}

/// Mean brightness of a texel and its neighbours: bilinear look-ups spread each texel over its surroundings, and a
/// density that left those out would meet bright rims by chance only.
fn brightness(image: &Texture, column: u32, row: u32) -> f64 {
    let (w, h) = (i64::from(image.width), i64::from(image.height));
    let texel = |dx: i64, dy: i64| {
        let x = (i64::from(column) + dx).rem_euclid(w);
        let y = (i64::from(row) + dy).clamp(0, h - 1);
        f64::from(mean_channel(image.pixels[(y * w + x) as usize]).max(0.0))
    };
    (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).map(|(dx, dy)| texel(dx, dy)).sum()
}
