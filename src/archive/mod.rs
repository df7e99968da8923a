//! The block container that every stage file of a job uses; byte by byte in `docs/format.md`.
//!
//! A file is a superblock, blocks of flat arrays, a directory and a trailer. It is written once, under a
//! temporary name, and renamed when it is whole, so a file that carries its own name is finished:
//!
//! ```no_run
//! use glowtree::archive::{Archive, Digest, Digests, Tag, Writer};
//! # fn main() -> glowtree::Result<()> {
//! const SITES: Tag = Tag::new("sites");
//! const AREAS: Tag = Tag::new("areas");
//! let digests = Digests { inputs: Digest::of_bytes(b"mesh"), options: Digest::of_options(&0.01)? };
//! let mut writer = Writer::create("job/sites.glow", SITES, digests)?;
//! writer.append(AREAS, 0..3, &[0.5_f32, 0.25, 0.25])?;
//! writer.finish(&[("program", "glowtree 0.1.0")])?;
//!
//! let archive = Archive::open("job/sites.glow")?;
//! archive.expect(digests.inputs, digests.options)?;
//! let areas: &[f32] = archive.array(AREAS)?;
//! # Ok(()) }
//! ```
//!
//! [`Archive`] reads, [`Writer`] writes and resumes, [`verify()`] recomputes every checksum, [`Storage`] is the seam
//! under the writer through which tests make disks fail. A [`Ledger`] is an archive under way: what a run has done so far.

#[cfg(not(target_endian = "little"))]
compile_error!("archives are little-endian arrays read in place: big-endian hosts are not supported");

mod digest;
mod layout;
mod ledger;
mod map;
mod reader;
mod storage;
mod verify;
mod writer;

pub use digest::Digest;
pub use layout::{ALIGNMENT, Digests, Entry, FORMAT_VERSION, PLAIN, SUPERBLOCK_BYTES, Tag};
pub use ledger::parcel::{Keep, One, Parcel, Parts};
pub use ledger::{Counts, Ledger, Pause};
#[cfg(unix)]
pub use map::leave_when_cut;
pub use map::{Access, Map};
pub use reader::{Archive, Block};
pub use storage::{Disk, Storage, StoredFile};
pub use verify::{Damage, VerifyReport, verify};
pub use writer::{Encoded, Finished, Resumed, Writer, partial_path};
