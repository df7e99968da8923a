//! Damaged headers and paddings, written again around payloads that are whole: the directory repeats every header.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::{Plan, Repaired, RepairedFile, all_fail, damaged};
use crate::archive::{Archive, Encoded, Entry, Writer};
use crate::bake::verify::{ARCHIVES, Report, file_name};
use crate::error::{Error, Result};

/// A block header's length: docs/format.md.
pub(super) const HEADER_BYTES: u64 = 64;

/// Mends files of which nothing but headers and paddings is damaged; whether any was.
pub(super) fn mend(job: &Path, report: &Report, repaired: &mut Repaired) -> Result<bool> {
    let mut any = false;
    for kind in ARCHIVES {
        let name = file_name(kind);
        let path = job.join(&name);
        let Some(numbers) = damaged(report, &name, |_| true) else { continue };
        let Ok(archive) = Archive::open(&path) else { continue };
        if !all_fail(&archive, &numbers) {
            continue;
        }
        let mut file = File::open(&path).map_err(|e| Error::io(&path, "opening", e))?;
        let plan = Plan { job, kind, digests: archive.digests(), provenance: archive.provenance() };
        let proven = plan.write(|writer| {
            for block in archive.all_blocks() {
                if !numbers.contains(&block.number()) {
                    writer.append_copy(block)?;
                } else if !append(writer, &path, &mut file, block.entry())? {
                    return Ok(false);
                }
            }
            Ok(true)
        })?;
        let kept_blocks = archive.all_blocks().count() as u64;
        let mended = RepairedFile { file: name, made_blocks: 0, kept_blocks, by: "headers written anew" };
        repaired.files.extend(proven.then_some(mended));
        any |= proven;
    }
    Ok(any)
}

/// Appends a block from its payload alone; whether it is what the directory lists.
fn append(writer: &mut Writer, path: &Path, file: &mut File, entry: &Entry) -> Result<bool> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(entry.offset + HEADER_BYTES))
        .and_then(|_| file.take(entry.stored_bytes).read_to_end(&mut bytes))
        .map_err(|e| Error::io(path, "reading", e))?;
    let &Entry { codec, width_bytes, raw_bytes, .. } = entry;
    if bytes.len() as u64 != entry.stored_bytes {
        return Ok(false);
    }
    writer.append_bytes(
        entry.tag,
        entry.range(),
        Encoded { codec, width_bytes, raw_bytes, bytes: &bytes },
    )?;
    Ok(writer.entries().last() == Some(entry))
}
