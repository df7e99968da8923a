//! The surface that every grown mesh samples: the base rounded off, and noise along its normals.
//!
//! This work is based on: Boubekeur and Alexa, "Phong Tessellation", SIGGRAPH Asia 2008: the flat point is projected onto
//! the tangent planes of the corners, and the projections are mixed by the same weights.

use glam::DVec3;

use crate::base::{Base, unit};
use crate::noise::Noise;

/// How far from the flat triangle to the mixed projections, as the paper has it (its α = 3/4).
const ROUNDING: f64 = 0.75;

/// A place of the base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// A vertex.
    Corner(u32),
    /// So many k-th parts of an edge from its lower vertex.
    Edge(u32, u32),
    /// Inside a triangle, k-th parts towards corners 1 and 2; thousandths of a part.
    Inside(u32, [u32; 2]),
}

/// In which parts of an edge's k-th part [`Place::Inside`] counts.
pub const PARTS: u32 = 1000;

/// The surface over a base, and how finely it is sampled.
#[derive(Debug)]
pub struct Surface<'a> {
    /// What lies below.
    pub base: &'a Base,
    /// What is added along the normals.
    pub noise: Noise,
    /// Parts of each edge.
    pub k: u32,
}

impl Surface<'_> {
    /// The world position at a place: a function of the place on the base alone, not of k.
    ///
    /// A place on an edge knows the edge's vertices alone, in the edge's order: triangles that share it meet.
    pub fn at(&self, place: Place) -> DVec3 {
        match place {
            Place::Corner(v) => self.mixed([(v, 1.0)]),
            Place::Edge(edge, step) => {
                let [a, b] = self.base.edges[edge as usize];
                let share = |steps: u32| f64::from(steps) / f64::from(self.k);
                self.mixed([(a, share(self.k - step)), (b, share(step))])
            }
            Place::Inside(triangle, [i, j]) => {
                let [a, b, c] = self.base.triangles[triangle as usize];
                let whole = self.k * PARTS;
                // A correctly rounded quotient is the same for 1/2 and 2/4.
                let share = |parts: u32| f64::from(parts) / f64::from(whole);
                self.mixed([(a, share(whole - i - j)), (b, share(i)), (c, share(j))])
            }
        }
    }

    /// The rounded and displaced point that is a mix of vertices.
    fn mixed<const N: usize>(&self, weights: [(u32, f64); N]) -> DVec3 {
        let base = self.base;
        let flat = weights.iter().fold(DVec3::ZERO, |sum, &(v, w)| sum + base.vertices[v as usize] * w);
        let (mut pull, mut normal, mut calm) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for (v, weight) in weights {
            let towards = base.normals[v as usize];
            normal += towards * weight;
            calm += base.calm[v as usize] * weight;
            pull += towards * (weight * (flat - base.vertices[v as usize]).dot(towards));
        }
        let rounded = if N == 1 { flat } else { flat - pull * ROUNDING };
        rounded + unit(normal) * (calm * self.noise.at(rounded))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::shapes::ball;
    use crate::noise::Looks;

    fn noise(height: f64) -> Noise {
        Noise::new(Looks { wavelength: 1.0, octaves: 4, height }, 9)
    }

    #[test]
    fn rounding_brings_facets_nearer_to_the_ball() {
        let base = ball(2);
        let surface = Surface { base: &base, noise: noise(0.0), k: 3 };
        let flat = |t: usize| {
            base.triangles[t].iter().fold(DVec3::ZERO, |sum, &v| sum + base.vertices[v as usize] / 3.0)
        };
        for t in 0..base.triangles.len() {
            let round = surface.at(Place::Inside(t as u32, [PARTS, PARTS]));
            // Phong tessellation of a sphere's facet with α = 1 overshoots by about the sagitta s; α = 3/4 leaves
            // |3/4 · 2 − 1| = 1/2 of s, and a fifth more for normals that are not radial.
            assert!(
                (round.length() - 1.0).abs() < 0.6 * (1.0 - flat(t).length()),
                "triangle {t}: {}",
                round.length()
            );
        }
    }

    #[test]
    fn the_surface_does_not_depend_on_its_sampling() {
        let base = ball(1);
        let coarse = Surface { base: &base, noise: noise(0.1), k: 3 };
        let fine = Surface { base: &base, noise: noise(0.1), k: 6 };
        for id in 0..base.edges.len() as u32 {
            assert_eq!(coarse.at(Place::Edge(id, 2)), fine.at(Place::Edge(id, 4)));
        }
        for id in 0..base.triangles.len() as u32 {
            let (near, far) = (Place::Inside(id, [PARTS, PARTS]), Place::Inside(id, [2 * PARTS, 2 * PARTS]));
            assert_eq!(coarse.at(near), fine.at(far));
            assert!(coarse.at(near) != fine.at(near));
        }
    }

    #[test]
    fn points_inside_run_continuously_into_edges() {
        let base = ball(1);
        let surface = Surface { base: &base, noise: noise(0.1), k: 4096 };
        for (t, [ab, _, _]) in base.sides.iter().enumerate() {
            let [a, b] = [0, 1].map(|p| base.triangles[t][p]);
            let step = if a < b { 1024 } else { 3072 };
            let beside = surface.at(Place::Inside(t as u32, [1024 * PARTS - 1, 1]));
            // One part in four million of an edge of length 0.77 at most, and slopes below 10.
            assert!((surface.at(Place::Edge(*ab, step)) - beside).length() < 1.0e-5, "triangle {t}");
        }
    }
}
