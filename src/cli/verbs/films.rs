//! Pictures of each light by itself, by way of a relighter, and the files that their sums become.

use std::path::Path;

use crate::bake::relight::Relighter;
use crate::bake::{Lighting, Monitor as _};
use crate::cli::console::Console;
use crate::error::Result;
use crate::light::Rgb;
use crate::output::Advance;
use crate::output::picture::{Film, LightFilm, Quality, View, layers, lights, png, render};

/// Scenes of more lights get no layers: each takes a picture of its own.
pub const MOST_LIGHTS: usize = 16;

/// What a camera sees of each light.
pub struct Films {
    base: Film,
    /// By their numbers among the tints.
    lights: Vec<(usize, LightFilm)>,
}

/// The numbers of the lights that are lit in some lightings of one scene.
pub fn lit(lightings: &[Lighting]) -> Vec<usize> {
    let mut numbers: Vec<usize> = Vec::new();
    for lighting in lightings {
        let lit = |(k, tint): (usize, Rgb)| (tint.max_element() > 0.0).then_some(k);
        numbers.extend(lighting.tints().into_iter().enumerate().filter_map(lit));
    }
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// Readies a relighter for some lights of a lighting, whatever their strength: from here on it adds them up.
///
/// # Errors
/// Those of [`Relighter::relight_with`]. Returns the rays traced, the products, and the warnings.
pub fn ready(
    relighter: &mut Relighter,
    lighting: &Lighting,
    numbers: &[usize],
    console: &Console,
) -> Result<(u64, usize, Vec<String>)> {
    let mut tints = vec![Rgb::ZERO; lighting.tints().len()];
    numbers.iter().for_each(|&k| tints[k] = Rgb::ONE);
    let linked = relighter.relight_with(&lighting.with_tints(&tints), &|| console.check())?;
    let solved = relighter.prepare_with(&|| console.check())?;
    Ok((linked.rays, linked.iterations + solved.iterations, linked.warnings))
}

impl Films {
    /// Shoots some lights of a lighting for which the relighter is [`ready`], and leaves it in the last one's light.
    ///
    /// Cost: a picture a light.
    ///
    /// # Errors
    /// Those of [`render`] and of [`Relighter::relight_with`].
    pub fn shoot(
        relighter: &mut Relighter,
        (lighting, numbers): (&Lighting, &[usize]),
        view: &View,
        advance: &Advance<'_>,
    ) -> Result<Self> {
        let mut films = Self { base: Film { width: 0, height: 0, pixels: Vec::new() }, lights: Vec::new() };
        for &k in numbers {
            let Some(unit) = lighting.unit(relighter.scene(), k) else { continue };
            relighter.relight_with(&unit.lighting, &|| advance(0))?;
            films.base = film(relighter.model(), view, advance)?;
            films.lights.push((k, LightFilm::new(unit.name, &films.base)));
        }
        Ok(films)
    }

    /// Writes the picture under the strengths of a lighting, with a layer for each light that is lit if it is an EXR.
    ///
    /// # Errors
    /// Input/output errors.
    pub fn write(&self, lighting: &Lighting, exposure: Option<f32>, output: &Path) -> Result<Option<f32>> {
        let tints = lighting.tints();
        let lit =
            || self.lights.iter().map(|(k, film)| (film, tints[*k])).filter(|(_, tint)| *tint != Rgb::ZERO);
        let film = lights::together(&self.base, &lit().collect::<Vec<_>>());
        if is_png(output) {
            return develop(&film, exposure, output).map(Some);
        }
        let layers: Vec<_> = lit().map(|(film, tint)| film.layer(tint)).collect();
        layers::write(output, &film, &layers).map(|()| None)
    }
}

/// What a camera sees of a model.
///
/// # Errors
/// Those of [`render`], and damaged proxies.
pub fn film(model: &crate::bake::model::Model, view: &View, advance: &Advance<'_>) -> Result<Film> {
    let field = model.field();
    let evaluate = |points: &[_]| field.evaluate(points);
    let film = render(&model.scene, &model.bvh, &evaluate, (view, Quality::FINE), advance)?;
    model.bvh.sound()?;
    Ok(film)
}

/// Writes an image for the screen; gives the exposure: the given, or what suits it.
///
/// # Errors
/// Input/output errors.
pub fn develop(film: &Film, exposure: Option<f32>, output: &Path) -> Result<f32> {
    let exposure = exposure.unwrap_or_else(|| film.exposure());
    png::write(output, film, exposure)?;
    Ok(exposure)
}

/// Whether a picture is for the screen alone.
pub fn is_png(output: &Path) -> bool {
    output.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
}
