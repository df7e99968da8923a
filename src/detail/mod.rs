//! Meshes bigger than memory: cut into chunks with a hierarchy each, and simplified to a proxy that memory can hold.
//!
//! [`Shards::make`] cuts a streamed mesh, [`write()`] makes chunk after chunk and keeps them in an archive, [`Detail`] reads
//! it back. Every vertex that a face uses lies in one chunk, by its cell; a triangle belongs to the chunk of its first
//! corner. The proxy has a vertex for every cell that is occupied and a triangle for every three cells that some triangle
//! of the file joins.

mod chunk;
mod cut;
mod near;
mod read;
mod simplify;
mod write;

pub use chunk::Chunk;
pub use cut::Shards;
pub use near::near;
pub use read::Detail;
pub use write::write;

/// How a mesh is cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CutParams {
    /// Triangles of a chunk, about: what is built at a time, so memory goes with it.
    pub chunk_triangles: usize,
    /// Wanted number of triangles of the proxy.
    pub proxy_triangles: usize,
}

impl Default for CutParams {
    fn default() -> Self {
        Self { chunk_triangles: 1 << 20, proxy_triangles: 1_000_000 }
    }
}
