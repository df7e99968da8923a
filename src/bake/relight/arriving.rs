//! Light that arrives before any interreflection: new albedos leave it as it is, and so does most of what else changes.

use rayon::prelude::*;

use super::origins::{Origin, tint};
use super::{Relighter, Source};
use crate::light::Rgb;
use crate::solve::Problem;

/// Values multiplied by one task.
const RUN: usize = 1 << 14;

/// What is kept of it between changes.
#[derive(Debug, Default)]
pub(super) struct Arriving {
    /// Lamps' light at sites, W·m⁻², with the strengths that it was found for.
    lamps: Option<(Vec<Rgb>, Vec<Rgb>)>,
    /// Irradiance at receivers from what rows meet of the sky, untinted.
    sky: Option<Vec<Rgb>>,
    /// The same of skies that are one of the harmonics each.
    pub harmonics: Option<Vec<Vec<f32>>>,
}

impl Arriving {
    /// Links to lamps are others.
    pub fn forget_lamps(&mut self) {
        self.lamps = None;
    }

    /// The sky is another, not in its tint alone.
    pub fn forget_sky(&mut self) {
        self.sky = None;
    }
}

impl Relighter {
    /// The light of now before any interreflection; the model is that of now.
    ///
    /// Cost: memory's, but where strengths of lamps are others than before, their links, and under another sky the rows.
    pub(super) fn source(&mut self) -> Source {
        let strengths: Vec<Rgb> = self.model.lamps.iter().map(|lamp| lamp.strength).collect();
        if self.arriving.lamps.as_ref().is_none_or(|(known, _)| *known != strengths) {
            self.arriving.lamps = Some((strengths, self.model.problem().lamplight()));
        }
        let sky = match self.sky_coefficients() {
            Some(coefficients) => self.harmonic_light(&coefficients),
            None => self.sky_light(tint(&self.now, Origin::Sky)),
        };
        let lamps = self.arriving.lamps.as_ref().map_or(&[][..], |(_, light)| light);
        let (albedo, exitance) = (&self.model.albedo, &self.model.exitance);
        let own = |site: usize| exitance[site] + albedo[site] * lamps[site];
        let own = (0..albedo.len()).into_par_iter().with_min_len(RUN).map(own).collect();
        Source { own, sky }
    }

    /// Irradiance at receivers from what rows meet of the sky, times `by`; empty without any.
    pub(super) fn sky_light(&mut self, by: Rgb) -> Vec<Rgb> {
        let Some(sky) = self.sky.0.as_ref().filter(|_| by.max_element() > 0.0) else { return Vec::new() };
        let model = &self.model;
        let unit =
            self.arriving.sky.get_or_insert_with(|| Problem { sky: Some(sky), ..model.problem() }.skylight());
        unit.par_iter().with_min_len(RUN).map(|light| *light * by).collect()
    }
}
