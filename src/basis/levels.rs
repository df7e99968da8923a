//! Nested subsets of supports, coarse to fine.
//!
//! This work is based on: Floater and Iske, "Multistep scattered data interpolation using compactly supported radial basis
//! functions", 1996 (nested subsets that are as even as can be), and Cook 1986 (darts). We thin greedily in the order given
//! instead of by farthest points: every level is a maximal set of points no closer than its spacing.

use super::kernels::Space;
use crate::geometry::SurfacePoint;
use crate::scatter::octaves::Octaves;

/// One of the nested subsets.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// Numbers of its points; those of the coarser level first.
    pub members: Vec<u32>,
    /// Its members are no closer than this; every point that is not a member lies closer to one.
    pub spacing: f32,
}

/// Nested subsets whose spacing halves from level to level, in the space that belongs to each spacing; fewer than `most` once
/// all points are members.
///
/// Spaces must not bring points closer as the spacing falls, relative to it. Cost: O(n) a level.
pub fn nested(
    points: &[SurfacePoint],
    coarsest: f32,
    most: usize,
    space: impl Fn(f32) -> Space,
) -> Vec<Level> {
    let mut levels: Vec<Level> = Vec::new();
    let mut spacing = coarsest;
    while levels.len() < most {
        let before = levels.last().map_or(&[][..], |l| &l.members);
        let members = thinned(points, before, spacing, space(spacing));
        let complete = members.len() == points.len();
        levels.push(Level { members, spacing });
        if complete {
            break;
        }
        spacing *= 0.5;
    }
    levels
}

/// A maximal set of points no closer than a spacing, the given ones first.
fn thinned(points: &[SurfacePoint], first: &[u32], spacing: f32, space: Space) -> Vec<u32> {
    let mut members = first.to_vec();
    let mut taken = vec![false; points.len()];
    let mut grid = Octaves::default();
    for &m in first {
        taken[m as usize] = true;
        grid.push(m, points[m as usize].position, spacing);
    }
    for (k, point) in points.iter().enumerate() {
        if taken[k] {
            continue;
        }
        let mut free = true;
        grid.for_each(point.position, |o| {
            free &= space.distance(&points[o as usize], point) >= f64::from(spacing);
        });
        if free {
            members.push(k as u32);
            grid.push(k as u32, point.position, spacing);
        }
    }
    members
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::geometry::hash;

    #[test]
    fn levels_are_nested_apart_and_cover() {
        let points: Vec<SurfacePoint> = (0..2000)
            .map(|i| {
                let [x, y] = hash::unit_pair(11, i);
                SurfacePoint { position: Vec3::new(x, y, 0.0), normal: Vec3::Z }
            })
            .collect();
        let space = Space { turn: 0.0 };
        let levels = nested(&points, 0.25, 12, |_| space);
        let all = levels.last().unwrap();
        assert_eq!(all.members.len(), points.len());
        for pair in levels.windows(2) {
            assert!(
                pair[1].members.starts_with(&pair[0].members) && pair[1].spacing == 0.5 * pair[0].spacing
            );
        }
        for level in &levels[..4] {
            let near = |k: usize| {
                let others = level.members.iter().filter(|m| **m as usize != k);
                others.map(|&m| space.distance(&points[k], &points[m as usize])).fold(f64::INFINITY, f64::min)
            };
            let spacing = f64::from(level.spacing);
            assert!(level.members.iter().all(|&m| near(m as usize) >= spacing));
            let outside = (0..points.len()).filter(|k| !level.members.contains(&(*k as u32)));
            assert!(outside.into_iter().all(|k| near(k) < spacing));
        }
    }
}
