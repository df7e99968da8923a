//! Vertices without light, as those under what stands on a surface: they would darken it as far as the next vertex.

use super::ViewMesh;
use crate::light::Rgb;

/// Irradiance over the mean below which a vertex lies where no light comes, as within solids.
const HIDDEN: f32 = 1.0e-4;

/// Edges from a vertex without light to one with some.
#[derive(Debug, Clone, PartialEq)]
pub struct Seams(Vec<(u32, u32)>);

impl Seams {
    /// Those of a mesh in all `lights` together, whose mean irradiance is `level`.
    pub fn new(mesh: &ViewMesh, lights: &[&[Rgb]], level: f32) -> Self {
        let lit = |v: usize| lights.iter().map(|light| light[v].max_element()).sum::<f32>();
        let hidden: Vec<bool> = (0..mesh.points.len()).map(|v| lit(v) <= HIDDEN * level).collect();
        let mut seams = Vec::new();
        for triangle in mesh.one_sided.iter().chain(&mesh.two_sided) {
            for &to in triangle.iter().filter(|&&v| hidden[v as usize]) {
                seams.extend(triangle.iter().filter(|&&v| !hidden[v as usize]).map(|&from| (to, from)));
            }
        }
        seams.sort_unstable();
        seams.dedup();
        Self(seams)
    }

    /// Gives vertices without light the mean of their neighbours' that have some.
    pub fn lighten(&self, irradiance: &mut [Rgb]) {
        for seam in self.0.chunk_by(|a, b| a.0 == b.0) {
            let sum: Rgb = seam.iter().map(|(_, from)| irradiance[*from as usize]).sum();
            irradiance[seam[0].0 as usize] = sum / seam.len() as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::synthetic;

    #[test]
    fn hidden_vertices_take_the_light_beside_them() {
        let mesh = ViewMesh::new(&synthetic::square(), 2_000);
        let hidden: Vec<bool> = mesh.points.iter().map(|point| point.position.x < 0.5).collect();
        let light = |hides: &bool| if *hides { Rgb::ZERO } else { Rgb::ONE };
        let mut light: Vec<Rgb> = hidden.iter().map(light).collect();
        Seams::new(&mesh, &[&light], 1.0).lighten(&mut light);
        let crosses =
            |t: &&[u32; 3]| [true, false].iter().all(|side| t.iter().any(|&v| hidden[v as usize] == *side));
        let mut seam = mesh.one_sided.iter().filter(crosses).peekable();
        assert!(seam.peek().is_some() && seam.all(|t| t.iter().all(|&v| light[v as usize] == Rgb::ONE)));
        let dark = light.iter().filter(|light| **light == Rgb::ZERO).count();
        // Half the square, but for a seam.
        assert!(2 * dark > light.len() * 8 / 10 && dark < light.len() / 2 + 100, "{dark} of {}", light.len());
    }
}
