//! The sites around one, in its tangent plane, and their Delaunay triangulation.
//!
//! This work is based on: Delaunay, "Sur la sphère vide", 1934; spade builds it. Sites of a Poisson-disk set that are
//! neighbours on the surface are neighbours there: edges that the graph of sites lacks are links that walls have cut, or
//! longer than links may be.

use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use crate::geometry::tangent_frame;
use crate::sites::neighbours::{LINK_COSINE, LINK_SPACINGS};
use crate::sites::{Neighbours, SiteId, Sites};

/// Sites around one, flattened.
#[derive(Debug, Clone, PartialEq)]
pub struct Neighbourhood {
    /// The site in the middle.
    pub centre: SiteId,
    /// The sites and their places in the tangent plane, local units, the middle first at the origin.
    pub sites: Vec<(SiteId, [f64; 2])>,
    /// Edges of the triangulation, indices into `sites`.
    pub edges: Vec<[usize; 2]>,
    /// Its triangles.
    pub triangles: Vec<[usize; 3]>,
}

/// How two sites are to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bond {
    /// Neighbours: near, and they see each other.
    Linked,
    /// Near and turned alike, but something is in between.
    Cut,
    /// Too far from each other, or turned otherwise.
    Apart,
}

/// A site's place, as spade wants it.
struct Placed {
    index: usize,
    at: Point2<f64>,
}

impl HasPosition for Placed {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.at
    }
}

impl Neighbourhood {
    /// The sites within `reach` (local units) of one that are turned like it, and their triangulation. Of sites that fall
    /// on the same place the first stays.
    pub fn around(all: &Sites, centre: SiteId, reach: f32) -> Self {
        let middle = all.point(centre);
        let (s, t) = tangent_frame(middle.normal);
        let near = |site: &SiteId| {
            let point = all.point(*site);
            *site != centre
                && point.position.distance_squared(middle.position) <= reach * reach
                && point.normal.dot(middle.normal) > LINK_COSINE
        };
        let place = |site: SiteId| {
            let way = all.point(site).position - middle.position;
            (site, [way.dot(s), way.dot(t)].map(|v| tiny_as_zero(f64::from(v))))
        };
        let others = (0..all.len() as u32).map(SiteId).filter(near).map(place);
        let mut hood =
            Self { centre, sites: vec![(centre, [0.0; 2])], edges: Vec::new(), triangles: Vec::new() };
        let mut flat: DelaunayTriangulation<Placed> = DelaunayTriangulation::new();
        for (site, at) in std::iter::once((centre, [0.0; 2])).chain(others) {
            let placed = Placed { index: hood.sites.len(), at: Point2::new(at[0], at[1]) };
            let taken = flat.locate_vertex(placed.at).is_some();
            // spade refuses coordinates that are no numbers: such a site has no place.
            if site == centre {
                let _ = flat.insert(Placed { index: 0, ..placed });
            } else if !taken && flat.insert(placed).is_ok() {
                hood.sites.push((site, at));
            }
        }
        let edge = |e: spade::handles::UndirectedEdgeHandle<'_, Placed, _, _, _>| {
            e.vertices().map(|v| v.data().index)
        };
        hood.edges = flat.undirected_edges().map(edge).collect();
        hood.triangles = flat.inner_faces().map(|f| f.vertices().map(|v| v.data().index)).collect();
        hood
    }

    /// How the sites of an edge are to each other.
    pub fn bond(&self, all: &Sites, graph: &Neighbours, edge: [usize; 2]) -> Bond {
        bond(all, graph, edge.map(|k| self.sites[k].0))
    }
}

/// How two sites are to each other.
pub fn bond(all: &Sites, graph: &Neighbours, [a, b]: [SiteId; 2]) -> Bond {
    if graph.of(a).binary_search(&b.0).is_ok() {
        return Bond::Linked;
    }
    let (here, there) = (all.point(a), all.point(b));
    let reach = LINK_SPACINGS * all.spacings[a.index()].max(all.spacings[b.index()]);
    let near = here.position.distance_squared(there.position) < reach * reach;
    if near && here.normal.dot(there.normal) > LINK_COSINE { Bond::Cut } else { Bond::Apart }
}

/// spade refuses numbers that are tiny but not zero.
fn tiny_as_zero(value: f64) -> f64 {
    if value.abs() < 1e-30 { 0.0 } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash;
    use crate::sites::SiteArrays;
    use glam::Vec3;

    /// Sites in the plane z = 0 and two that are turned away or far.
    fn sites() -> Sites {
        let mut positions: Vec<Vec3> = (0..120)
            .map(|i| {
                let [x, y] = hash::unit_pair(3, i);
                Vec3::new(x, y, 0.0)
            })
            .collect();
        positions.extend([Vec3::new(0.5, 0.5, 0.01), Vec3::new(9.0, 0.0, 0.0), positions[0]]);
        let n = positions.len();
        let mut normals = vec![Vec3::Z; n];
        normals[120] = -Vec3::Z;
        Sites::from_arrays(SiteArrays {
            positions,
            normals,
            areas: vec![0.01; n],
            triangles: vec![0; n],
            barycentrics: vec![[0.0; 2]; n],
            levels: vec![0; n],
            spacings: vec![0.1; n],
        })
    }

    #[test]
    fn no_site_lies_within_the_circle_of_a_triangle() {
        let hood = Neighbourhood::around(&sites(), SiteId(5), 3.0);
        assert_eq!(hood.sites.len(), 120, "turned away, far, and doubled sites are left out");
        // Euler: a triangulation of n points, h of them on the hull, has 3n − 3 − h edges and 2n − 2 − h triangles.
        assert_eq!(hood.edges.len() + 1 - 120, hood.triangles.len());
        for triangle in &hood.triangles {
            let corner = triangle.map(|k| hood.sites[k].1);
            for (k, (_, at)) in hood.sites.iter().enumerate() {
                // In exact numbers not positive; coordinates of size one square to errors of some 1e-16.
                assert!(triangle.contains(&k) || within(corner, *at) < 1e-14, "{triangle:?} {k}");
            }
        }
    }

    /// Positive within the circle through three counter-clockwise points.
    fn within([a, b, c]: [[f64; 2]; 3], d: [f64; 2]) -> f64 {
        let row = |p: [f64; 2]| {
            let (x, y) = (p[0] - d[0], p[1] - d[1]);
            [x, y, x * x + y * y]
        };
        let [p, q, r] = [row(a), row(b), row(c)];
        p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0])
            + p[2] * (q[0] * r[1] - q[1] * r[0])
    }

    #[test]
    fn bonds_tell_cut_from_apart() {
        let sites = sites();
        let close = |k: u32| {
            let other = (0..120).filter(|&o| o != k).min_by(|&a, &b| {
                let d = |o: u32| sites.positions[o as usize].distance(sites.positions[k as usize]);
                d(a).total_cmp(&d(b))
            });
            [SiteId(k), SiteId(other.unwrap())]
        };
        let pair = close(0);
        let n = sites.len();
        let without = Neighbours::from_arrays(vec![0; n + 1], vec![], &vec![0; n]);
        assert_eq!(bond(&sites, &without, pair), Bond::Cut);
        assert_eq!(bond(&sites, &without, [SiteId(0), SiteId(121)]), Bond::Apart);
        assert_eq!(bond(&sites, &without, [SiteId(0), SiteId(120)]), Bond::Apart);
        let mut starts = vec![1; n + 1];
        starts[0] = 0;
        let with = Neighbours::from_arrays(starts, vec![pair[1].0], &vec![0; n]);
        assert_eq!(bond(&sites, &with, pair), Bond::Linked);
    }
}
