//! Yes and no, coded at the cost of the surprise: an adaptive binary range coder.
//!
//! This work is based on: Martin, "Range encoding", 1979, in the carry-propagating form of Pavlov's LZMA.

/// The estimated chance of a yes, adapted with every flip: a mean of all at first, later of the last hundred or so.
#[derive(Debug, Clone, Copy)]
pub struct Coin {
    /// In 2⁻¹⁶.
    chance: u16,
    flips: u8,
}

impl Default for Coin {
    fn default() -> Self {
        Self { chance: 1 << 15, flips: 0 }
    }
}

/// Chances are coded with this many bits.
const CHANCE_BITS: u32 = 12;

/// Ranges below this are widened by a byte.
const NARROW: u32 = 1 << 24;

/// Flips that are remembered: more follow changes later, fewer know less.
const MEMORY: usize = 160;

/// 2¹⁶ / (flips + 1.6): the step after so many flips.
const STEPS: [u32; MEMORY + 1] = {
    let mut steps = [0; MEMORY + 1];
    let mut flips = 0;
    while flips <= MEMORY {
        steps[flips] = 655_360 / (10 * flips as u32 + 16);
        flips += 1;
    }
    steps
};

impl Coin {
    /// In 2⁻¹², neither never nor always.
    fn chance(self) -> u32 {
        u32::from(self.chance >> (16 - CHANCE_BITS)).clamp(1, (1 << CHANCE_BITS) - 1)
    }

    fn learn(&mut self, yes: bool) {
        let step = STEPS[usize::from(self.flips)];
        let far = u32::from(if yes { u16::MAX - self.chance } else { self.chance });
        let change = ((far * step) >> 16) as u16;
        self.chance = if yes { self.chance + change } else { self.chance - change };
        self.flips += u8::from(usize::from(self.flips) < MEMORY);
    }
}

/// Either end of the line: one description of the data serves both, so that they cannot disagree.
pub trait Coder {
    /// Whether the answers are known here, or to be read.
    const WRITES: bool;

    /// Codes one answer: the one given where it is known, else the one that was written.
    fn flip(&mut self, coin: &mut Coin, yes: bool) -> bool;
}

/// The writing end.
#[derive(Debug)]
pub struct Writer {
    low: u64,
    range: u32,
    /// A byte that a carry may still change, and how many bytes of 255 follow it.
    held: u8,
    pending: usize,
    bytes: Vec<u8>,
}

impl Default for Writer {
    fn default() -> Self {
        Self { low: 0, range: u32::MAX, held: 0, pending: 0, bytes: Vec::new() }
    }
}

impl Coder for Writer {
    const WRITES: bool = true;

    #[inline(always)]
    fn flip(&mut self, coin: &mut Coin, yes: bool) -> bool {
        let bound = (self.range >> CHANCE_BITS) * coin.chance();
        self.low += if yes { 0 } else { u64::from(bound) };
        self.range = if yes { bound } else { self.range - bound };
        while self.range < NARROW {
            self.range <<= 8;
            self.shift();
        }
        coin.learn(yes);
        yes
    }
}

impl Writer {
    fn shift(&mut self) {
        let carry = (self.low >> 32) as u8;
        if self.low < 0xff00_0000 || carry > 0 {
            self.bytes.push(self.held.wrapping_add(carry));
            if self.pending > 0 {
                let filled = self.bytes.len() + self.pending;
                self.bytes.resize(filled, 0xff_u8.wrapping_add(carry));
                self.pending = 0;
            }
            self.held = (self.low >> 24) as u8;
        } else {
            self.pending += 1;
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    /// The bytes written.
    pub fn finish(mut self) -> Vec<u8> {
        (0..5).for_each(|_| self.shift());
        self.bytes
    }
}

/// The reading end. Past the end of the bytes it reads zeros: what it says then is nonsense, but comes to an end.
#[derive(Debug)]
pub struct Reader<'a> {
    code: u32,
    range: u32,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Of what a [`Writer`] wrote.
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut reader = Reader { code: 0, range: u32::MAX, bytes, at: 0 };
        (0..5).for_each(|_| reader.code = reader.code << 8 | reader.byte());
        reader
    }

    fn byte(&mut self) -> u32 {
        let byte = self.bytes.get(self.at).copied().unwrap_or(0);
        self.at += 1;
        u32::from(byte)
    }
}

impl Coder for Reader<'_> {
    const WRITES: bool = false;

    #[inline(always)]
    fn flip(&mut self, coin: &mut Coin, _: bool) -> bool {
        let bound = (self.range >> CHANCE_BITS) * coin.chance();
        let yes = self.code < bound;
        self.code -= if yes { 0 } else { bound };
        self.range = if yes { bound } else { self.range - bound };
        while self.range < NARROW {
            self.range <<= 8;
            self.code = self.code << 8 | self.byte();
        }
        coin.learn(yes);
        yes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash;

    #[test]
    fn answers_come_back_and_cost_their_surprise() {
        const FLIPS: u64 = 200_000;
        // Seven yes in eight on one coin, one in 64 on another, now and then a long run that makes carries.
        let answer = |i: u64| match i % 3 {
            0 => !hash::mix2(1, i).is_multiple_of(8),
            1 => hash::mix2(2, i).is_multiple_of(64),
            _ => (i / 5000).is_multiple_of(2),
        };
        let mut coder = Writer::default();
        let mut coins = [Coin::default(); 3];
        (0..FLIPS).for_each(|i| assert_eq!(coder.flip(&mut coins[(i % 3) as usize], answer(i)), answer(i)));
        let bytes = coder.finish();
        let mut coder = Reader::new(&bytes);
        let mut coins = [Coin::default(); 3];
        for i in 0..FLIPS {
            assert_eq!(coder.flip(&mut coins[(i % 3) as usize], false), answer(i), "flip {i}");
        }
        // Entropies of 0.544, 0.116 and nothing a flip, a third each: 0.220. A change of the third coin's mind costs
        // m π²/(6 ln 2) = 380 bits with m = 160 remembered, 40 of them 0.076 a flip: 0.296 in all. Forgetting costs the
        // other two 1/(4 m ln 2) = 0.002, and the draws' own spread is 0.0015.
        let bits = bytes.len() as f64 * 8.0 / FLIPS as f64;
        assert!((0.291..0.303).contains(&bits), "{bits} bits a flip");
    }
}
