//! Sets of vertex numbers as bits, and how many come before each.

/// A set of numbers in a range.
pub struct Bits {
    first: u32,
    words: Vec<u64>,
}

impl Bits {
    /// The empty set over `first..=last`.
    pub fn over(first: u32, last: u32) -> Self {
        let words = (last - first) as usize / 64 + 1;
        Self { first, words: vec![0; words] }
    }

    /// Adds a number of the range.
    #[inline]
    pub fn insert(&mut self, number: u32) {
        let at = (number - self.first) as usize;
        self.words[at / 64] |= 1 << (at % 64);
    }

    /// Whether a number of the range is in.
    #[inline]
    pub fn contains(&self, number: u32) -> bool {
        let at = (number - self.first) as usize;
        self.words[at / 64] >> (at % 64) & 1 == 1
    }

    /// How many are in.
    pub fn count(&self) -> u64 {
        self.words.iter().map(|word| u64::from(word.count_ones())).sum()
    }

    /// All numbers that are in, ascending.
    pub fn numbers(&self) -> Vec<u32> {
        let mut numbers = Vec::with_capacity(self.count() as usize);
        for (at, &word) in self.words.iter().enumerate() {
            let mut left = word;
            while left != 0 {
                numbers.push(self.first + at as u32 * 64 + left.trailing_zeros());
                left &= left - 1;
            }
        }
        numbers
    }

    /// The same set, able to tell ranks.
    pub fn ranked(self) -> Ranks {
        let mut sum = 0;
        let before = self.words.iter().map(|word| {
            sum += word.count_ones();
            sum - word.count_ones()
        });
        let before = before.collect();
        Ranks { bits: self, before }
    }
}

/// A set whose members know their place in it.
pub struct Ranks {
    bits: Bits,
    /// Per word: members before it.
    before: Vec<u32>,
}

impl Ranks {
    /// How many members are smaller than this one.
    #[inline]
    pub fn of(&self, number: u32) -> u32 {
        let at = (number - self.bits.first) as usize;
        let below = self.bits.words[at / 64] & ((1 << (at % 64)) - 1);
        self.before[at / 64] + below.count_ones()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_are_places_in_the_sorted_list() {
        let numbers = [100, 101, 163, 164, 165, 227, 228, 400];
        let mut bits = Bits::over(100, 400);
        numbers.iter().rev().for_each(|&number| bits.insert(number));
        assert!(bits.contains(163) && !bits.contains(162));
        assert_eq!(bits.numbers(), numbers);
        let ranks = bits.ranked();
        for (rank, &number) in numbers.iter().enumerate() {
            assert_eq!(ranks.of(number), rank as u32);
        }
    }
}
