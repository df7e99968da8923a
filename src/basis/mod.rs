//! Bases: how values at scattered supports become a function on the surface.
//!
//! This work is based on: Gortler, Schröder, Cohen and Hanrahan, "Wavelet Radiosity", 1993 (a basis is a choice, the operator
//! is not), and Lehtinen et al., "A Meshless Hierarchical Representation for Light Transport", 2008 (scattered points can be
//! that basis). The theory of each, its costs and where it breaks: `docs/bases.md`.

pub mod hierarchical;
pub mod kernels;
pub mod levels;
pub mod multistep;
pub mod radial;
pub mod shepard;
pub mod system;

use std::fmt;
use std::str::FromStr;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::geometry::SurfacePoint;
use crate::tree::Support;

/// The bases that a bake may be asked for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Basis {
    /// Graded supports level by level, a linear fit with rotational gradients on the finest that reach: the default.
    #[default]
    Hierarchical,
    /// Franke–Little weights: an average, never outside of its data.
    Shepard,
    /// One interpolant of compact radial functions through all supports.
    Radial,
    /// Residuals interpolated over nested supports, coarse to fine.
    Multistep,
}

impl Basis {
    /// All bases, the default first.
    pub const ALL: [Self; 4] = [Self::Hierarchical, Self::Shepard, Self::Radial, Self::Multistep];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hierarchical => "hierarchical",
            Self::Shepard => "shepard",
            Self::Radial => "radial",
            Self::Multistep => "multistep",
        }
    }

    /// Whether one function is fitted through all supports at once, by linear systems.
    pub fn is_global(self) -> bool {
        matches!(self, Self::Radial | Self::Multistep)
    }
}

impl fmt::Display for Basis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Basis {
    type Err = String;

    /// The basis of a name as [`Basis::name`] gives it; the error lists the names.
    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|b| b.name() == text)
            .ok_or_else(|| format!("expected one of {}, got `{text}`", Self::ALL.map(Self::name).join(", ")))
    }
}

/// A function on the surface, made of values at supports, `C` channels at once.
pub trait Reconstruction<const C: usize>: Send + Sync {
    /// Its value at a point; None where no support reaches.
    fn at(&self, point: &SurfacePoint) -> Option<[f64; C]>;

    /// Its values at points, in order and in parallel; the same for any number of threads.
    fn evaluate(&self, points: &[SurfacePoint]) -> Vec<Option<[f64; C]>> {
        points.par_iter().with_min_len(64).map(|p| self.at(p)).collect()
    }
}

/// Fits the function of a global basis through values at supports; None for the bases that need no fit.
///
/// Cost: sparse factorisations, see [`radial`] and [`multistep`]. Memory: about 2 kB a support. Errors with a description when
/// a system cannot be factored.
pub fn fit<const C: usize>(
    basis: Basis,
    supports: &[Support],
    values: &[[f64; C]],
) -> Result<Option<Box<dyn Reconstruction<C>>>, String> {
    Ok(match basis {
        Basis::Hierarchical | Basis::Shepard => None,
        Basis::Radial => Some(Box::new(radial::Radial::graded(supports, values)?)),
        Basis::Multistep => {
            Some(Box::new(multistep::Multistep::fit(supports, values, &multistep::Steps::graded(supports))?))
        }
    })
}

/// Adds `weight · values` to a sum.
fn add<const C: usize>(sum: &mut [f64; C], weight: f64, values: &[f64; C]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back() {
        for basis in Basis::ALL {
            assert_eq!(basis.to_string().parse::<Basis>(), Ok(basis));
        }
        assert_eq!(Basis::default(), Basis::ALL[0]);
        assert!("wavelet".parse::<Basis>().unwrap_err().contains("hierarchical, shepard, radial, multistep"));
    }
}
