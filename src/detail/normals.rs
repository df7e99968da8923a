//! Normals of a chunk's vertices: means of the faces around by area, by the rules that hold for meshes in memory.

use glam::{DAffine3, DMat3, Vec3};
use rayon::prelude::*;

use crate::geometry::{octahedral, triangle};
use crate::scene::ply::stream::Stream;

/// Sums of faces around vertices. In f32 and in file order, as meshes in memory have them: the same bits come out.
pub struct Normals(Vec<Vec3>);

/// Sums that cancel (the two sides of a sheet) or underflow.
fn is_lost(sum: Vec3) -> bool {
    !sum.is_finite() || sum.normalize_or_zero() == Vec3::ZERO
}

impl Normals {
    /// Over all triangles, which have an area.
    pub fn of(points: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let corners = |triangle: &[u32; 3]| triangle.map(|k| points[k as usize]);
        let mut sums = vec![Vec3::ZERO; points.len()];
        for triangle in triangles {
            let along = triangle::area_vector(corners(triangle));
            triangle.iter().for_each(|&k| sums[k as usize] += along);
        }
        // What is lost takes any face's normal.
        let any_lost = sums.par_iter().any(|&sum| is_lost(sum));
        for triangle in triangles.iter().filter(|_| any_lost) {
            if triangle.iter().any(|&k| is_lost(sums[k as usize])) {
                let normal = triangle::normal(corners(triangle));
                for &k in triangle.iter().filter(|_| normal.is_finite()) {
                    let slot = &mut sums[k as usize];
                    *slot = if is_lost(*slot) { normal } else { *slot };
                }
            }
        }
        Self(sums)
    }

    /// Codes of those at `places`, which have the numbers `ids` in the file: the file's own normal where it has one, on the
    /// side that the faces' winding makes the front.
    pub fn encoded(
        &self,
        places: &[u32],
        stream: &Stream,
        (ids, transform): (&[u32], &DAffine3),
    ) -> Vec<u32> {
        let linear = transform.matrix3;
        let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
        // Normals go with the cofactors; which way they look is settled by the faces.
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
        let encoded = |(&place, &id): (&u32, &u32)| {
            let sum = self.0[place as usize];
            if is_lost(sum) {
                return octahedral::NONE;
            }
            let mean = sum.normalize();
            let turned = |normal: Vec3| (cofactors * normal.as_dvec3()).normalize_or_zero().as_vec3();
            let own = stream.normal(id).map(turned).filter(|own| own.is_finite() && *own != Vec3::ZERO);
            octahedral::encode(own.map_or(mean, |own| if own.dot(mean) < 0.0 { -own } else { own }))
        };
        places.par_iter().zip(ids).map(encoded).collect()
    }
}
