//! The mesh that is grown: vertices, their normals, triangles and the sorted table of edges.

use std::path::Path;

use glam::DVec3;
use glowtree::geometry::hash::mix2;
use glowtree::scene;

/// A mesh with shared vertices; lengths in world units.
#[derive(Debug)]
pub struct Base {
    /// Positions.
    pub vertices: Vec<DVec3>,
    /// Unit normals, the mean of the triangles around by area; zero where there is none.
    pub normals: Vec<DVec3>,
    /// How much of the noise a vertex takes, 0 to 1: less where the triangles around it bend away from its normal.
    pub calm: Vec<f64>,
    /// Corners.
    pub triangles: Vec<[u32; 3]>,
    /// Per triangle, the edges from corner 0 to 1, 0 to 2 and 1 to 2 as indices into `edges`.
    pub sides: Vec<[u32; 3]>,
    /// Pairs of vertices, the lower first, ascending.
    pub edges: Vec<[u32; 2]>,
    /// Mean length of the edges.
    pub mean_edge: f64,
}

/// The corners that each of a triangle's three sides joins.
pub const SIDES: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];

impl Base {
    /// All triangles of a scene's meshes, in world coordinates.
    ///
    /// # Errors
    /// What the library's reader says, as a line.
    pub fn load(path: &Path) -> Result<Self, String> {
        let scene = scene::load(path).map_err(|error| error.to_string())?;
        let vertices = scene.vertices.iter().map(|&local| scene.placement.to_world(local)).collect();
        Ok(Self::new(vertices, scene.triangles))
    }

    /// The mesh of given triangles. Memory: O(triangles).
    pub fn new(vertices: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Self {
        let normals = smooth_normals(&vertices, &triangles);
        let calm = calm_at_creases(&vertices, &normals, &triangles);
        let (edges, sides) = edges_of(&triangles);
        let length = |&[a, b]: &[u32; 2]| (vertices[b as usize] - vertices[a as usize]).length();
        let mean_edge = edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64;
        Self { vertices, normals, calm, triangles, sides, edges, mean_edge }
    }

    /// Leaves out whole fans, the triangles around seeded vertices, until `share` of the triangles is gone.
    ///
    /// Normals, calm and the mean edge stay those of the whole, so that the rest keeps its shape.
    pub fn with_holes(mut self, share: f64, seed: u64) -> Self {
        let wanted = (share * self.triangles.len() as f64).round() as usize;
        let mut fans: Vec<(u64, u32)> = Vec::with_capacity(3 * self.triangles.len());
        for (id, corners) in (0u32..).zip(&self.triangles) {
            fans.extend(corners.map(|v| (mix2(seed, u64::from(v)), id)));
        }
        fans.sort_unstable();
        let mut gone = vec![false; self.triangles.len()];
        let mut count = 0;
        for fan in fans.chunk_by(|a, b| a.0 == b.0) {
            if count >= wanted {
                break;
            }
            for &(_, id) in fan {
                count += usize::from(!std::mem::replace(&mut gone[id as usize], true));
            }
        }
        let mut id = 0;
        self.triangles.retain(|_| {
            id += 1;
            !gone[id - 1]
        });
        (self.edges, self.sides) = edges_of(&self.triangles);
        self
    }
}

/// Unit means of the area vectors around each vertex.
fn smooth_normals(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; vertices.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|v| vertices[v as usize]);
        let area = (b - a).cross(c - a);
        corners.iter().for_each(|&v| normals[v as usize] += area);
    }
    normals.into_iter().map(unit).collect()
}

/// The vector at length 1; zero stays zero.
pub fn unit(vector: DVec3) -> DVec3 {
    let length = vector.length();
    if length > 0.0 { vector / length } else { DVec3::ZERO }
}

/// The share of the noise at each vertex: whole where all triangles around look its normal's way within 26°, none from
/// 72° on, and of a vertex and its neighbours the least. Displaced in full, creases would fold over: of Lucy's vertices
/// at k = 4 0.80 % had a triangle against their normal, so 0.26 %; the base alone has 0.32 %.
fn calm_at_creases(vertices: &[DVec3], normals: &[DVec3], triangles: &[[u32; 3]]) -> Vec<f64> {
    let mut own = vec![1.0f64; vertices.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|v| vertices[v as usize]);
        let front = unit((b - a).cross(c - a));
        for &v in corners {
            let bend = (normals[v as usize].dot(front) - 0.3) / 0.6;
            own[v as usize] = own[v as usize].min(bend.clamp(0.0, 1.0));
        }
    }
    let mut least = own.clone();
    for corners in triangles {
        let lowest = corners.iter().fold(1.0, |low: f64, &v| low.min(own[v as usize]));
        corners.iter().for_each(|&v| least[v as usize] = least[v as usize].min(lowest));
    }
    least
}

/// The sorted table of edges, and each triangle's sides in it.
fn edges_of(triangles: &[[u32; 3]]) -> (Vec<[u32; 2]>, Vec<[u32; 3]>) {
    let ends =
        |corners: &[u32; 3]| SIDES.map(|[p, q]| [corners[p].min(corners[q]), corners[p].max(corners[q])]);
    let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(ends).collect();
    edges.sort_unstable();
    edges.dedup();
    edges.shrink_to_fit();
    // Every pair was put into the table above.
    let place = |pair: [u32; 2]| edges.partition_point(|edge| *edge < pair) as u32;
    let sides = triangles.iter().map(|corners| ends(corners).map(place)).collect();
    (edges, sides)
}

/// Meshes for the tests of all modules.
#[cfg(test)]
pub mod shapes {
    use super::*;

    /// An octahedron about the origin, split `levels` times onto the unit sphere: closed, 8 · 4^levels triangles.
    pub fn ball(levels: u32) -> Base {
        let mut vertices = vec![DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z];
        let octants =
            [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]];
        let mut triangles = octants.to_vec();
        for _ in 0..levels {
            let (edges, sides) = edges_of(&triangles);
            let first = vertices.len() as u32;
            let middle = |&[a, b]: &[u32; 2]| unit(vertices[a as usize] + vertices[b as usize]);
            let middles: Vec<DVec3> = edges.iter().map(middle).collect();
            vertices.extend(middles);
            let parts = |([a, b, c], sides): (&[u32; 3], &[u32; 3])| {
                let [ab, ac, bc] = sides.map(|s| first + s);
                [[*a, ab, ac], [ab, *b, bc], [ac, bc, *c], [ab, bc, ac]]
            };
            triangles = triangles.iter().zip(&sides).flat_map(parts).collect();
        }
        Base::new(vertices, triangles)
    }
}

#[cfg(test)]
mod tests {
    use super::shapes::ball;

    #[test]
    fn a_ball_has_eulers_edges_and_radial_normals() {
        let base = ball(3);
        assert_eq!(base.triangles.len(), 512);
        assert_eq!(base.vertices.len() + base.triangles.len(), base.edges.len() + 2);
        for (vertex, normal) in base.vertices.iter().zip(&base.normals) {
            // Edges span 0.2 rad at the most; the mean over a fan that is not symmetric errs by second order.
            assert!(vertex.dot(*normal) > 0.99, "{vertex} {normal}");
        }
        for (corners, sides) in base.triangles.iter().zip(&base.sides) {
            for (pair, side) in super::SIDES.iter().zip(sides) {
                let mut ends = pair.map(|p| corners[p]);
                ends.sort_unstable();
                assert_eq!(base.edges[*side as usize], ends);
            }
        }
    }

    #[test]
    fn noise_is_taken_from_creases_alone() {
        // The octahedron's normals stand 1/√3 to its faces; four splits leave 0.05 rad between them.
        let edged = (1.0 / 3.0f64.sqrt() - 0.3) / 0.6;
        assert!(ball(0).calm.iter().all(|calm| (calm - edged).abs() < 1.0e-12), "{:?}", ball(0).calm);
        assert!(ball(4).calm.iter().all(|&calm| calm == 1.0));
    }

    #[test]
    fn holes_take_their_share_in_whole_fans() {
        let whole = ball(4);
        let count = whole.triangles.len();
        let normals = whole.normals.clone();
        let torn = whole.with_holes(0.1, 3);
        let gone = count - torn.triangles.len();
        // A fan has at most six triangles, the last one may go beyond the share.
        assert!((205..=210).contains(&gone), "{gone} of {count}");
        assert_eq!(torn.normals, normals);
        let borders = torn.edges.len() * 2 - torn.triangles.len() * 3;
        // A fan of six has six border edges, one for each triangle gone; fans that touch have fewer. Triangles strewn
        // one by one would leave three for each.
        assert!(borders > 0 && borders <= gone, "{borders} borders of {gone} gone");
    }
}
