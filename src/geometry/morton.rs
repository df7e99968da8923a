//! Morton codes: space-filling order for cache-friendly sweeps over points.

use glam::Vec3;

/// Spreads the low 21 bits of `x` so that two zero bits follow each.
fn spread(x: u64) -> u64 {
    let mut x = x & 0x1f_ffff;
    x = (x | (x << 32)) & 0x001f_0000_0000_ffff;
    x = (x | (x << 16)) & 0x001f_0000_ff00_00ff;
    x = (x | (x << 8)) & 0x100f_00f0_0f00_f00f;
    x = (x | (x << 4)) & 0x10c3_0c30_c30c_30c3;
    (x | (x << 2)) & 0x1249_2492_4924_9249
}

/// The 63-bit Morton code of an integer cell; coordinates beyond 21 bits wrap.
pub fn encode(cell: [u32; 3]) -> u64 {
    spread(u64::from(cell[0])) | (spread(u64::from(cell[1])) << 1) | (spread(u64::from(cell[2])) << 2)
}

/// The Morton code of `point` on a grid of cells of edge `cell` whose corner is at `origin`.
pub fn code(point: Vec3, origin: Vec3, cell: f32) -> u64 {
    let q = ((point - origin) / cell).max(Vec3::ZERO);
    encode([q.x as u32, q.y as u32, q.z as u32])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_interleave_and_order_octants() {
        assert_eq!(encode([1, 0, 0]), 1);
        assert_eq!(encode([0, 1, 0]), 2);
        assert_eq!(encode([0, 0, 1]), 4);
        assert_eq!(encode([3, 5, 1]), 0b010_001_111);
        assert_eq!(encode([0x1f_ffff; 3]), (1 << 63) - 1);
    }
}
