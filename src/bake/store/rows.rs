//! Receivers and both tables of their rows as blocks of a job, and back.

use std::ops::Range;

use glam::Vec3;

use super::{Purpose, damaged, same_length, tag};
use crate::archive::{Archive, Block, Encoded, Ledger, One, Writer};
use crate::bake::model::Model;
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::links::compress::order::View;
use crate::links::compress::{self, merged, order};
use crate::links::receivers::Receivers;
use crate::links::rows::{RowSummary, Rows};
use crate::sites::{SiteId, Sites};
use crate::tree::Support;
use crate::tree::index::SupportIndex;

/// Rows per block of links.
const BLOCK_ROWS: usize = 4096;
/// Longer rows are no rows: bounds what a claim makes a reader allocate.
pub(in crate::bake) const MOST_RAYS: u32 = 1 << 16;
/// The codec of links, [`compress::merged`], in blocks of one of two tables.
pub(in crate::bake) const LINKS_CODEC: u16 = 3;
/// The codec of the rays' order: [`compress::order`].
pub(in crate::bake) const ORDER_CODEC: u16 = 4;

/// Writes receivers and rows.
pub(super) fn write(w: &mut Writer, model: &Model, packed: &Packed) -> Result<()> {
    let receivers = &model.receivers;
    let (tables, supports) = (receivers.tables().map(|(_, rows)| rows), receivers.index.supports());
    let all = 0..receivers.len() as u64;
    let ids: Vec<u32> = receivers.homes.iter().map(|s| s.0).collect();
    let radii: Vec<f32> = supports.iter().map(|s| s.radius).collect();
    let points: Vec<[Vec3; 2]> = supports.iter().map(|s| [s.point.position, s.point.normal]).collect();
    let counts = |s: &RowSummary| [s.hits, s.inverse_distance.to_bits(), s.black, s.escaped];
    let counts: Vec<[u32; 4]> = tables.iter().flat_map(|rows| &rows.summaries).map(counts).collect();
    let keys: Vec<u64> = tables.iter().flat_map(|rows| &rows.keys).copied().collect();
    w.append(tag("tables"), 0..2, &tables.map(|rows| [rows.len() as u32, rows.rays]))?;
    w.append(tag("receiver"), all.clone(), &ids)?;
    w.append(tag("radius"), all.clone(), &radii)?;
    w.append(tag("point"), all.clone(), &points)?;
    w.append(tag("row_key"), all.clone(), &keys)?;
    w.append(tag("row_sums"), all, &counts)?;
    for PackedBlock { rows, raw_bytes, links, order } in &packed.blocks {
        let encoded = |codec, bytes| Encoded { codec, width_bytes: 4, raw_bytes: *raw_bytes, bytes };
        w.append_bytes(tag("rows"), rows.clone(), encoded(LINKS_CODEC, links))?;
        w.append_bytes(tag("order"), rows.clone(), encoded(ORDER_CODEC, order))?;
    }
    Ok(())
}

/// Rows as they are stored.
pub(super) struct Packed {
    blocks: Vec<PackedBlock>,
    /// Links: pairs of a receiver and a site that some of its rays met.
    pub links: u64,
}

struct PackedBlock {
    rows: Range<u64>,
    raw_bytes: u64,
    links: Vec<u8>,
    order: Vec<u8>,
}

/// Encodes both tables of rows, block by block: no block has rows of both.
pub(super) fn pack(model: &Model, ledger: &Ledger<'_>) -> Result<Packed> {
    let mut packed = Packed { blocks: Vec::new(), links: 0 };
    let supports = model.receivers.index.supports();
    for (before, rows) in model.receivers.tables() {
        let view = View { supports: &supports[before..], positions: &model.sites.positions };
        for first in (0..rows.len()).step_by(BLOCK_ROWS) {
            let last = (first + BLOCK_ROWS).min(rows.len());
            let range = (before + first) as u64..(before + last) as u64;
            let (links, order, One(count)) = ledger.keep(tag("packed"), range.clone(), || {
                let (links, count) = merged::encode(rows, (first, last));
                Ok((links, order::encode(view, rows, (first, last)), One(count)))
            })?;
            let raw_bytes = (last - first) as u64 * u64::from(rows.rays) * 4;
            packed.blocks.push(PackedBlock { rows: range, raw_bytes, links, order });
            packed.links += count;
        }
    }
    Ok(packed)
}

/// Reads receivers, and rows if the purpose asks for them.
pub(super) fn read(archive: &Archive, sites: &Sites, purpose: Purpose) -> Result<Receivers> {
    // First of all: jobs of other versions have other arrays, too.
    archive.blocks(tag("rows")).try_for_each(|block| expect_codec(archive, &block, LINKS_CODEC))?;
    let ids: &[u32] = archive.array(tag("receiver"))?;
    if ids.iter().any(|&s| s as usize >= sites.len()) {
        return Err(damaged(archive, "receiver", format!("expected sites below {}", sites.len())));
    }
    let supports = read_supports(archive, ids.len())?;
    let lengths = read_lengths(archive, ids.len())?;
    let keys: &[u64] = archive.array(tag("row_key"))?;
    let counts: &[[u32; 4]] = archive.array(tag("row_sums"))?;
    same_length(archive, "row_key", keys, ids.len())?;
    same_length(archive, "row_sums", counts, ids.len())?;
    let [met, met_own] = match purpose {
        Purpose::Light => read_rows(archive, (&supports, keys, lengths), sites)?,
        // Who does not use them need not touch them: gigabytes, in a large job.
        Purpose::Answers => [Vec::new(), Vec::new()],
    };
    let summary = |&[hits, sum, black, escaped]: &[u32; 4]| {
        let inverse_distance = f32::from_bits(sum);
        RowSummary { hits, inverse_distance, black, escaped }
    };
    let long = lengths[0][0] as usize;
    let table = |range: Range<usize>, rays, met| Rows {
        rays,
        keys: keys[range.clone()].to_vec(),
        met,
        summaries: counts[range].iter().map(summary).collect(),
    };
    Ok(Receivers {
        homes: ids.iter().map(|&s| SiteId(s)).collect(),
        lift: 0.0,
        index: SupportIndex::new(&supports),
        rows: table(0..long, lengths[0][1], met),
        own: table(long..ids.len(), lengths[1][1], met_own),
    })
}

/// How many rows each table has and how many rays a row.
fn read_lengths(archive: &Archive, receivers: usize) -> Result<[[u32; 2]; 2]> {
    let &[long, own] = archive.array::<[u32; 2]>(tag("tables"))? else {
        return Err(damaged(archive, "tables", "expected two entries"));
    };
    if u64::from(long[0]) + u64::from(own[0]) != receivers as u64 {
        let problem = format!("expected {receivers} rows, got {} and {}", long[0], own[0]);
        return Err(damaged(archive, "tables", problem));
    }
    let most = long[1].max(own[1]);
    if most > MOST_RAYS {
        return Err(damaged(archive, "tables", format!("expected {MOST_RAYS} rays at the most, got {most}")));
    }
    Ok([long, own])
}

fn read_supports(archive: &Archive, receivers: usize) -> Result<Vec<Support>> {
    let radii: &[f32] = archive.array(tag("radius"))?;
    let points: &[[Vec3; 2]] = archive.array(tag("point"))?;
    same_length(archive, "radius", radii, receivers)?;
    same_length(archive, "point", points, receivers)?;
    let support = |(&[position, normal], &radius): (&[Vec3; 2], &f32)| Support {
        point: SurfacePoint { position, normal },
        radius,
    };
    Ok(points.iter().zip(radii).map(support).collect())
}

/// What the rays of both tables met.
fn read_rows(
    archive: &Archive,
    (supports, keys, lengths): (&[Support], &[u64], [[u32; 2]; 2]),
    sites: &Sites,
) -> Result<[Vec<u32>; 2]> {
    let mut met = [Vec::new(), Vec::new()];
    let view = View { supports, positions: &sites.positions };
    let long = u64::from(lengths[0][0]);
    let mut next = 0;
    for (links, order) in archive.blocks(tag("rows")).zip(archive.blocks(tag("order"))) {
        expect_codec(archive, &order, ORDER_CODEC)?;
        let range = links.range();
        let table = usize::from(range.start >= long);
        let end = if table == 0 { long } else { keys.len() as u64 };
        if range != order.range() || range.start != next || range.end > end {
            let problem = format!("rows {range:?} with the order of {:?}, after {next}", order.range());
            return Err(damaged(archive, "rows", problem));
        }
        next = range.end;
        let (rays, start) = (lengths[table][1], met[table].len());
        let count = (range.end - range.start) as usize;
        met[table].resize(start + count * rays as usize, 0);
        let place = (view, keys, range.start as usize);
        compress::decode((links.stored()?, order.stored()?), place, rays, &mut met[table][start..])
            .map_err(|problem| damaged(archive, "rows", problem))?;
    }
    for (met, [rows, rays]) in met.iter().zip(lengths) {
        same_length(archive, "rows", met, rows as usize * rays as usize)?;
    }
    Ok(met)
}

fn expect_codec(archive: &Archive, block: &Block<'_>, codec: u16) -> Result<()> {
    if block.entry().codec == codec {
        return Ok(());
    }
    let problem = format!("expected codec {codec}, got {}: bake again", block.entry().codec);
    Err(damaged(archive, &block.entry().tag.to_string(), problem))
}
