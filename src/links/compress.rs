//! Rows as bytes: neighbouring rays meet neighbouring sites, so ids are stored as differences along the lattice curve.
//!
//! One token a ray, LEB128: 0 sky, 1 black, 2 lost, else 3 + zigzag(id − last id). Sites are in Morton order, so most
//! differences fit one byte; the ray's direction is its place in the row and costs nothing.

use super::rows::{BLACK, LOST, SKY};

/// Appends the encoding of one row to `out`.
pub fn encode(row: &[u32], out: &mut Vec<u8>) {
    let mut last = 0u32;
    for &met in row {
        let token = match met {
            SKY => 0,
            BLACK => 1,
            LOST => 2,
            site => {
                let delta = i64::from(site) - i64::from(last);
                last = site;
                3 + ((delta << 1) ^ (delta >> 63)) as u64
            }
        };
        push_leb128(out, token);
    }
}

/// Decodes one row of `row.len()` rays from the front of `bytes`; returns how many bytes it took.
///
/// Errors with a description when the bytes end early or name a site at or beyond `sites`.
pub fn decode(bytes: &[u8], sites: u32, row: &mut [u32]) -> Result<usize, String> {
    let mut last = 0i64;
    let mut at = 0;
    for met in row.iter_mut() {
        let (token, length) = leb128(&bytes[at..]).ok_or_else(|| format!("row ends at byte {at}"))?;
        at += length;
        *met = match token {
            0 => SKY,
            1 => BLACK,
            2 => LOST,
            t => {
                let zigzag = t - 3;
                last = last.wrapping_add((zigzag >> 1) as i64 ^ -((zigzag & 1) as i64));
                if last < 0 || last >= i64::from(sites) {
                    return Err(format!("site {last} of {sites} at byte {at}"));
                }
                last as u32
            }
        };
    }
    Ok(at)
}

fn push_leb128(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// The value and its length; None if the bytes end first or the value is longer than any row has.
fn leb128(bytes: &[u8]) -> Option<(u64, usize)> {
    let mut value = 0;
    for (k, &byte) in bytes.iter().take(6).enumerate() {
        value |= u64::from(byte & 0x7f) << (7 * k);
        if byte < 0x80 {
            return Some((value, k + 1));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash;

    #[test]
    fn rows_round_trip_with_every_mark() {
        let row: Vec<u32> = (0..1000u64)
            .map(|i| match hash::mix2(1, i) % 8 {
                0 => SKY,
                1 => BLACK,
                2 => LOST,
                3 => (hash::mix2(2, i) % 4_000_000_000) as u32,
                _ => 77 + (i % 5) as u32,
            })
            .collect();
        let mut bytes = vec![9];
        encode(&row, &mut bytes);
        let mut back = vec![0; row.len()];
        assert_eq!(decode(&bytes[1..], 4_000_000_000, &mut back), Ok(bytes.len() - 1));
        assert_eq!(row, back);
    }

    #[test]
    fn damage_is_named_not_believed() {
        let mut bytes = Vec::new();
        encode(&[5, 6, 7], &mut bytes);
        let mut row = [0; 3];
        assert!(decode(&bytes, 7, &mut row).unwrap_err().contains("site 7 of 7"));
        assert!(decode(&bytes[..2], 100, &mut row).unwrap_err().contains("ends"));
        assert!(decode(&[0xff; 20], 100, &mut row).is_err());
    }
}
