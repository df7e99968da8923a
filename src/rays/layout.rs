//! The hierarchy as two flat arrays of plain old data: branches of eight boxes and packets of four triangles.
//!
//! Both are written to archives and mapped back as they are, so their layout is part of the format: little-endian,
//! 256 and 160 bytes, aligned to 64 and 32. A packet owns copies of its corners: a ray never touches the scene's arrays.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Children of a branch.
pub const FAN: usize = 8;

/// Triangles in a packet.
pub const LANES: usize = 4;

/// Branches on the longest way down that a traversal has room for.
///
/// A tree of fan 8 over 4 G triangles needs 10 when it is balanced; measured trees over scans stay below 16. A build
/// that would be deeper is laid out again in balanced form, an archive that is deeper is refused.
pub const DEPTH_LIMIT: usize = 32;

/// The [`Packet::triangle`] of a lane without a triangle.
pub const NO_TRIANGLE: u32 = u32::MAX;

/// One reference of a branch: nothing, another branch, or a run of packets.
///
/// Bit 31 set: packets, their number less one in bits 29–30, the first one's index in bits 0–28. Bit 31 clear: the
/// index of a branch; 0 (the root, nobody's child) stands for nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Child(u32);

impl Child {
    /// Refers to nothing.
    pub const NONE: Self = Self(0);
    /// Packets one reference can cover.
    pub const MAX_PACKETS: usize = 4;
    const PACKETS: u32 = 1 << 31;
    const INDEX: u32 = (1 << 29) - 1;

    /// Refers to the branch at `index`, which must lie in 1..2³¹.
    pub fn branch(index: usize) -> Self {
        assert!(index > 0 && index < Self::PACKETS as usize, "branch index {index} is outside 1..2^31");
        Self(index as u32)
    }

    /// Refers to `count` packets from `first` on; 1 to 4 packets below index 2²⁹.
    pub fn packets(first: usize, count: usize) -> Self {
        assert!((1..=Self::MAX_PACKETS).contains(&count), "a child covers 1 to 4 packets, not {count}");
        assert!(first + count <= Self::INDEX as usize + 1, "packet index {first} is beyond 2^29");
        Self(Self::PACKETS | ((count as u32 - 1) << 29) | first as u32)
    }

    /// Whether it refers to nothing.
    #[inline]
    pub fn is_none(self) -> bool {
        self.0 == 0
    }

    /// The branch referred to, if it is one.
    #[inline]
    pub fn as_branch(self) -> Option<usize> {
        (self.0 & Self::PACKETS == 0 && self.0 != 0).then_some(self.0 as usize)
    }

    /// Whether it refers to packets.
    #[inline]
    pub fn is_packets(self) -> bool {
        self.0 & Self::PACKETS != 0
    }

    /// First packet and the one after the last, if it refers to packets.
    #[inline]
    pub fn packet_range(self) -> std::ops::Range<usize> {
        let first = (self.0 & Self::INDEX) as usize;
        first..first + ((self.0 >> 29) & 3) as usize + 1
    }

    /// The bits as stored.
    #[inline]
    pub fn bits(self) -> u32 {
        self.0
    }

    /// From the bits as stored.
    #[inline]
    pub fn from_bits(bits: u32) -> Self {
        Self(bits)
    }
}

/// Eight boxes and what lies in them.
///
/// `planes[2·axis]` are the lower, `planes[2·axis + 1]` the upper faces. A vacant place has the box +∞…−∞, which no ray
/// meets.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Branch {
    /// Faces of the boxes, local units.
    pub planes: [[f32; FAN]; 6],
    /// What each box holds.
    pub children: [Child; FAN],
    /// Zero; rounds the size up to four cache lines.
    pub reserved: [u32; FAN],
}

impl Branch {
    /// A branch without children.
    pub fn vacant() -> Self {
        let mut planes = [[f32::INFINITY; FAN]; 6];
        for axis in 0..3 {
            planes[2 * axis + 1] = [f32::NEG_INFINITY; FAN];
        }
        Self { planes, children: [Child::NONE; FAN], reserved: [0; FAN] }
    }

    /// Fills one of the eight places.
    pub fn set(&mut self, place: usize, lower: Vec3, upper: Vec3, child: Child) {
        for axis in 0..3 {
            self.planes[2 * axis][place] = lower[axis];
            self.planes[2 * axis + 1][place] = upper[axis];
        }
        self.children[place] = child;
    }
}

/// Four triangles side by side, for one vector test; vacant lanes hold NaNs, which no test lets pass, and [`NO_TRIANGLE`].
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(32))]
pub struct Packet {
    /// `corners[corner][axis][lane]`, local units.
    pub corners: [[[f32; LANES]; 3]; 3],
    /// The triangles' numbers.
    pub triangle: [u32; LANES],
}

impl Packet {
    /// A packet without triangles.
    pub fn vacant() -> Self {
        Self { corners: [[[f32::NAN; LANES]; 3]; 3], triangle: [NO_TRIANGLE; LANES] }
    }

    /// The triangles it holds.
    pub fn triangles(&self) -> impl Iterator<Item = u32> + use<> {
        self.triangle.into_iter().filter(|&t| t != NO_TRIANGLE)
    }

    /// Fills one of the four lanes.
    pub fn set(&mut self, lane: usize, corners: [Vec3; 3], triangle: u32) {
        for (corner, position) in corners.iter().enumerate() {
            for axis in 0..3 {
                self.corners[corner][axis][lane] = position[axis];
            }
        }
        self.triangle[lane] = triangle;
    }
}

/// A reference of a stored hierarchy that leads nowhere, or a tree too deep to walk.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("branch {branch} of {branches}: {problem}")]
pub struct Malformed {
    /// The offending branch.
    pub branch: usize,
    /// Branches in all.
    pub branches: usize,
    /// What is wrong with it.
    pub problem: String,
}

/// Checks that every reference stays within the arrays and leads forward, and that the depth is bounded.
///
/// One pass, O(branches) time and one byte a branch. Forward references make cycles impossible. Boxes and corners are
/// numbers and may hold anything: the worst they can do is to give wrong hits. Lane numbers are not looked at.
///
/// # Errors
/// [`Malformed`] with the first branch found at fault.
pub fn check(branches: &[Branch], packets: usize) -> Result<(), Malformed> {
    let fault = |branch, problem| Malformed { branch, branches: branches.len(), problem };
    let mut depth = vec![0u8; branches.len()];
    for (index, branch) in branches.iter().enumerate() {
        for child in branch.children {
            if child.is_packets() {
                let range = child.packet_range();
                if range.end > packets {
                    return Err(fault(index, format!("refers to packets {range:?} of {packets}")));
                }
            } else if let Some(below) = child.as_branch() {
                if below <= index || below >= branches.len() {
                    return Err(fault(
                        index,
                        format!("refers to branch {below}, not forward within the array"),
                    ));
                }
                let level = depth[index] + 1;
                if usize::from(level) >= DEPTH_LIMIT {
                    return Err(fault(index, format!("lies at depth {level}, where no children may be")));
                }
                depth[below] = depth[below].max(level);
            }
        }
    }
    Ok(())
}
