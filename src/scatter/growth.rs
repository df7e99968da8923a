//! Levels of candidates: each level halves the spacing and keeps only the pieces that want more.
//!
//! This work is based on: Lehtinen et al., "A Meshless Hierarchical Representation for Light Transport", SIGGRAPH 2008
//! (nested Poisson-disk levels); we place the levels coarse to fine and only where they are wanted.

use rayon::prelude::*;

use super::Candidate;
use super::surface::{Dart, Piece, Surface};
use crate::geometry::hash;

/// Pieces are split until they are no larger than this many squared spacings: a few dozen candidates each.
const PIECE_SPACINGS: f32 = 16.0;

/// One level after another over the surface.
pub struct Growth<'a> {
    surface: &'a Surface<'a>,
    /// The level, root = 0.
    pub level: u32,
    /// Its spacing, local units.
    pub spacing: f32,
    /// The pieces of surface that still want points.
    pub active: Vec<Piece>,
    seed: u64,
}

impl<'a> Growth<'a> {
    /// The first level: all of the surface, at the given spacing.
    pub fn new(surface: &'a Surface<'a>, spacing: f32, seed: u64) -> Self {
        let mut growth = Self { surface, level: 0, spacing, active: surface.whole(), seed };
        growth.split();
        growth
    }

    /// Stratified candidates on the active pieces, `density` a squared spacing and at least one a piece, piece by piece.
    pub fn candidates(&self, density: f32) -> Vec<Candidate> {
        (0..self.active.len())
            .into_par_iter()
            .with_min_len(16)
            .flat_map_iter(|piece| {
                let count = self.count(piece, density);
                let seed = self.level_seed();
                let own = (piece as u32, &self.active[piece]);
                (0..count).map(move |i| self.surface.candidate(own, (i, count), seed))
            })
            .collect()
    }

    /// How many candidates an active piece gets.
    pub fn count(&self, piece: usize, density: f32) -> u32 {
        ((self.active[piece].area * (density / (self.spacing * self.spacing))).ceil() as u32).max(1)
    }

    /// Candidate `i` of the lattice of `count` of an active piece.
    pub fn candidate(&self, piece: usize, (i, count): (u32, u32)) -> Candidate {
        self.surface
            .stand(piece as u32, &self.surface.spot(&self.active[piece], (i, count), self.level_seed()))
    }

    /// Calls `visit` with what throwing needs of a piece's lattice.
    pub fn darts(&self, piece: usize, density: f32, visit: impl FnMut(Dart)) {
        let count = self.count(piece, density);
        self.surface.darts((piece as u32, &self.active[piece]), count, self.level_seed(), visit);
    }

    fn level_seed(&self) -> u64 {
        hash::mix2(self.seed, u64::from(self.level))
    }

    /// Goes to the next level with the pieces for which `keep` is set; the others are done.
    pub fn descend(&mut self, keep: &[bool]) {
        let kept = self.active.iter().zip(keep).filter(|(_, k)| **k).map(|(p, _)| *p).collect();
        self.active = kept;
        self.level += 1;
        self.spacing *= 0.5;
        self.split();
    }

    fn split(&mut self) {
        let limit = PIECE_SPACINGS * self.spacing * self.spacing;
        let surface = self.surface;
        self.active = std::mem::take(&mut self.active)
            .into_par_iter()
            .flat_map_iter(|piece| {
                let mut done = Vec::new();
                let mut open = vec![piece];
                while let Some(piece) = open.pop() {
                    let parts = if piece.area > limit { surface.split(&piece) } else { Default::default() };
                    if parts.len() < 2 {
                        done.push(piece);
                    } else {
                        open.extend(parts.into_iter().rev());
                    }
                }
                done
            })
            .collect();
    }
}
