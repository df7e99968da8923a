use crate::{error::Result, scene::assemble::Contents};
use std::path::Path;
/// a
pub fn read(path: &Path) -> Result<Contents> {
    super::ply::read(path)
}
