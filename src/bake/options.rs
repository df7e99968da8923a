//! What a bake is asked for.

use serde::{Deserialize, Serialize};

use super::relight::switches;
use crate::basis::Basis;
use crate::links::points::Operator;
use crate::scene::Scene;

/// The options of one bake. Those that change the result are stored with the job and compared on resuming
/// ([`Options::difference`]); the rest say how this one run behaves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Target relative RMS error of irradiance (0.02 = 2 %).
    pub error: f64,
    /// Bounces of light followed at the most; `None` iterates until converged.
    pub max_bounces: Option<u32>,
    /// Keys every random number.
    pub seed: u64,
    /// How light is interpolated.
    #[serde(default, skip_serializing_if = "is_default")]
    pub basis: Basis,
    /// What turns radiosity into irradiance.
    #[serde(default, skip_serializing_if = "is_default")]
    pub operator: Operator,
    /// PLY meshes of more triangles than this stay in their files; 500,000 when `None`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub resident: Option<u64>,
    /// Triangles of the proxy of a mesh that stays in its file, about; by the error target when `None`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub proxy: Option<u64>,
    /// Refine against each light by itself, so that every combination of them is within the target; `None` does where a scene
    /// has some, but not many ([`Options::is_relightable`]).
    #[serde(default, skip_serializing_if = "is_default")]
    pub relightable: Option<bool>,
    /// Anonymous memory the bake may use, bytes; `None` sets no limit. Does not change the result.
    #[serde(skip)]
    pub max_memory_bytes: Option<u64>,
    /// Bake anew; what the job directory holds is kept until the new job is complete.
    #[serde(skip)]
    pub restart: bool,
    /// Write `preview.png` and `mesh.ply` into the job when done.
    #[serde(skip)]
    pub preview: bool,
}

/// The default is not written, so that jobs from before there was a choice answer as they did.
fn is_default<T: Default + PartialEq>(choice: &T) -> bool {
    *choice == T::default()
}

impl Default for Options {
    /// Two percent, all bounces, seed 0.
    fn default() -> Self {
        Self {
            error: 0.02,
            max_bounces: None,
            seed: 0,
            basis: Basis::default(),
            operator: Operator::default(),
            resident: None,
            proxy: None,
            relightable: None,
            max_memory_bytes: None,
            restart: false,
            preview: true,
        }
    }
}

/// Meshes of more triangles stay in their files: their vertices are dense and share rows, which costs less than what is held
/// takes from there on (docs/scaling.md).
const RESIDENT: u64 = 500_000;

/// Scenes of more lights are made for relighting only when asked: each light is solved for by itself.
const MOST_SWITCHED: usize = 16;

impl Options {
    /// Whether the bake is meant for relighting: as asked, or when the scene has 2 to 16 lights. Lamps count, and the sky,
    /// though they be off; meshes count that emit.
    pub fn is_relightable(&self, scene: &Scene) -> bool {
        let lights = || switches(scene).len();
        self.relightable.unwrap_or_else(|| (2..=MOST_SWITCHED).contains(&lights()))
    }

    /// The most triangles of a mesh that is read into memory.
    pub fn resident(&self) -> u64 {
        self.resident.unwrap_or(RESIDENT)
    }

    /// How the options that change the result differ from those `stored` with a job, in the words of the command
    /// line; `None` when the stored job answers this request.
    pub fn difference(&self, stored: &Self) -> Option<String> {
        let bounces = |limit: Option<u32>| limit.map_or("none".to_owned(), |n| n.to_string());
        let proxy = |wanted: Option<u64>| wanted.map_or("by --error".to_owned(), |n| n.to_string());
        let relightable = |choice: Option<bool>| choice.map_or("by the scene".to_owned(), |c| c.to_string());
        let pairs = [
            ("--error", stored.error.to_string(), self.error.to_string()),
            ("--max-bounces", bounces(stored.max_bounces), bounces(self.max_bounces)),
            ("--seed", stored.seed.to_string(), self.seed.to_string()),
            ("--basis", stored.basis.to_string(), self.basis.to_string()),
            ("--resident", stored.resident().to_string(), self.resident().to_string()),
            ("--proxy", proxy(stored.proxy), proxy(self.proxy)),
            ("--relightable", relightable(stored.relightable), relightable(self.relightable)),
            ("--operator", stored.operator.to_string(), self.operator.to_string()),
        ];
        let lines: Vec<String> = pairs
            .into_iter()
            .filter(|(_, there, here)| there != here)
            .map(|(name, there, here)| format!("{name} was {there}, now {here}"))
            .collect();
        (!lines.is_empty()).then(|| lines.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_options_that_change_the_result_make_a_difference() {
        let stored = Options::default();
        let same = Options { restart: true, preview: false, max_memory_bytes: Some(1), ..Options::default() };
        assert_eq!(same.difference(&stored), None);
        let other = Options { error: 0.01, seed: 7, ..Options::default() };
        assert_eq!(
            other.difference(&stored).as_deref(),
            Some("--error was 0.02, now 0.01, --seed was 0, now 7")
        );
        let radial = Options { basis: Basis::Radial, ..Options::default() };
        assert_eq!(radial.difference(&stored).as_deref(), Some("--basis was hierarchical, now radial"));
    }

    #[test]
    fn stored_options_read_back() {
        let options = Options { error: 0.01, max_bounces: Some(3), seed: u64::MAX, ..Options::default() };
        let text = serde_json::to_string(&options).unwrap();
        assert_eq!(serde_json::from_str::<Options>(&text).unwrap().difference(&options), None);
        assert!(
            !text.contains("basis") && !text.contains("operator"),
            "options from before there were bases stay the same: {text}"
        );
        let shepard = Options { basis: Basis::Shepard, ..options };
        let text = serde_json::to_string(&shepard).unwrap();
        assert_eq!(serde_json::from_str::<Options>(&text).unwrap().basis, Basis::Shepard);
    }
}
