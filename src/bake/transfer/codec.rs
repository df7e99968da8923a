//! Colours in few bytes with a bounded error: steps by the size of the light around, differences, and Rice's code.
//!
//! This work is based on: Rice, "Some Practical Universal Noiseless Coding Techniques", 1979. A run of values has its own step
//! for each channel, a fixed share of the run's root mean square: dark places are as exact as bright ones. Differences from
//! the value before are coded, or how they differ from those of the channel before, whichever is shorter.

use crate::light::Rgb;

/// The codec of blocks that are encoded so.
pub const CODEC: u16 = 5;

/// Values that share their steps.
const RUN: usize = 256;

/// Root mean square of what rounding takes away, over that of a run and channel.
pub const ERROR: f64 = 3.0e-6;

/// A step over the error that rounding to it makes.
const STEP: f64 = 3.464_101_615_137_754_6;

/// Quotients from here on are written as they are, in 32 bits.
const ESCAPE: u32 = 24;

/// The bit of a run's head that says that the channel before foretells differences.
const FORETOLD: u8 = 0x80;

/// Encodes values; finite ones come back with an error of [`ERROR`].
pub fn encode(values: &[Rgb]) -> Vec<u8> {
    let mut bits = Bits::default();
    for run in values.chunks(RUN) {
        let mut before: Option<Vec<i32>> = None;
        for channel in 0..3 {
            let (step, differences) = quantised(run, channel);
            bits.put(step.to_bits(), 32);
            if step == 0.0 {
                before = Some(differences);
                continue;
            }
            let plain: Vec<u32> = differences.iter().map(|&d| zigzag(d)).collect();
            let foretold: Option<Vec<u32>> = before.as_ref().map(|before| {
                differences.iter().zip(before).map(|(&d, &b)| zigzag(d.wrapping_sub(b))).collect()
            });
            let (rice, length) = shortest(&plain);
            let other = foretold.as_ref().map(|words| (shortest(words), words));
            let (head, rice, words) = match other {
                Some(((other, shorter), words)) if shorter < length => (other as u8 | FORETOLD, other, words),
                _ => (rice as u8, rice, &plain),
            };
            bits.put(u32::from(head), 8);
            words.iter().for_each(|&word| bits.rice(word, rice));
            before = Some(differences);
        }
    }
    bits.finish()
}

/// Decodes as many values.
///
/// # Errors
/// A description when the bytes are not those of so many values.
pub fn decode(bytes: &[u8], count: usize) -> Result<Vec<Rgb>, String> {
    // A value takes a bit a channel at least, where a run is not dark, and a dark run has its steps.
    if count.div_ceil(RUN) > bytes.len() / 12 {
        return Err(format!("expected {count} values, got {} bytes", bytes.len()));
    }
    let mut source = Source { bytes, at: 0 };
    let mut values = vec![Rgb::ZERO; count];
    for run in values.chunks_mut(RUN) {
        let mut before = vec![0i32; run.len()];
        for channel in 0..3 {
            let step = f32::from_bits(source.take(32)?);
            if !(step.is_finite() && step >= 0.0) {
                return Err(format!("expected a step from 0 on, got {step}"));
            }
            if step == 0.0 {
                before.fill(0);
                continue;
            }
            let head = source.take(8)? as u8;
            let rice = u32::from(head & !FORETOLD);
            if rice > 31 {
                return Err(format!("expected at most 31 low bits, got {rice}"));
            }
            let mut whole = 0i32;
            for (value, before) in run.iter_mut().zip(&mut before) {
                let word = unzigzag(source.rice(rice)?);
                *before = if head & FORETOLD == 0 { word } else { word.wrapping_add(*before) };
                whole = whole.wrapping_add(*before);
                value[channel] = whole as f32 * step;
            }
            if run.iter().any(|value| !value[channel].is_finite()) {
                return Err(format!("expected finite values, got ones beyond them in steps of {step}"));
            }
        }
    }
    if source.at.div_ceil(8) == bytes.len() {
        Ok(values)
    } else {
        Err(format!("expected {} bytes, got {}", source.at.div_ceil(8), bytes.len()))
    }
}

/// The step of a run's channel and the differences of its values in steps; a step of nought where there is no light.
fn quantised(run: &[Rgb], channel: usize) -> (f32, Vec<i32>) {
    let square: f64 = run.iter().map(|v| f64::from(v[channel]).powi(2)).sum();
    let step = (STEP * ERROR * (square / run.len() as f64).sqrt()) as f32;
    if !(step.is_normal() && step.is_finite()) {
        return (0.0, vec![0; run.len()]);
    }
    let mut last = 0i32;
    let difference = |v: &Rgb| {
        // At most √256 over the step's share: below 2²¹.
        let whole = (f64::from(v[channel]) / f64::from(step)).round() as i32;
        whole.wrapping_sub(std::mem::replace(&mut last, whole))
    };
    (step, run.iter().map(difference).collect())
}

/// The number of low bits that makes words shortest, and their bits.
fn shortest(words: &[u32]) -> (u32, u64) {
    let mean = words.iter().map(|&w| u64::from(w)).sum::<u64>() / words.len() as u64;
    let near = (u64::BITS - mean.leading_zeros()).min(31);
    let bits = |rice: u32| words.iter().map(|&word| u64::from(length(word, rice))).sum::<u64>();
    let tried = near.saturating_sub(2)..=(near + 1).min(31);
    tried.map(|rice| (rice, bits(rice))).min_by_key(|(_, bits)| *bits).unwrap_or((0, 0))
}

fn length(word: u32, rice: u32) -> u32 {
    let quotient = word >> rice;
    if quotient < ESCAPE { quotient + 1 + rice } else { ESCAPE + 32 }
}

fn zigzag(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)) as u32
}

fn unzigzag(word: u32) -> i32 {
    (word >> 1) as i32 ^ -((word & 1) as i32)
}

/// Bits written, lowest first.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    word: u64,
    count: u32,
}

impl Bits {
    fn put(&mut self, value: u32, count: u32) {
        self.word |= u64::from(value) << self.count;
        self.count += count;
        while self.count >= 8 {
            self.bytes.push(self.word as u8);
            self.word >>= 8;
            self.count -= 8;
        }
    }

    /// As many ones as the quotient has, a nought, and the low bits; or [`ESCAPE`] ones and the word.
    fn rice(&mut self, word: u32, rice: u32) {
        let quotient = word >> rice;
        if quotient < ESCAPE {
            self.put((1u32 << quotient) - 1, quotient + 1);
            self.put(word & ((1u32 << rice) - 1), rice);
        } else {
            self.put((1u32 << ESCAPE) - 1, ESCAPE);
            self.put(word, 32);
        }
    }

    fn finish(mut self) -> Vec<u8> {
        if self.count > 0 {
            self.bytes.push(self.word as u8);
        }
        self.bytes
    }
}

/// Bits being read.
struct Source<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Source<'_> {
    /// The next bits, noughts beyond the end.
    fn peek(&self) -> u64 {
        let from = self.at / 8;
        let mut word = [0u8; 8];
        let held = self.bytes.get(from..).unwrap_or_default();
        let held = &held[..held.len().min(8)];
        word[..held.len()].copy_from_slice(held);
        u64::from_le_bytes(word) >> (self.at % 8)
    }

    fn take(&mut self, count: u32) -> Result<u32, String> {
        let word = self.peek() & ((1u64 << count) - 1);
        self.skip(count)?;
        Ok(word as u32)
    }

    fn rice(&mut self, rice: u32) -> Result<u32, String> {
        let quotient = self.peek().trailing_ones().min(ESCAPE);
        if quotient == ESCAPE {
            self.skip(ESCAPE)?;
            return self.take(32);
        }
        self.skip(quotient + 1)?;
        Ok((quotient << rice) | self.take(rice)?)
    }

    fn skip(&mut self, count: u32) -> Result<(), String> {
        self.at += count as usize;
        if self.at <= 8 * self.bytes.len() { Ok(()) } else { Err("it ends too early".to_owned()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash;

    fn random(k: u64) -> f32 {
        (hash::mix2(7, k) >> 40) as f32 / (1u64 << 24) as f32
    }

    fn light(count: u64) -> Vec<Rgb> {
        let value = |k: u64| {
            // Smooth light over seven decades, of both signs, with noise of a hundredth and black runs.
            let size = (-(k as f32) / 300.0).exp() * (k as f32 / 90.0).sin();
            let colour = Rgb::new(1.0, 0.5 + 0.1 * random(k), 0.2);
            if k % 2000 < 300 { Rgb::ZERO } else { colour * (size * (1.0 + 0.01 * random(k + count))) }
        };
        (0..count).map(value).collect()
    }

    #[test]
    fn runs_come_back_with_the_error_that_is_said() {
        for count in [0, 1, 255, 256, 257, 5000] {
            let values = light(count);
            let bytes = encode(&values);
            let back = decode(&bytes, values.len()).unwrap();
            for (own, back) in values.chunks(RUN).zip(back.chunks(RUN)) {
                for channel in 0..3 {
                    let square = |v: &mut dyn Iterator<Item = f64>| v.map(|v| v * v).sum::<f64>();
                    let size = square(&mut own.iter().map(|v| f64::from(v[channel])));
                    let off =
                        square(&mut own.iter().zip(back).map(|(a, b)| f64::from(a[channel] - b[channel])));
                    // Of uniform errors their root mean square is ERROR; half a step each is √3 as much.
                    assert!(off.sqrt() <= 1.8 * ERROR * size.sqrt(), "{off} of {size}");
                }
            }
        }
        let bytes = encode(&light(100_000)).len() as f64 / 3.0e5;
        assert!(bytes < 2.5, "{bytes} bytes a value");
    }

    #[test]
    fn escapes_and_extremes_come_back() {
        let mut values = vec![Rgb::splat(1.0e-20); 300];
        values[7] = Rgb::new(1.0e20, -3.0e10, 0.0);
        values[260] = Rgb::new(f32::MIN_POSITIVE, 1.0, -1.0);
        let back = decode(&encode(&values), values.len()).unwrap();
        assert!((back[7] / values[7] - Rgb::ONE).truncate().abs().max_element() < 1.0e-4, "{}", back[7]);
        assert!((back[260].y - 1.0).abs() < 1.0e-4 && (back[260].z + 1.0).abs() < 1.0e-4);
    }

    #[test]
    fn damage_is_told_not_read() {
        let values = light(1000);
        let bytes = encode(&values);
        assert!(decode(&bytes[..bytes.len() - 1], 1000).is_err());
        assert!(decode(&bytes, 1001).is_err() && decode(&bytes, 700).is_err());
        assert!(decode(&[], 1 << 40).is_err());
        for k in 0..2000 {
            let mut broken = bytes.clone();
            let at = (hash::mix2(3, k) % broken.len() as u64) as usize;
            broken[at] ^= 1 << (k % 8);
            // Whatever comes out, nothing panics.
            let _ = decode(&broken, 1000);
        }
    }
}
