//! Skies seen by their spherical harmonics: what each function does everywhere is found once, and a sky that is turned, tinted or
//! another is a sum.
//!
//! This work is based on: Sloan, Kautz and Snyder, "Precomputed Radiance Transfer", SIGGRAPH 2002.
//!
//! The functions are solved for as they are, negative light included: products and GMRES are linear, and errors are relative to a
//! function's own light. Skies 1 + Y/c, less the constant one, would need no sign, but a solution more, and their errors are
//! those of the greater light (docs/theory.md, relighting).

use std::sync::Arc;

use rayon::prelude::*;

use super::origins::{Origin, is_lit, switches, tint};
use super::{Lighting, Paint, RelightReport, Relighter, TOGETHER};
use crate::archive::Pause;
use crate::error::{Error, Result};
use crate::light::Rgb;
use crate::light::harmonics::{Harmonics, MOST, MOST_ORDER};
use crate::scene::{Sky, sky};
use crate::solve::relight::{Source, Transfer};

/// Rows of the image that rays of points look at: bilinear look-ups then err by 10⁻⁴ of the third wave around.
const ROWS: u32 = 256;

/// Values added up by one task.
const RUN: usize = 1 << 14;

impl Relighter {
    /// Solves for skies that are one of the spherical harmonics each, of `order` bands (1 to 4): order² of them. From then on
    /// skies seen by as many bands or fewer ([`super::SkyLight::harmonics`]) are sums, whichever they are and however turned. New
    /// albedos make it void.
    ///
    /// Cost: a bake's solution for every five functions. Memory: 12 B a site and receiver for each.
    ///
    /// # Errors
    /// [`Error::Usage`] for other numbers of bands.
    pub fn prepare_sky(&mut self, order: usize) -> Result<RelightReport> {
        self.prepare_sky_with(order, &|| Ok(()))
    }

    /// As [`Relighter::prepare_sky`], asking `pause` before every product.
    ///
    /// # Errors
    /// As there, and what `pause` says.
    pub fn prepare_sky_with(&mut self, order: usize, pause: Pause<'_>) -> Result<RelightReport> {
        if !(1..=MOST_ORDER).contains(&order) {
            return Err(Error::Usage(format!("a sky has 1 to {MOST_ORDER} bands of harmonics, not {order}")));
        }
        self.prepare_each((0..order * order).map(Origin::Harmonic).collect(), pause)
    }

    /// What a sky does everywhere that is one of the harmonics, in every channel; None before [`Relighter::prepare_sky`].
    pub fn sky_transfer(&self, number: usize) -> Option<&Transfer> {
        self.transfers.iter().find(|(own, _)| *own == Origin::Harmonic(number)).map(|(_, transfer)| transfer)
    }

    /// The harmonics of a lighting's sky, tinted and turned, of as many bands as are asked for: the weights of
    /// [`Relighter::sky_transfer`]. None without a sky.
    pub fn sky_harmonics(&mut self, lighting: &Lighting, order: usize) -> Option<Harmonics> {
        let light = tint(lighting, Origin::Sky);
        let whole = self.unit_sky(lighting)?;
        let Sky::Image { image, to_image } = &whole else {
            return Some(whole.harmonics(self.baked.up, order).tinted(light));
        };
        if self.projected.as_ref().is_none_or(|(of, _)| !Arc::ptr_eq(of, image)) {
            let own = Harmonics::project(image.width as usize, &image.pixels, MOST_ORDER);
            self.projected = Some((Arc::clone(image), own));
        }
        let (_, own) = self.projected.as_ref()?;
        Some(own.turned(sky::rotation(to_image, self.baked.up)).truncated(order).tinted(light))
    }

    /// The weights of the harmonics that the sky of now is seen by; None where it is seen as it is.
    pub(super) fn sky_coefficients(&mut self) -> Option<Vec<Rgb>> {
        let order = self.now.sky.as_ref()?.harmonics?;
        let lighting = self.now.clone();
        self.sky_harmonics(&lighting, order).map(|own| own.coefficients)
    }

    /// Takes transfers of these lights from the job, as far as it holds them and albedos are those that were baked.
    pub(super) fn recall(&mut self, wanted: &[Origin]) -> Result<()> {
        if self.now.meshes.iter().any(|mesh| mesh.paint != Paint::Baked) {
            return Ok(());
        }
        let Some(stored) = &self.stored else { return Ok(()) };
        for &origin in wanted {
            if self.transfers.iter().all(|(own, _)| *own != origin)
                && let Some(transfer) = stored.transfer(origin)?
            {
                self.transfers.push((origin, transfer));
            }
        }
        Ok(())
    }

    /// Takes the transfers of what shines now from the job, if that and what is known already makes a sum.
    pub(super) fn recall_all(&mut self, coefficients: Option<&[Rgb]>) -> Result<()> {
        let shining: Vec<Origin> = self.shining(coefficients).iter().map(|(origin, _)| *origin).collect();
        let known = |origin: &Origin| self.transfers.iter().any(|(own, _)| own == origin);
        let held = |origin: &Origin| self.stored.as_ref().is_some_and(|stored| stored.holds(*origin));
        if shining.iter().all(|origin| known(origin) || held(origin)) {
            self.recall(&shining)
        } else {
            Ok(())
        }
    }

    /// Solves for the lights that a job for relighting keeps, a few at a time, and hands each over: those that links are known of,
    /// and the harmonics of a sky that is an image, or was asked for.
    pub(in crate::bake) fn each_transfer(
        &mut self,
        pause: Pause<'_>,
        each: &mut dyn FnMut(Origin, &Transfer) -> Result<()>,
    ) -> Result<()> {
        let functions = if self.turns { MOST } else { 0 };
        let lights = switches(&self.baked).into_iter().filter(|origin| self.is_linked(*origin));
        let all: Vec<Origin> = lights.chain((0..functions).map(Origin::Harmonic)).collect();
        for some in all.chunks(TOGETHER) {
            self.prepare_each(some.to_vec(), pause)?;
            for (origin, transfer) in std::mem::take(&mut self.transfers) {
                each(origin, &transfer)?;
            }
        }
        Ok(())
    }

    /// The lights that are lit and how bright they are, the sky by its harmonics where it is seen by them.
    pub(super) fn shining(&self, coefficients: Option<&[Rgb]>) -> Vec<(Origin, Rgb)> {
        let lit = self.origins().into_iter().filter(|origin| is_lit(&self.now, *origin));
        let whole = lit.filter(|origin| *origin != Origin::Sky || coefficients.is_none());
        let parts = coefficients.unwrap_or_default().iter().enumerate();
        let parts = parts.filter(|(_, light)| **light != Rgb::ZERO);
        let parts = parts.map(|(number, light)| (Origin::Harmonic(number), *light));
        whole.map(|origin| (origin, tint(&self.now, origin))).chain(parts).collect()
    }

    /// How bright the lamp of a sky's bright part is: skies that are seen by harmonics have none.
    pub(super) fn bright_strength(&self) -> Rgb {
        let by_harmonics = self.now.sky.as_ref().is_some_and(|sky| sky.harmonics.is_some());
        if by_harmonics { Rgb::ZERO } else { tint(&self.now, Origin::Sky) }
    }

    /// A sky of harmonics as rays see it. No part of it is aimed at.
    pub(super) fn banded_sky(&self, coefficients: Vec<Rgb>) -> Sky {
        let image = Arc::new(sky::panorama(&Harmonics { coefficients }, ROWS));
        Sky::Image { image, to_image: sky::to_image(self.baked.up, 0.0) }
    }

    /// Irradiance at receivers straight from skies of harmonics, one for each function of the most bands.
    fn harmonics_arriving(&mut self) -> &[Vec<f32>] {
        let (model, up) = (&self.model, self.baked.up);
        self.arriving
            .harmonics
            .get_or_insert_with(|| model.problem().harmonic_light(sky::to_harmonics(up), MOST_ORDER))
    }

    /// Irradiance at receivers straight from a sky of these harmonics.
    pub(super) fn harmonic_light(&mut self, coefficients: &[Rgb]) -> Vec<Rgb> {
        let arriving = self.harmonics_arriving();
        let receiver = |r: usize| coefficients.iter().zip(arriving).map(|(c, light)| *c * light[r]).sum();
        let receivers = arriving.first().map_or(0, Vec::len);
        (0..receivers).into_par_iter().with_min_len(RUN).map(receiver).collect()
    }

    /// A sky that is one of the harmonics, in every channel.
    pub(super) fn harmonic_source(&mut self, number: usize) -> Source {
        let sky = self.harmonics_arriving()[number].iter().map(|light| Rgb::splat(*light)).collect();
        Source { own: vec![Rgb::ZERO; self.model.sites.len()], sky }
    }

    /// Says what reading another image of the sky changed, once.
    pub(super) fn warn_of_image(&self, before: &Lighting, report: &mut RelightReport) {
        let image = |lighting: &Lighting| lighting.sky.as_ref().and_then(|sky| sky.image.clone());
        let now = image(&self.now);
        for warning in now.iter().filter(|_| now != image(before)).flat_map(|image| &image.warnings) {
            report.warnings.push(format!("{}: {}", warning.file.display(), warning.message));
        }
    }
}
