//! The dense operator of points: every receiver against every site, by the kernel alone. For small scenes and comparisons.
//!
//! This work is based on: the seed paper's formula (3), G_ij = cos θ cos θ′ V / (π d²), with the areas that it leaves out, and
//! Cohen and Greenberg, "The hemi-cube", 1985 (what is wrong with it: the kernel at centres stands for its mean over areas only
//! when they are far apart, five to eight of their sizes for a hundredth).

use std::fmt;
use std::str::FromStr;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Surroundings;
use super::receivers::Receivers;
use crate::geometry::SurfacePoint;
use crate::light::Rgb;
use crate::sites::SiteId;
use crate::sites::neighbours::mutually_visible;

/// What turns radiosity of sites into irradiance at receivers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Operator {
    /// Rows of rays over the hemisphere: a contraction.
    #[default]
    Rows,
    /// The kernel between points: a comparison, not a contraction.
    Dense,
}

impl Operator {
    /// All operators, the default first.
    pub const ALL: [Self; 2] = [Self::Rows, Self::Dense];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rows => "rows",
            Self::Dense => "dense",
        }
    }
}

impl fmt::Display for Operator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Operator {
    type Err = String;

    /// The operator of a name as [`Operator::name`] gives it; the error lists the names.
    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|o| o.name() == text);
        found.ok_or_else(|| format!("expected one of {}, got `{text}`", Self::ALL.map(Self::name).join(", ")))
    }
}

/// More sites than this are refused: each meets every receiver, by a ray.
pub const MOST_SITES: usize = 8192;

/// G as a dense matrix, receivers by sites.
pub struct Dense {
    sites: usize,
    couplings: Vec<f32>,
}

/// The share of a point's irradiance that an area around another brings per radiosity, both taken at their centres, whatever
/// lies between: cos θ cos θ′ A / (π d²).
pub fn coupling(receiver: &SurfacePoint, source: &SurfacePoint, area: f32) -> f32 {
    let d = source.position - receiver.position;
    let square = d.length_squared();
    let (here, there) = (d.dot(receiver.normal), -d.dot(source.normal));
    if here <= 0.0 || there <= 0.0 {
        return 0.0;
    }
    here * there * area / (std::f32::consts::PI * square * square)
}

impl Dense {
    /// Couples every receiver to every site that it sees.
    ///
    /// Cost: a ray a pair that faces each other, 4 bytes a pair. The same for any number of threads.
    pub fn couple(around: Surroundings<'_>, receivers: &Receivers) -> Self {
        let sites = around.sites.len();
        let row = |support: &crate::tree::Support| -> Vec<f32> {
            (0..sites)
                .map(|site| {
                    let there = around.sites.point(SiteId(site as u32));
                    let coupling = coupling(&support.point, &there, around.sites.areas[site]);
                    let seen =
                        coupling > 0.0 && mutually_visible(support.point, there, receivers.lift, around.bvh);
                    if seen { coupling } else { 0.0 }
                })
                .collect()
        };
        let couplings = receivers.index.supports().par_iter().with_min_len(4).flat_map_iter(row).collect();
        Self { sites, couplings }
    }

    /// Irradiance at receivers from the sites' radiosity: G·B.
    pub fn gather(&self, radiosity: &[Rgb]) -> Vec<Rgb> {
        let row = |row: &[f32]| {
            let mut sum = [0.0f64; 3];
            for (g, b) in row.iter().zip(radiosity) {
                (0..3).for_each(|c| sum[c] += f64::from(g * b[c]));
            }
            Rgb::from_array(sum.map(|s| s as f32))
        };
        self.couplings.par_chunks(self.sites.max(1)).map(row).collect()
    }

    /// The largest sum of a row: times the albedo, a bound of the norm. Above one the operator makes light.
    pub fn largest_row_sum(&self) -> f64 {
        let sums = self.couplings.par_chunks(self.sites.max(1));
        sums.map(|row| row.iter().copied().map(f64::from).sum()).reduce(|| 0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn centres_of_near_squares_exaggerate() {
        let at = |z: f32, normal| SurfacePoint { position: Vec3::Z * z, normal };
        let facing = |d: f32| coupling(&at(0.0, Vec3::Z), &at(d, -Vec3::Z), 1.0);
        // Howell's catalogue: 0.199825 between facing unit squares at distance one; 1/π is 59 % more.
        assert!((facing(1.0) / 0.199_825 - 1.593).abs() < 1e-3);
        // An element under the centre of a unit square at height eight sees 0.0049479: within one percent there.
        let exact = {
            let half = 0.5 / 8.0f64;
            4.0 / std::f64::consts::TAU * 2.0 * half / half.hypot(1.0) * (half / half.hypot(1.0)).atan()
        };
        assert!((f64::from(facing(8.0)) / exact - 1.0).abs() < 0.01);
        assert_eq!(coupling(&at(0.0, Vec3::Z), &at(1.0, Vec3::Z), 1.0), 0.0);
    }

    #[test]
    fn names_read_back() {
        for operator in Operator::ALL {
            assert_eq!(operator.to_string().parse::<Operator>(), Ok(operator));
        }
        assert!("cube".parse::<Operator>().unwrap_err().contains("rows, dense"));
    }
}
