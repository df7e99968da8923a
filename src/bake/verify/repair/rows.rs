//! Damaged rows, shot once more: the points, keys and lengths of all rows are stored beside them.

use std::ops::Range;
use std::path::Path;

use glam::Vec3;

use super::{Plan, Repaired, RepairedFile, all_fail, damaged};
use crate::archive::{Archive, Block, Encoded, Ledger, Tag, Writer};
use crate::bake::pipeline::leaf_order;
use crate::bake::report::progress::{Monitor, Stage};
use crate::bake::store;
use crate::bake::verify::{Report, file_name};
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::links::Surroundings;
use crate::links::compress::merged;
use crate::links::compress::order::{self, View};
use crate::links::rows::{RawRows, Rows};
use crate::scatter::surface::Surface;
use crate::sites::Cells;
use crate::tree::Support;

const KIND: &str = "links";

/// Shoots the rows of damaged blocks again, if nothing else that they are made from is damaged; whether they came out as the
/// directory says.
pub(super) fn mend(
    job: &Path,
    report: &Report,
    repaired: &mut Repaired,
    monitor: &dyn Monitor,
) -> Result<bool> {
    let name = file_name(KIND);
    let Some(numbers) = damaged(report, &name, |tag| matches!(tag, Some("rows" | "order"))) else {
        return Ok(false);
    };
    if !["scene", "sites"].iter().all(|kind| report.is_whole_file(&file_name(kind))) {
        return Ok(false);
    }
    let archive = Archive::open(job.join(&name))?;
    if !all_fail(&archive, &numbers) {
        return Ok(false);
    }
    let (scene, bvh) = store::read_scene(job)?;
    let (sites, graph, plots) = store::read_sites(job)?;
    let cells = Cells::new(&Surface::new(&scene, leaf_order(&bvh)), &plots);
    let around = Surroundings { scene: &scene, bvh: &bvh, sites: &sites, graph: &graph, cells: &cells };
    let mut shooting = Shooting { around, archive: &archive, last: None };
    let stage = Stage::start(monitor, "rows", "blocks", Some(numbers.len() as u64));
    let plan = Plan { job, kind: KIND, digests: archive.digests(), provenance: archive.provenance() };
    let proven = plan.write(|writer| {
        for block in archive.all_blocks() {
            if numbers.contains(&block.number()) {
                stage.advance(1)?;
                if !shooting.append(writer, block)? {
                    return Ok(false);
                }
            } else {
                writer.append_copy(block)?;
            }
        }
        Ok(true)
    })?;
    stage.finish();
    let made_blocks = numbers.len() as u64;
    let kept_blocks = archive.all_blocks().count() as u64 - made_blocks;
    let file = RepairedFile { file: name, made_blocks, kept_blocks, by: "rows shot anew" };
    repaired.files.extend(proven.then_some(file));
    Ok(proven)
}

/// What rows are shot from, and those of the last block: its fellow has the same.
struct Shooting<'a> {
    around: Surroundings<'a>,
    archive: &'a Archive,
    last: Option<(Range<u64>, Vec<Support>, Rows)>,
}

impl Shooting<'_> {
    /// Makes a block again and appends it; whether it is what the directory lists.
    fn append(&mut self, writer: &mut Writer, block: Block<'_>) -> Result<bool> {
        let entry = *block.entry();
        if self.last.as_ref().is_none_or(|(range, ..)| *range != block.range()) {
            let Some((supports, rows)) = self.shoot(block.range())? else { return Ok(false) };
            self.last = Some((block.range(), supports, rows));
        }
        let Some((_, supports, rows)) = &self.last else { return Ok(false) };
        let all = (0, rows.len());
        let bytes = if entry.tag == Tag::new("rows") {
            merged::encode(rows, all).0
        } else {
            order::encode(View { supports, positions: &self.around.sites.positions }, rows, all)
        };
        let (codec, width_bytes, raw_bytes) = (entry.codec, entry.width_bytes, entry.raw_bytes);
        writer.append_bytes(
            entry.tag,
            entry.range(),
            Encoded { codec, width_bytes, raw_bytes, bytes: &bytes },
        )?;
        Ok(writer.entries().last() == Some(&entry))
    }

    /// The rows of a range of receivers and where they begin; None where the tables do not hold that range.
    fn shoot(&self, range: Range<u64>) -> Result<Option<(Vec<Support>, Rows)>> {
        let (start, end) = (range.start as usize, range.end as usize);
        let tables: &[[u32; 2]] = self.archive.array(Tag::new("tables"))?;
        let points: &[[Vec3; 2]] = self.archive.array(Tag::new("point"))?;
        let radii: &[f32] = self.archive.array(Tag::new("radius"))?;
        let keys: &[u64] = self.archive.array(Tag::new("row_key"))?;
        let own = [points.get(start..end).is_some(), radii.get(start..end).is_some()];
        let (&[long, short], Some(keys), [true, true]) = (tables, keys.get(start..end), own) else {
            return Ok(None);
        };
        let rays = if start < long[0] as usize { long[1] } else { short[1] };
        let point = |&[position, normal]: &[Vec3; 2]| SurfacePoint { position, normal };
        let support = |(p, &radius): (&[Vec3; 2], &f32)| Support { point: point(p), radius };
        let supports: Vec<Support> = points[start..end].iter().zip(&radii[start..end]).map(support).collect();
        let points: Vec<SurfacePoint> = supports.iter().map(|s| s.point).collect();
        let mut raw = RawRows::new(rays);
        let ledger = Ledger::idle(&|| Ok(()));
        raw.extend((self.around.scene, self.around.bvh), (&points, keys), &ledger)?;
        Ok(Some((supports, raw.resolve(self.around, &ledger)?)))
    }
}
