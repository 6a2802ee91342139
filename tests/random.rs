//! What tests draw, each from its seed, and what they are told to draw.

use std::ops::Range;
use std::time::Duration;

/// `SplitMix64`: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014. One number
/// is its whole state, and neighbouring seeds have nothing in common.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    pub(crate) fn below(&mut self, limit: usize) -> usize {
        usize::try_from(self.next() % limit.max(1) as u64).unwrap()
    }

    pub(crate) fn duration(&mut self, max: Duration) -> Duration {
        max.mul_f64(self.next() as f64 / u64::MAX as f64)
    }

    /// Whether what happens with this probability does.
    pub(crate) fn happens(&mut self, probability: f64) -> bool {
        self.within(0.0..1.0) < probability
    }

    pub(crate) fn within(&mut self, range: Range<f64>) -> f64 {
        // Of 53 bits, which an f64 has: never 1.
        let share = (self.next() >> 11) as f64 / (1_u64 << 53) as f64;
        range.start + share * (range.end - range.start)
    }

    pub(crate) fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }
}

/// What the environment says, such as `SEED`.
pub(crate) fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}
