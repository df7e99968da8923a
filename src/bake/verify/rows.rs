//! Invariants of the rows: every receiver is covered once, every ray of it is accounted for, no row gives more than it gets.

use glam::Vec3;

use super::Report;
use super::archives::Opened;
use crate::archive::{Block, Tag};
use crate::bake::report::progress::Stage;
use crate::bake::store::rows::{LINKS_CODEC, MOST_RAYS, ORDER_CODEC};
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::links::compress;
use crate::links::compress::order::View;
use crate::links::rows::{BLACK, LOST, RowSummary, SKY};
use crate::tree::Support;

/// Both tables of rows: how many, and rays each.
pub(super) type Tables = [[u32; 2]; 2];

const ROWS: Tag = Tag::new("rows");
const ORDER: Tag = Tag::new("order");

/// The lengths of both tables.
pub(super) fn tables(file: &Opened, receivers: usize, report: &mut Report) -> Option<Tables> {
    let &[long, own] = file.sized::<[u32; 2]>(report, "tables", 2)? else { return None };
    let sum = u64::from(long[0]) + u64::from(own[0]);
    let outcome = if sum != receivers as u64 {
        Err(format!("expected {receivers} rows, got {} and {}", long[0], own[0]))
    } else if long[1].max(own[1]) > MOST_RAYS {
        Err(format!("expected {MOST_RAYS} rays at the most, got {} and {}", long[1], own[1]))
    } else {
        Ok(())
    };
    file.hold(report, "tables", outcome).then_some([long, own])
}

/// Rays of a row.
pub(super) fn rays_of(tables: &Tables, row: usize) -> u32 {
    tables[usize::from(row >= tables[0][0] as usize)][1]
}

/// Every ray met something or left.
pub(super) fn sums(tables: &Tables, sums: &[[u32; 4]]) -> Result<(), String> {
    for (row, &[hits, inverse, black, escaped]) in sums.iter().enumerate() {
        let (rays, inverse) = (rays_of(tables, row), f32::from_bits(inverse));
        if u64::from(hits) + u64::from(escaped) != u64::from(rays) || black > hits {
            return Err(format!(
                "row {row}: expected {rays} rays, got {hits} hits, {black} of them black, and {escaped} into the sky"
            ));
        }
        if !(inverse.is_finite() && inverse >= 0.0) {
            return Err(format!("row {row}: expected finite distances, got a sum of {inverse}"));
        }
    }
    Ok(())
}

/// Decodes and checks every block of rows; how many links they hold, if all of them are whole.
pub(super) fn check(
    file: &Opened,
    tables: Option<Tables>,
    (sums, positions): (Option<&[[u32; 4]]>, Option<&[Vec3]>),
    report: &mut Report,
    stage: &Stage<'_>,
) -> Result<Option<u64>> {
    let Some(tables) = tables else { return Ok(None) };
    for (name, tag) in [("rows", ROWS), ("order", ORDER)] {
        cover(file, (name, tag), &tables, report);
    }
    let (Some(sums), Some(positions)) = (sums, positions) else { return Ok(None) };
    let (Some(points), Some(radii)) =
        (file.array::<[Vec3; 2]>(report, "point"), file.array::<f32>(report, "radius"))
    else {
        return Ok(None);
    };
    let Some(keys) = file.array::<u64>(report, "row_key") else { return Ok(None) };
    if [points.len(), radii.len(), keys.len()].iter().any(|&n| n != sums.len()) {
        return Ok(None);
    }
    let held = Held { tables, sums, positions, points, radii, keys };
    let mut links = Some(0);
    for (rows, order) in file.archive().blocks(ROWS).zip(file.archive().blocks(ORDER)) {
        let own = if file.is_whole(rows) && file.is_whole(order) {
            held.block(file, (rows, order), report)
        } else {
            None
        };
        links = links.zip(own).map(|(sum, own)| sum + own);
        stage.advance(rows.entry().count)?;
    }
    Ok(links)
}

/// The blocks of a tag follow each other over all receivers without gap or overlap, none over the end of a table.
fn cover(file: &Opened, (name, tag): (&str, Tag), tables: &Tables, report: &mut Report) {
    let (long, all) = (u64::from(tables[0][0]), u64::from(tables[0][0]) + u64::from(tables[1][0]));
    let codec = if tag == ROWS { LINKS_CODEC } else { ORDER_CODEC };
    let (mut next, mut last) = (0, None);
    for block in file.archive().blocks(tag) {
        let (range, entry) = (block.range(), block.entry());
        let end = if range.start < long { long } else { all };
        let bytes = 4 * entry.count * u64::from(rays_of(tables, range.start as usize));
        let problem = if range.start != next || range.end > end || range.is_empty() {
            Some(format!("expected receivers from {next} to {end} at the most, got {range:?}"))
        } else if entry.codec != codec {
            Some(format!("expected codec {codec}, got {}", entry.codec))
        } else if entry.raw_bytes != bytes {
            Some(format!("expected {bytes} bytes of rays, got {}", entry.raw_bytes))
        } else {
            None
        };
        if let Some(problem) = problem {
            file.fault(report, block, problem);
        }
        (next, last) = (range.end, Some(block));
    }
    if next != all {
        let problem = format!("expected blocks over {all} receivers, got {next}");
        match last {
            Some(block) => file.fault(report, block, problem),
            None => {
                file.hold(report, name, Err(problem));
            }
        }
    }
}

/// What rows are held against.
struct Held<'a> {
    tables: Tables,
    sums: &'a [[u32; 4]],
    positions: &'a [Vec3],
    points: &'a [[Vec3; 2]],
    radii: &'a [f32],
    keys: &'a [u64],
}

impl Held<'_> {
    /// Checks two blocks that belong together; their number of links.
    fn block(
        &self,
        file: &Opened,
        (rows, order): (Block<'_>, Block<'_>),
        report: &mut Report,
    ) -> Option<u64> {
        let range = rows.range().start as usize..rows.range().end as usize;
        if rows.range() != order.range() || range.end > self.keys.len() || range.is_empty() {
            return None;
        }
        let rays = rays_of(&self.tables, range.start);
        if rays == 0 {
            return None;
        }
        let support = |r: usize| {
            let [position, normal] = self.points[r];
            Support { point: SurfacePoint { position, normal }, radius: self.radii[r] }
        };
        let supports: Vec<Support> = range.clone().map(support).collect();
        let view = View { supports: &supports, positions: self.positions };
        let mut met = vec![0; range.len() * rays as usize];
        // Copies, so that nobody changes them under the decoder.
        let (links, ways) = (rows.stored().ok()?.to_vec(), order.stored().ok()?.to_vec());
        let decoded = compress::decode((&links, &ways), (view, &self.keys[range.clone()], 0), rays, &mut met);
        let links = decoded.and_then(|()| self.account(range.start, rays, &mut met));
        links.map_err(|problem| file.fault(report, rows, problem)).ok()
    }

    /// Holds what rays met to the summaries of their rows; counts links. Sorts each row.
    fn account(&self, first: usize, rays: u32, met: &mut [u32]) -> Result<u64, String> {
        let mut links = 0;
        for (row, met) in met.chunks_exact_mut(rays as usize).enumerate() {
            let [hits, inverse, black, escaped] = self.sums[first + row];
            met.sort_unstable();
            let of = |mark: u32| met.iter().filter(|&&m| m == mark).count() as u32;
            let (sky, dark, lost) = (of(SKY), of(BLACK), of(LOST));
            let marks = sky + dark + lost;
            // Sides that nothing lights count as black, too, and are no backs.
            if (sky, rays - sky) != (escaped, hits) || dark < black {
                let row = first + row;
                return Err(format!(
                    "row {row}: expected {escaped} rays into the sky and at least {black} onto black sides, got {sky} and {dark}"
                ));
            }
            let summary = RowSummary { hits, inverse_distance: f32::from_bits(inverse), black, escaped };
            let sum = summary.weight(rays, lost) * (rays - marks) as f32;
            // Two roundings of a quotient and one of the product.
            if sum > 1.0 + 4.0 * f32::EPSILON {
                return Err(format!("row {}: expected a sum of at most 1, got {sum}", first + row));
            }
            let sites = &met[..(rays - marks) as usize];
            links += sites.chunk_by(|a, b| a == b).count() as u64;
        }
        Ok(links)
    }
}
