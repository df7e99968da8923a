//! The options of a grown mesh, and the growing.

use std::io::{self, Write};

use clap::Args;
use glam::DVec3;
use glowtree::geometry::hash::mix2;

use crate::base::Base;
use crate::noise::{Looks, Noise};
use crate::numbering::{Flaws, LARGEST_K, Numbering};
use crate::order::Order;
use crate::ply::{self, Counts, Encoding, Format};
use crate::surface::Surface;

/// The root mean square slope of the noise, where `--amplitude` does not say otherwise: a weathered stone's.
const SLOPE: f64 = 0.25;

/// What is grown from a base.
#[derive(Debug, Clone, Args)]
pub struct Recipe {
    /// Parts of each edge, 1 to 4096
    #[arg(short, value_parser = clap::value_parser!(u32).range(1..=i64::from(LARGEST_K)))]
    pub k: u32,
    /// Of the noise, the flaws and the order
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Height of the noise, root mean square, in mean edges of the base; by default what makes a slope of 0.25
    #[arg(long)]
    pub amplitude: Option<f64>,
    /// Octaves of the noise, each of half the wavelength and half the height
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=20))]
    pub octaves: u32,
    /// Of the first octave, in mean edges of the base; the default gives the fifth four edges of a mesh of k = 10
    #[arg(long, default_value_t = 6.4)]
    pub wavelength: f64,
    /// Share of the base's triangles left out, in fans around vertices
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub holes: f64,
    /// Share of the faces that are slivers, at most about a half; k = 3 or more
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub slivers: f64,
    /// Share of the base's triangles that are torn off: their border has vertices of its own at the same places
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub duplicates: f64,
    /// Faces in a shuffled order
    #[arg(long)]
    pub shuffle: bool,
    /// As binary_big_endian
    #[arg(long, conflicts_with = "ascii")]
    pub big_endian: bool,
    /// As text
    #[arg(long)]
    pub ascii: bool,
    /// Coordinates as double, not float
    #[arg(long)]
    pub double: bool,
    /// Added to all coordinates, as of a georeferenced scan (with --double)
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, default_value = "0,0,0", allow_hyphen_values = true)]
    pub offset: DVec3,
}

impl Recipe {
    /// The base with its holes.
    ///
    /// # Errors
    /// A line that says which option has no meaning.
    pub fn prepared(&self, base: Base) -> Result<Base, String> {
        let is_height = |value: f64| value.is_finite() && value >= 0.0;
        if !self.amplitude.is_none_or(is_height) || !is_height(self.wavelength) || self.wavelength == 0.0 {
            return Err("--amplitude is not below zero, --wavelength above".to_string());
        }
        Ok(if self.holes > 0.0 { base.with_holes(self.holes, mix2(self.seed, 1)) } else { base })
    }

    /// The numbers of vertices and faces over a prepared base.
    ///
    /// # Errors
    /// A line that says what is too large.
    pub fn counts(&self, base: &Base) -> Result<Counts, String> {
        let numbering = self.numbering(base)?;
        Ok(Counts { vertices: numbering.vertex_count(), faces: numbering.face_count() })
    }

    /// Writes the mesh over a prepared base that is called `name`.
    ///
    /// # Errors
    /// Outer: a line that says what is too large; inner: the writer's.
    pub fn grow(
        &self,
        base: &Base,
        name: &str,
        out: &mut (impl Write + Send),
    ) -> Result<io::Result<()>, String> {
        let numbering = self.numbering(base)?;
        let counts = self.counts(base)?;
        let looks = self.looks(base);
        let surface = Surface { base, noise: Noise::new(looks, mix2(self.seed, 0)), k: self.k };
        let order = self.shuffle.then(|| Order::new(counts.faces, mix2(self.seed, 3)));
        let format =
            Format { encoding: self.encoding(), double: self.double, comments: self.comments(base, name) };
        let vertex = |number| surface.at(numbering.place(number)) + self.offset;
        let face = |number| numbering.face(order.as_ref().map_or(number, |order| order.at(number)));
        Ok(ply::write(out, &format, counts, vertex, face))
    }

    fn numbering<'a>(&self, base: &'a Base) -> Result<Numbering<'a>, String> {
        let flaws = Flaws { slivers: self.slivers, duplicates: self.duplicates, seed: mix2(self.seed, 2) };
        Numbering::new(base, self.k, flaws)
    }

    fn looks(&self, base: &Base) -> Looks {
        let height = self.amplitude.unwrap_or(0.0) * base.mean_edge;
        let looks = Looks { wavelength: self.wavelength * base.mean_edge, octaves: self.octaves, height };
        if self.amplitude.is_some() { looks } else { looks.with_slope(SLOPE) }
    }

    fn encoding(&self) -> Encoding {
        match (self.ascii, self.big_endian) {
            (true, _) => Encoding::Ascii,
            (_, true) => Encoding::Big,
            _ => Encoding::Little,
        }
    }

    /// Lines of the header: from what, and how.
    fn comments(&self, base: &Base, name: &str) -> Vec<String> {
        let (looks, count) = (self.looks(base), base.triangles.len());
        let plain: String = name.chars().map(|c| if c.is_ascii_graphic() { c } else { '_' }).collect();
        vec![
            format!(
                "grow_mesh: {plain}, {count} triangles into {} x {} parts each, seed {}",
                self.k, self.k, self.seed
            ),
            format!(
                "noise of {} octaves from {} mean edges on, {:.4} high, slope {:.3}; mean edge {:.6}",
                self.octaves,
                self.wavelength,
                looks.height / base.mean_edge,
                looks.slope(),
                base.mean_edge
            ),
            format!(
                "holes {}, slivers {}, duplicates {}, {}, offset {}",
                self.holes,
                self.slivers,
                self.duplicates,
                if self.shuffle { "shuffled" } else { "in order" },
                self.offset
            ),
        ]
    }
}

fn share(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_string())?;
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err("a share lies between 0 and 1".to_string()) }
}

fn vector(text: &str) -> Result<DVec3, String> {
    let values: Vec<f64> = text
        .split(',')
        .map(|word| word.trim().parse())
        .collect::<Result<_, _>>()
        .map_err(|_| "not numbers")?;
    match values[..] {
        [x, y, z] if values.iter().all(|v| v.is_finite()) => Ok(DVec3::new(x, y, z)),
        _ => Err("three numbers are wanted".to_string()),
    }
}

#[cfg(test)]
#[path = "recipe_tests.rs"]
mod tests;
