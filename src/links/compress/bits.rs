//! Bits, the most significant first, and codes of whole numbers that grow with their logarithm.
//!
//! This work is based on: Teuhola, "A compression method for clustered bit-vectors", 1978 (exponential Golomb codes).
//! A code is decoded without a branch on its length: one count of leading zeros and one shift.

/// Codes are at most this long, so that one read of eight bytes holds a whole one wherever it begins.
const LONGEST: u32 = 57;

/// Bytes of zeros after a stream, so that reads of eight bytes stay within it.
pub const SLACK_BYTES: usize = 8;

/// Writes bits to the end of a vector.
#[derive(Debug, Default)]
pub struct BitWriter {
    bytes: Vec<u8>,
    /// The last `filled` of its bits are not yet in `bytes`.
    word: u64,
    filled: u32,
}

impl BitWriter {
    /// Appends the last `length` ≤ 57 bits of a value, whose other bits are zero.
    pub fn push(&mut self, value: u64, length: u32) {
        self.word = self.word << length | value;
        self.filled += length;
        // Eight bytes, of which those that are whole stay: no loop, no branch.
        let whole = self.bytes.len() + (self.filled / 8) as usize;
        self.bytes.extend_from_slice(&self.word.rotate_right(self.filled).to_be_bytes());
        self.bytes.truncate(whole);
        self.filled %= 8;
    }

    /// Appends the exponential Golomb code of a value: 2 log₂(1 + value/2ᵏ) + 1 + k bits, rounded down to odd logs.
    ///
    /// Panics if that is more than 57, as no value below 2³² is with k ≥ 8 and none below 2²⁸ with any.
    pub fn golomb(&mut self, value: u64, k: u32) {
        let word = value + (1 << k);
        let digits = u64::BITS - word.leading_zeros();
        let length = 2 * digits - 1 - k;
        assert!(length <= LONGEST, "a code of {length} bits for {value}, k = {k}");
        self.push(word, length);
    }

    /// The bytes, filled up with zeros to a whole one.
    pub fn finish(mut self) -> Vec<u8> {
        if self.filled > 0 {
            self.push(0, 8 - self.filled % 8);
        }
        self.bytes
    }
}

/// Reads what [`BitWriter`] wrote.
#[derive(Debug, Clone, Copy)]
pub struct BitReader<'a> {
    bytes: &'a [u8],
    /// In bits.
    at: usize,
}

impl<'a> BitReader<'a> {
    /// From the first bit on; [`SLACK_BYTES`] at the end are not part of the stream.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The next 57 bits or more, leading; zeros where too few bytes are left.
    #[inline(always)]
    fn peek(&self) -> u64 {
        let start = self.at >> 3;
        let word = self.bytes.get(start..start + 8).and_then(|b| b.try_into().ok());
        word.map_or(0, u64::from_be_bytes) << (self.at & 7)
    }

    /// The next `length` bits, 1 to 57; zeros past the end.
    pub fn bits(&mut self, length: u32) -> u64 {
        let value = self.peek() >> (64 - length);
        self.at += length as usize;
        value
    }

    /// The next code; None at the end and where there is no code.
    #[inline(always)]
    pub fn golomb(&mut self, k: u32) -> Option<u64> {
        let word = self.peek();
        let length = 2 * word.leading_zeros() + 1 + k;
        if length > LONGEST {
            return None;
        }
        self.at += length as usize;
        Some((word >> (64 - length)) - (1 << k))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::hash;

    #[test]
    fn codes_round_trip() {
        // Of every length up to 28 digits.
        let value = |i: u64| hash::mix2(1, i) % (1 << (hash::mix2(2, i) % 29));
        let k = |i: u64| (hash::mix2(3, i) % 16) as u32;
        let mut writer = BitWriter::default();
        for i in 0..5000 {
            writer.golomb(value(i), k(i));
            writer.push(i & 15, 4);
        }
        let mut bytes = writer.finish();
        bytes.extend([0; SLACK_BYTES]);
        let mut reader = BitReader::new(&bytes);
        for i in 0..5000 {
            assert_eq!((reader.golomb(k(i)), reader.bits(4)), (Some(value(i)), i & 15), "code {i}");
        }
    }

    #[test]
    fn the_end_is_no_code() {
        let mut reader = BitReader::new(&[0x80, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(reader.golomb(0), Some(0));
        assert_eq!(reader.golomb(0), None);
        assert_eq!(BitReader::new(&[]).golomb(3), None);
    }
}
