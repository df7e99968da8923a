//! Writes a PLY whose vertices and faces are asked for by number: blocks filled by all threads, written in order.

use std::io::{self, Write};
use std::sync::mpsc::sync_channel;
use std::thread;

use glam::DVec3;
use rayon::prelude::*;

/// Rows of one block: about a megabyte.
const BLOCK: u64 = 1 << 16;

/// Blocks that are filled at a time, per thread: threads that wait for the slowest wait for little.
const BLOCKS_PER_THREAD: u64 = 8;

/// How numbers are written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Encoding {
    /// binary_little_endian
    Little,
    /// binary_big_endian
    Big,
    /// ascii, numbers in the fewest digits that read back exactly
    Ascii,
}

/// What the file looks like.
#[derive(Debug, Clone)]
pub struct Format {
    /// How numbers are written.
    pub encoding: Encoding,
    /// Coordinates as double, not float.
    pub double: bool,
    /// Lines of the header.
    pub comments: Vec<String>,
}

/// How many rows there are.
#[derive(Debug, Clone, Copy)]
pub struct Counts {
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub faces: u64,
}

/// Writes the whole file. Memory: some 16 MB a thread, whatever the counts.
///
/// # Errors
/// Those of the writer.
pub fn write(
    out: &mut (impl Write + Send),
    format: &Format,
    counts: Counts,
    vertex: impl Fn(u64) -> DVec3 + Sync,
    face: impl Fn(u64) -> [u32; 3] + Sync,
) -> io::Result<()> {
    out.write_all(format.header(counts).as_bytes())?;
    stream(out, counts.vertices, |number, block| format.push_vertex(block, vertex(number)))?;
    stream(out, counts.faces, |number, block| format.push_face(block, face(number)))?;
    out.flush()
}

/// Fills blocks of rows in parallel while those before are written.
fn stream(
    out: &mut (impl Write + Send),
    count: u64,
    push: impl Fn(u64, &mut Vec<u8>) + Sync,
) -> io::Result<()> {
    let blocks = count.div_ceil(BLOCK);
    let at_once = BLOCKS_PER_THREAD * rayon::current_num_threads() as u64;
    let filled = |block: u64| {
        let mut bytes = Vec::with_capacity(32 * BLOCK as usize);
        (block * BLOCK..((block + 1) * BLOCK).min(count)).for_each(|number| push(number, &mut bytes));
        bytes
    };
    thread::scope(|scope| {
        let (sender, receiver) = sync_channel::<Vec<Vec<u8>>>(0);
        let writer =
            scope.spawn(move || receiver.iter().flatten().try_for_each(|block| out.write_all(&block)));
        for first in (0..blocks).step_by(at_once as usize) {
            let round = (first..(first + at_once).min(blocks)).into_par_iter().map(filled).collect();
            if sender.send(round).is_err() {
                break; // The writer has failed and says why below.
            }
        }
        drop(sender);
        writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

impl Format {
    fn header(&self, counts: Counts) -> String {
        let encoding = match self.encoding {
            Encoding::Little => "binary_little_endian",
            Encoding::Big => "binary_big_endian",
            Encoding::Ascii => "ascii",
        };
        let comments: String = self.comments.iter().map(|line| format!("comment {line}\n")).collect();
        let real = if self.double { "double" } else { "float" };
        let index = if counts.vertices > i32::MAX as u64 { "uint" } else { "int" };
        format!(
            "ply\nformat {encoding} 1.0\n{comments}element vertex {}\nproperty {real} x\nproperty {real} y\nproperty {real} z\n\
             element face {}\nproperty list uchar {index} vertex_indices\nend_header\n",
            counts.vertices, counts.faces
        )
    }

    fn push_vertex(&self, block: &mut Vec<u8>, position: DVec3) {
        for value in position.to_array() {
            match (self.encoding, self.double) {
                (Encoding::Little, false) => block.extend((value as f32).to_le_bytes()),
                (Encoding::Little, true) => block.extend(value.to_le_bytes()),
                (Encoding::Big, false) => block.extend((value as f32).to_be_bytes()),
                (Encoding::Big, true) => block.extend(value.to_be_bytes()),
                (Encoding::Ascii, false) => block.extend(format!("{} ", value as f32).bytes()),
                (Encoding::Ascii, true) => block.extend(format!("{value} ").bytes()),
            }
        }
        self.end_line(block);
    }

    fn push_face(&self, block: &mut Vec<u8>, corners: [u32; 3]) {
        match self.encoding {
            Encoding::Ascii => block.extend(b"3 "),
            _ => block.push(3),
        }
        for corner in corners {
            match self.encoding {
                Encoding::Little => block.extend(corner.to_le_bytes()),
                Encoding::Big => block.extend(corner.to_be_bytes()),
                Encoding::Ascii => block.extend(format!("{corner} ").bytes()),
            }
        }
        self.end_line(block);
    }

    /// A line's end takes the place of the last blank.
    fn end_line(&self, block: &mut [u8]) {
        if self.encoding == Encoding::Ascii
            && let Some(last) = block.last_mut()
        {
            *last = b'\n';
        }
    }
}
