//! Answers at points under each of the harmonics: precomputed transfer of vertices.

use std::sync::OnceLock;

use super::lighting::with_strength;
use super::{Lighting, Relighter, SkyLight};
use crate::archive::Pause;
use crate::bake::model::Model;
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::light::harmonics::Harmonics;
use crate::solve::field::Judge;
use crate::solve::{Field, Irradiance};

/// What is asked about one function: its number, the model with no light of its own, and what answers for points.
pub type EachSky<'a> =
    dyn FnMut(usize, &Model, &(dyn Fn(&[SurfacePoint]) -> Vec<Irradiance> + Sync)) -> Result<()> + 'a;

impl Relighter {
    /// Calls `each` for every function of `order` bands with what answers for surface points under a sky of just that radiance, all
    /// bounces, no other light. Answers are linear: where points gather for themselves is decided once, by the light of an
    /// even sky. The light of now is then as it was.
    ///
    /// Cost: [`Relighter::prepare_sky`], some products a function, and what `each` asks: points are answered as
    /// [`Field::evaluate_crowd`] answers them, once for each function.
    ///
    /// # Errors
    /// Those of [`Relighter::prepare_sky`], and what `pause` and `each` say.
    pub fn each_sky(&mut self, order: usize, pause: Pause<'_>, each: &mut EachSky<'_>) -> Result<()> {
        self.prepare_sky_with(order, pause)?;
        let before = self.now.clone();
        self.relight_with(&self.even_sky(order), pause)?;
        let even = self.model().solution.clone();
        let even_sky = self.banded_sky(Harmonics::constant(Rgb::ONE, order).coefficients);
        let mut outcome = Ok(());
        for number in 0..order * order {
            let Some(irradiance) = self.sky_transfer(number).map(|transfer| transfer.irradiance.clone())
            else {
                continue;
            };
            self.model.direct.sky = Some(self.banded_sky(Harmonics::unit(number, order).coefficients));
            self.model.solution = self.model.problem().completed(irradiance);
            self.model.smooth = OnceLock::new();
            let judge = Some(Judge { solution: &even, sky: &even_sky });
            let field = Field { judge, ..self.model.field() };
            let evaluate = |points: &[SurfacePoint]| field.evaluate_crowd(&self.model.set_down(points));
            outcome = each(number, &self.model, &evaluate);
            if outcome.is_err() {
                break;
            }
        }
        self.synced = false;
        self.relight_with(&before, pause)?;
        outcome
    }

    /// An even sky seen by its harmonics, and no other light.
    fn even_sky(&self, order: usize) -> Lighting {
        let mut lighting = self.now.clone();
        lighting.meshes.iter_mut().for_each(|mesh| mesh.radiance = Rgb::ZERO);
        lighting.lamps.iter_mut().for_each(|lamp| *lamp = with_strength(lamp, Rgb::ZERO));
        lighting.sky = Some(SkyLight { constant: Some(Rgb::ONE), harmonics: Some(order), ..SkyLight::DARK });
        lighting
    }
}
