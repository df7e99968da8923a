//! One chunk of a mesh: its hierarchy, its vertices, its share of the proxy.

use glam::{DVec3, Vec3};
use half::f16;
use rayon::prelude::*;

use super::Shards;
use super::cut::bits::Bits;
use super::simplify::{self, Means};
use crate::error::Result;
use crate::geometry::normals::{Weight, cofactors, means_of_faces, own_or_mean, turned};
use crate::geometry::{octahedral, triangle};
use crate::light::Rgb;
use crate::rays::Bvh;
use crate::scene::Placement;
use crate::scene::ply::stream::Stream;

/// Triangles that a thread takes at a time at least: less is not worth the handing over.
const RUN: usize = 1 << 13;

/// One chunk, in local coordinates.
pub struct Chunk {
    /// The triangles owned, those whose first corner lies in this chunk; numbered in file order without those that have no
    /// area.
    pub bvh: Bvh,
    /// The box around these triangles: lower and upper corner; turned inside out if there are none.
    pub bounds: [Vec3; 2],
    /// How many.
    pub triangles: u64,
    /// Numbers in the file of the vertices that lie in this chunk and are used by a face, ascending.
    pub ids: Vec<u32>,
    /// Their positions.
    pub points: Vec<Vec3>,
    /// Their unit normals in [octahedral](crate::geometry::octahedral) code: the mean of all faces around by area, those of
    /// other chunks included, or the file's own; [`NONE`](crate::geometry::octahedral::NONE) where no face with area is.
    pub normals: Vec<u32>,
    /// Their linear colours, if the file has them. Half floats keep a channel to 5e-4 of itself.
    pub colours: Option<Vec<[f16; 3]>>,
    /// Occupied cells, ascending: the proxy's vertices.
    pub cells: Vec<u64>,
    /// Mean position of each cell's vertices.
    pub means: Vec<Vec3>,
    /// Mean colour of each cell's vertices.
    pub mean_colours: Option<Vec<Rgb>>,
    /// The proxy's triangles whose first cell in order lies in this chunk, as triples of cells, each once.
    pub faces: Vec<[u64; 3]>,
}

/// All that touches a chunk, under numbers of its own.
struct Gathered {
    /// Vertices by number in the file, ascending; also those that lie in other chunks.
    ids: Vec<u32>,
    points: Vec<Vec3>,
    cells: Vec<u64>,
    /// Triangles with an area, in file order, as places in `ids`.
    triangles: Vec<[u32; 3]>,
}

impl Shards {
    /// Builds one chunk.
    ///
    /// Memory: some 300 bytes a triangle of the chunk, most of it for the hierarchy. The same for any number of threads.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) when the file was cut meanwhile.
    pub fn chunk(&self, stream: &Stream, number: usize, placement: &Placement) -> Result<Chunk> {
        stream.check_whole()?;
        let gathered = self.gather(stream, number, placement);
        let owners = self.owners();
        let is_own = |&place: &u32| usize::from(owners[gathered.ids[place as usize] as usize]) == number;
        let own: Vec<u32> = (0..gathered.ids.len() as u32).into_par_iter().filter(is_own).collect();
        let ids: Vec<u32> = own.iter().map(|&place| gathered.ids[place as usize]).collect();
        let faces = simplify::faces(&gathered.triangles, &gathered.cells, self.cells(number));
        let colours: Option<Vec<Rgb>> =
            stream.has_colours().then(|| ids.par_iter().filter_map(|&id| stream.colour(id)).collect());
        let cells: Vec<u64> = own.iter().map(|&place| gathered.cells[place as usize]).collect();
        let world: Vec<DVec3> = ids.par_iter().map(|&id| self.world(stream, id)).collect();
        let Means { cells, means, colours: mean_colours } =
            simplify::means(&cells, &world, colours.as_deref(), placement);
        let normals = self.normals(stream, &gathered, &own);
        let Gathered { ids: all, points, triangles, .. } = gathered;
        let is_owned = |corners: &[u32; 3]| usize::from(owners[all[corners[0] as usize] as usize]) == number;
        let triangles: Vec<[u32; 3]> = triangles.into_par_iter().with_min_len(RUN).filter(is_owned).collect();
        Ok(Chunk {
            bvh: by_place(&points, &triangles),
            bounds: bounds(&points, &triangles),
            triangles: triangles.len() as u64,
            points: own.iter().map(|&place| points[place as usize]).collect(),
            ids,
            normals,
            colours: colours.map(|colours| colours.iter().map(|c| c.to_array().map(f16::from_f32)).collect()),
            cells,
            means,
            mean_colours,
            faces,
        })
    }

    fn world(&self, stream: &Stream, id: u32) -> DVec3 {
        self.transform().transform_point3(stream.position(id))
    }

    /// Codes of the normals of those at `places`.
    fn normals(&self, stream: &Stream, gathered: &Gathered, places: &[u32]) -> Vec<u32> {
        let means = means_of_faces(&gathered.points, &gathered.triangles, Weight::Area);
        let cofactors = cofactors(self.transform().matrix3);
        let encoded = |&place: &u32| {
            let own = stream.normal(gathered.ids[place as usize]);
            let own = own.map_or(Vec3::ZERO, |own| turned(cofactors, own));
            octahedral::encode(own_or_mean(own, means[place as usize]))
        };
        places.par_iter().map(encoded).collect()
    }

    fn gather(&self, stream: &Stream, number: usize, placement: &Placement) -> Gathered {
        let count = self.runs(number).map(<[[u32; 3]]>::len).sum();
        let mut triangles: Vec<[u32; 3]> = Vec::with_capacity(count);
        self.runs(number).for_each(|run| triangles.extend_from_slice(run));
        let corners = || triangles.par_iter().flatten().copied();
        let first = corners().min().unwrap_or(0);
        let mut used = Bits::over(first, corners().max().unwrap_or(0));
        triangles.iter().flatten().for_each(|&corner| used.insert(corner));
        let ids = used.numbers();
        let (points, cells): (Vec<Vec3>, Vec<u64>) = ids
            .par_iter()
            .map(|&id| {
                let world = self.world(stream, id);
                (placement.to_local(world), self.cell_of(world))
            })
            .unzip();
        let ranks = used.ranked();
        let mirrored = self.transform().matrix3.determinant() < 0.0;
        let placed = |corners: [u32; 3]| {
            let [a, b, c] = corners.map(|corner| ranks.of(corner));
            let corners = if mirrored { [a, c, b] } else { [a, b, c] };
            let normal = triangle::normal(corners.map(|k| points[k as usize]));
            (normal != Vec3::ZERO).then_some(corners)
        };
        let triangles = triangles.into_par_iter().with_min_len(RUN).filter_map(placed).collect();
        Gathered { ids, points, cells, triangles }
    }
}

fn bounds(points: &[Vec3], triangles: &[[u32; 3]]) -> [Vec3; 2] {
    let nothing = || [Vec3::INFINITY, Vec3::NEG_INFINITY];
    let corners =
        triangles.par_iter().with_min_len(RUN).flatten_iter().map(|&corner| points[corner as usize]);
    let boxes = corners.fold(nothing, |[low, high], at| [low.min(at), high.max(at)]);
    boxes.reduce(nothing, |a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// The hierarchy over triangles, which are numbered by their places in it: nobody asks for their numbers in the file.
fn by_place(points: &[Vec3], triangles: &[[u32; 3]]) -> Bvh {
    let mut bvh = Bvh::build_triangles(points, triangles);
    bvh.number_by_place();
    bvh
}
