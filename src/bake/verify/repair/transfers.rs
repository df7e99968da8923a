//! Transfers that are damaged or gone: solved for once more, by the archives that are whole.

use std::path::Path;

use super::{Repaired, RepairedFile};
use crate::archive::Archive;
use crate::bake::report::progress::Monitor;
use crate::bake::transfer::{self, FILE};
use crate::bake::verify::Report;
use crate::error::{Error, Result};

/// Makes the file anew; whether it had to be.
pub(super) fn mend(
    job: &Path,
    report: &Report,
    repaired: &mut Repaired,
    monitor: &dyn Monitor,
) -> Result<bool> {
    if report.is_whole_file(FILE) {
        return Ok(false);
    }
    let path = job.join(FILE);
    if path.is_file() {
        std::fs::remove_file(&path).map_err(|e| Error::io(&path, "removing what is damaged", e))?;
    }
    transfer::store(job, monitor)?;
    repaired.files.push(RepairedFile {
        file: FILE.to_owned(),
        made_blocks: Archive::open(&path)?.all_blocks().count() as u64,
        kept_blocks: 0,
        by: "lights solved for",
    });
    Ok(true)
}
