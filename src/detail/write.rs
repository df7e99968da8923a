//! Writing the archive of a streamed mesh, chunk after chunk.

use std::path::Path;
use std::sync::{Arc, mpsc};

use bytemuck::{Pod, Zeroable};

use super::{Chunk, Shards};
use crate::archive::{Archive, Digests, Pause, Storage, Tag, Writer};
use crate::error::{Error, Result};
use crate::scene::Placement;
use crate::scene::ply::stream::Stream;

/// The kind of file.
pub const KIND: Tag = Tag::new("detail");
/// Its first block.
pub const HEAD: Tag = Tag::new("head");
/// The blocks of every chunk, in this order; those of colours only where there are any.
pub const BLOCKS: [Tag; 11] = [
    Tag::new("branches"),
    Tag::new("packets"),
    Tag::new("ids"),
    Tag::new("points"),
    Tag::new("normals"),
    Tag::new("colours"),
    Tag::new("cells"),
    Tag::new("means"),
    Tag::new("tints"),
    Tag::new("faces"),
    Tag::new("box"),
];
/// The places of those that a mesh without colours lacks.
pub const OF_COLOUR: [usize; 2] = [5, 8];

const PROGRAM: &str = concat!("glowtree ", env!("CARGO_PKG_VERSION"));

/// What the archive says of the whole mesh.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Head {
    /// World position of the local origin.
    pub origin: [f64; 3],
    /// World length of one local unit.
    pub scale: f64,
    /// Lower and upper corner of the mesh, world.
    pub bounds: [[f64; 3]; 2],
    /// Edge of a cell, world.
    pub cell: f64,
    /// Vertices of the file.
    pub vertices: u64,
    /// Chunks.
    pub chunks: u64,
    /// 1 if there are colours, else 0.
    pub coloured: u64,
}

impl Head {
    /// Whether it tells of a mesh that can be: a frame with a finite origin and a scale, a box, cells, 32 bits of vertices.
    pub fn is_usable(&self) -> bool {
        let all_finite = self.origin.iter().chain(self.bounds.as_flattened()).all(|x| x.is_finite());
        let lengths = [self.scale, self.cell].iter().all(|x| x.is_finite() && *x > 0.0);
        let [low, high] = self.bounds;
        let is_box = low.iter().zip(high).all(|(low, high)| *low <= high);
        all_finite && lengths && is_box && self.coloured <= 1 && u32::try_from(self.vertices).is_ok()
    }
}

/// How far the running numbers are.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    triangles: u64,
    vertices: u64,
    cells: u64,
    faces: u64,
}

/// Writes the chunks of a mesh into a write-once archive at `path`, or goes on where a run that ended left off: a chunk
/// that is in the file is not made again. Blocks are made durable after each chunk. A finished archive made from the same
/// stays as it is; an unfinished one made from something else is begun anew.
///
/// `advance` hears how many triangles of the file each chunk had, also of those that were there. Equal bytes for equal
/// input and parameters, interrupted or not.
///
/// # Errors
/// The pause's; [`Error::DiskFull`], [`Error::Io`]; those of [`Shards::chunk`].
pub fn write(
    (storage, path): (&Arc<dyn Storage>, &Path),
    digests: Digests,
    (stream, shards, placement): (&Stream, &Shards, &Placement),
    pause: Pause<'_>,
    mut advance: impl FnMut(u64),
) -> Result<()> {
    let is_done = |archive: Archive| archive.kind() == KIND && archive.digests() == digests;
    if Archive::open(path).is_ok_and(is_done) {
        (0..shards.chunk_count()).for_each(|number| advance(shards.owned(number)));
        return Ok(());
    }
    let head = head(stream, shards, placement);
    let writer = begin(storage, path, digests, &head)?;
    let tags = tags(head.coloured == 1);
    let whole = writer.entries().len().saturating_sub(1) / tags.len();
    (0..whole).for_each(|number| advance(shards.owned(number)));
    let numbers = whole..shards.chunk_count();
    let writer = std::thread::scope(|scope| -> Result<Writer> {
        // A chunk is written while the next one is made; no more than these two are in memory.
        let (sender, receiver) = mpsc::sync_channel::<Chunk>(0);
        let keeper = scope.spawn(move || keep(writer, &tags, &receiver));
        let make_all = || -> Result<()> {
            for number in numbers {
                pause()?;
                let chunk = shards.chunk(stream, number, placement)?;
                // The keeper hangs up when it has failed: its error is the one that counts.
                if sender.send(chunk).is_err() {
                    break;
                }
                advance(shards.owned(number));
            }
            Ok(())
        };
        let made = make_all();
        drop(sender);
        let kept = keeper.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        kept.and_then(|writer| made.map(|()| writer))
    })?;
    writer.finish(&[("program", PROGRAM)])?;
    Ok(())
}

fn head(stream: &Stream, shards: &Shards, placement: &Placement) -> Head {
    Head {
        origin: placement.origin.to_array(),
        scale: placement.scale,
        bounds: shards.bounds().map(|corner| corner.to_array()),
        cell: shards.cell(),
        vertices: stream.vertex_count(),
        chunks: shards.chunk_count() as u64,
        coloured: u64::from(stream.has_colours()),
    }
}

/// The tags of a chunk's blocks.
pub fn tags(coloured: bool) -> Vec<Tag> {
    let tags = BLOCKS.iter().enumerate();
    tags.filter(|(at, _)| coloured || !OF_COLOUR.contains(at)).map(|(_, &tag)| tag).collect()
}

/// Continues the archive if what it holds is the start of this one, else begins it.
fn begin(storage: &Arc<dyn Storage>, path: &Path, digests: Digests, head: &Head) -> Result<Writer> {
    let resumed = match Writer::resume_in(Arc::clone(storage), path, KIND, digests) {
        Err(Error::JobDiffers { .. }) => None,
        outcome => Some(outcome?.0),
    };
    if let Some(mut writer) = resumed {
        let tags = tags(head.coloured == 1);
        let blocks = writer.entries().iter().skip(1);
        let fits = blocks.zip(tags.iter().cycle()).all(|(entry, &tag)| entry.tag == tag);
        let first = if writer.entries().is_empty() { None } else { Some(writer.read_back(0)?) };
        match first {
            None => {
                writer.append(HEAD, 0..1, &[*head])?;
                return Ok(writer);
            }
            Some(first) if fits && first == bytemuck::bytes_of(head) => return Ok(writer),
            Some(_) => {}
        }
    }
    let mut writer = Writer::create_in(Arc::clone(storage), path, KIND, digests)?;
    writer.append(HEAD, 0..1, &[*head])?;
    Ok(writer)
}

/// Appends chunks as they come, after those that the file holds, and makes each durable.
fn keep(mut writer: Writer, tags: &[Tag], chunks: &mpsc::Receiver<Chunk>) -> Result<Writer> {
    for chunk in chunks {
        let begun = (writer.entries().len() - 1) % tags.len();
        let before = writer.entries().len() - begun;
        let sums = sums_after(&writer, before);
        append(&mut writer, &chunk, &sums, begun)?;
        writer.checkpoint()?;
    }
    Ok(writer)
}

/// The running numbers after the first blocks of the file.
fn sums_after(writer: &Writer, blocks: usize) -> Sums {
    let mut sums = Sums::default();
    for entry in &writer.entries()[..blocks] {
        let end = entry.range().end;
        match BLOCKS.iter().position(|&tag| tag == entry.tag) {
            Some(0) => sums.triangles = end,
            Some(2) => sums.vertices = end,
            Some(6) => sums.cells = end,
            Some(9) => sums.faces = end,
            _ => {}
        }
    }
    sums
}

/// Appends the blocks of a chunk but for the first `present`.
fn append(writer: &mut Writer, chunk: &Chunk, sums: &Sums, present: usize) -> Result<()> {
    let run = |start: u64, count: u64| start..start + count;
    let triangles = run(sums.triangles, chunk.triangles);
    let vertices = run(sums.vertices, chunk.ids.len() as u64);
    let cells = run(sums.cells, chunk.cells.len() as u64);
    let faces = run(sums.faces, chunk.faces.len() as u64);
    let view = chunk.bvh.view();
    let colours = chunk.colours.as_deref().unwrap_or_default();
    let tints = chunk.mean_colours.as_deref().unwrap_or_default();
    let bounds = [chunk.bounds];
    for tag in tags(chunk.colours.is_some()).into_iter().skip(present) {
        match BLOCKS.iter().position(|&known| known == tag) {
            Some(0) => writer.append(tag, triangles.clone(), view.branches())?,
            Some(1) => writer.append(tag, triangles.clone(), view.packets())?,
            Some(2) => writer.append(tag, vertices.clone(), &chunk.ids)?,
            Some(3) => writer.append(tag, vertices.clone(), &chunk.points)?,
            Some(4) => writer.append(tag, vertices.clone(), &chunk.normals)?,
            Some(5) => writer.append(tag, vertices.clone(), colours)?,
            Some(6) => writer.append(tag, cells.clone(), &chunk.cells)?,
            Some(7) => writer.append(tag, cells.clone(), &chunk.means)?,
            Some(8) => writer.append(tag, cells.clone(), tints)?,
            Some(9) => writer.append(tag, faces.clone(), &chunk.faces)?,
            _ => writer.append(tag, triangles.clone(), &bounds)?,
        }
    }
    Ok(())
}
