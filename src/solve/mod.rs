//! The solution of B = E + ρRB and its evaluation at any point.

mod crowd;
pub mod field;
mod gather;
pub mod iterate;
pub mod light;
pub mod relight;
pub mod surplus;
pub mod transport;

use std::convert::Infallible;

use glam::Mat3;
use rayon::prelude::*;

pub use field::{Field, Irradiance};

use crate::light::Rgb;
use crate::links::Surroundings;
use crate::links::direct::Direct;
use crate::links::lamps::Lamp;
use crate::links::receivers::Receivers;
use crate::links::spread::Spread;
use crate::scene::Sky;
use iterate::{IterateParams, IterateReport};
use light::RowLight;
use transport::Transport;

/// Everything that stays fixed while light changes, and the light itself.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    /// Geometry, sites and their cells.
    pub around: Surroundings<'a>,
    /// Receivers and their rows.
    pub receivers: &'a Receivers,
    /// Interpolation to sites.
    pub spread: &'a Spread,
    /// Lamps, aimed at.
    pub lamps: &'a [Lamp],
    /// How the sites see them.
    pub direct: &'a Direct,
    /// Albedo per site.
    pub albedo: &'a [Rgb],
    /// Exitance per site, of surfaces whose emission the rows meet.
    pub exitance: &'a [Rgb],
    /// Light from outside.
    pub sky: Option<&'a Sky>,
}

/// Light at receivers and sites.
#[derive(Debug, Clone, Default)]
pub struct Solution {
    /// Irradiance at receivers from surfaces and sky, W·m⁻².
    pub irradiance: Vec<Rgb>,
    /// Its change with the normal: H(n′) ≈ H(n) + gradient · (n′ − n).
    pub gradient: Vec<Mat3>,
    /// Share of the sky that each receiver sees, weighted by the cosine.
    pub sky_visibility: Vec<f32>,
    /// Standard error of each row's mean channel by its own rays, W·m⁻².
    pub noise: Vec<f32>,
    /// Root mean square difference of the mean channel between a receiver's row and its neighbours' fit.
    pub surplus: Vec<f32>,
    /// Radiosity per site, without the lamps' own exitance.
    pub radiosity: Vec<Rgb>,
    /// Mean irradiance where surfaces exchange light: what relative errors are relative to, W·m⁻².
    pub level: f32,
}

impl Problem<'_> {
    /// Solves for the light.
    pub fn solve(&self, params: &IterateParams) -> (Solution, IterateReport) {
        let gather = |radiosity: &[Rgb]| Ok::<_, Infallible>(self.gather(radiosity));
        let Ok(solved) = self.solve_by(gather, params);
        solved
    }

    /// Irradiance at receivers by their rows, from the sites' radiosity: one product with R.
    pub fn gather(&self, radiosity: &[Rgb]) -> Vec<Rgb> {
        self.transport().gather(radiosity)
    }

    fn transport(&self) -> Transport<'_> {
        Transport { receivers: self.receivers, spread: self.spread, albedo: self.albedo }
    }

    /// Solves for the light with another map from the sites' radiosity to irradiance at receivers, which may fail.
    ///
    /// # Errors
    /// What `gather` says.
    pub fn solve_by<E>(
        &self,
        gather: impl Fn(&[Rgb]) -> Result<Vec<Rgb>, E>,
        params: &IterateParams,
    ) -> Result<(Solution, IterateReport), E> {
        let transport = self.transport();
        let own = self.unreflected();
        let sky = self.sky_light();
        let mut first = gather(&own)?;
        first.iter_mut().zip(&sky).for_each(|(f, s)| *f += *s);
        let (irradiance, report) =
            iterate::try_solve(|x| gather(&transport.pull(&transport.push(x), None)), &first, params)?;
        let irradiance = irradiance.into_iter().map(|h| h.max(Rgb::ZERO)).collect();
        Ok((self.complete(irradiance, &own), report))
    }

    /// Everything that answers need, from the irradiance at receivers and the sites' radiosity before any interreflection.
    fn complete(&self, irradiance: Vec<Rgb>, own: &[Rgb]) -> Solution {
        let transport = self.transport();
        let irradiance_at_sites = transport.push(&irradiance);
        let radiosity = transport.pull(&irradiance_at_sites, Some(own));
        let mut solution = Solution { radiosity, ..Solution::default() };
        solution.level = self.level(&irradiance_at_sites);
        for (light, irradiance) in
            self.row_lights(0..self.receivers.len(), &solution.radiosity).into_iter().zip(irradiance)
        {
            solution.add(RowLight { irradiance, ..light });
        }
        solution.surplus = self.surplus(&solution);
        solution
    }

    /// Radiosity of the sites before any interreflection: glow, and the lamps' light reflected once.
    pub fn unreflected(&self) -> Vec<Rgb> {
        (0..self.around.sites.len())
            .into_par_iter()
            .map(|site| self.exitance[site] + self.albedo[site] * self.direct.at_site(self.lamps, site))
            .collect()
    }

    /// How much the surface around each site counts: its area times the share of rays that meet surfaces there. An endless
    /// plane under an open sky has area without end and nothing to get wrong.
    pub fn exchange(&self) -> Vec<f64> {
        let share = |(&r, &w): (&u32, &f32)| {
            let (rows, r) = self.receivers.row(r as usize);
            rows.summaries[r].hits as f32 / rows.rays as f32 * w
        };
        (0..self.around.sites.len())
            .map(|site| {
                let weights = self.spread.weights_of(site);
                let share: f32 = self.spread.receivers_of(site).iter().zip(weights).map(share).sum();
                f64::from(self.around.sites.areas[site] * share)
            })
            .collect()
    }

    /// Mean irradiance of the lit sites, by exchange.
    fn level(&self, indirect: &[Rgb]) -> f32 {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (site, exchange) in self.exchange().into_iter().enumerate() {
            let light = indirect[site] + self.direct.at_site(self.lamps, site);
            if light.max_element() > 0.0 {
                sum += exchange * f64::from(crate::light::mean_channel(light));
                weight += exchange;
            }
        }
        if weight > 0.0 { (sum / weight) as f32 } else { 0.0 }
    }
}
