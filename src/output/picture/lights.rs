//! Pictures of lights each by itself, which are added up to pictures of them together.

use super::film::Film;
use super::layers::LightLayer;
use crate::light::{Rgb, mean_channel};

/// What a camera sees of one light alone, as bright as one.
#[derive(Debug, Clone, PartialEq)]
pub struct LightFilm {
    name: String,
    /// Per pixel, W·m⁻²·sr⁻¹ per unit of the light.
    direct: Vec<Rgb>,
    indirect: Vec<Rgb>,
    /// Standard error of the mean channel.
    error: Vec<f32>,
}

impl LightFilm {
    /// Of a picture under nothing but this light; 28 B a pixel.
    pub fn new(name: String, film: &Film) -> Self {
        Self {
            name,
            direct: film.pixels.iter().map(|pixel| pixel.direct).collect(),
            indirect: film.pixels.iter().map(|pixel| pixel.indirect).collect(),
            error: film.pixels.iter().map(|pixel| pixel.error).collect(),
        }
    }

    /// What the light, times `tint` by channel, brings.
    pub fn layer(&self, tint: Rgb) -> LightLayer {
        let radiance = self.direct.iter().zip(&self.indirect).map(|(a, b)| (*a + *b) * tint).collect();
        LightLayer { name: self.name.clone(), radiance }
    }
}

/// The picture under several lights, each times a colour by channel; `base` says what else is seen. Errors are added up: those of one
/// surface under several lights are alike.
///
/// # Panics
/// When the pictures are not of one size.
pub fn together(base: &Film, lights: &[(&LightFilm, Rgb)]) -> Film {
    let mut film = base.clone();
    for (k, pixel) in film.pixels.iter_mut().enumerate() {
        (pixel.direct, pixel.indirect, pixel.error) = (Rgb::ZERO, Rgb::ZERO, 0.0);
        for (light, tint) in lights {
            pixel.direct += light.direct[k] * *tint;
            pixel.indirect += light.indirect[k] * *tint;
            pixel.error += light.error[k] * mean_channel(*tint);
        }
    }
    film
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::picture::film::Pixel;

    #[test]
    fn lights_add_up_by_channel() {
        let pixel = |direct: f32, error: f32| Pixel {
            direct: Rgb::splat(direct),
            indirect: Rgb::splat(0.5 * direct),
            depth: 3.0,
            error,
            ..Pixel::default()
        };
        let film = |direct: f32| Film { width: 1, height: 1, pixels: vec![pixel(direct, 0.1 * direct)] };
        let [a, b] = [1.0, 2.0].map(|direct| LightFilm::new(format!("{direct}"), &film(direct)));
        let tints = [Rgb::new(1.0, 0.0, 2.0), Rgb::new(0.0, 3.0, 1.0)];
        let sum = together(&film(7.0), &[(&a, tints[0]), (&b, tints[1])]).pixels[0];
        // Small whole numbers and halves are exact; the error is 0.1 · 1 + 0.2 · 4/3 within rounding.
        assert_eq!((sum.direct, sum.indirect), (Rgb::new(1.0, 6.0, 4.0), Rgb::new(0.5, 3.0, 2.0)));
        assert!((sum.error - (0.1 + 0.2 * 4.0 / 3.0)).abs() < 1e-6 && sum.depth == 3.0);
        let layers = [a.layer(tints[0]), b.layer(tints[1])];
        assert_eq!(layers[0].radiance[0] + layers[1].radiance[0], sum.radiance());
    }
}
