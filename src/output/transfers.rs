//! Precomputed transfer of vertices: what skies of spherical harmonics do at each, as `docs/transfer.md` has it.

use crate::light::Rgb;

/// Radiosity of each vertex under skies that are one of the harmonics each; none of them unless asked for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VertexTransfers {
    /// By function, then by vertex: W·m⁻² for a coefficient of 1 W·m⁻²·sr⁻¹·√sr.
    pub columns: Vec<Vec<Rgb>>,
}

impl VertexTransfers {
    /// Bytes that a vertex gains.
    pub fn bytes(&self) -> u64 {
        12 * self.columns.len() as u64
    }

    /// Remarks for the head of a PLY: the convention on a few lines.
    pub fn comments(&self) -> String {
        if self.columns.is_empty() {
            return String::new();
        }
        format!(
            "comment glowtree: transfer_i is the radiosity in W/m^2 under a sky of radiance Y_i, all bounces, i = l(l+1)+m, {} \
             functions\n\
             comment glowtree: radiosity under a sky of coefficients L_i is the sum of L_i transfer_i by channel, lamps apart\n\
             comment glowtree: Y_i real, orthonormal, signs of Sloan 2008, third axis the scene's up, docs/transfer.md\n",
            self.columns.len()
        )
    }

    /// The PLY's properties.
    pub(super) fn lines(&self) -> String {
        let line = |k: usize| ["r", "g", "b"].map(|c| format!("property float transfer_{k}_{c}\n")).concat();
        (0..self.columns.len()).map(line).collect()
    }

    /// Appends a vertex's values.
    pub(super) fn put(&self, vertex: usize, row: &mut Vec<u8>) {
        for column in &self.columns {
            column[vertex].to_array().into_iter().for_each(|value| row.extend(value.to_le_bytes()));
        }
    }
}
