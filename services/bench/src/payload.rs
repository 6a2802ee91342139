//! What is sent: written in full, read in full, and what was read is compared with what was written.

use std::mem::offset_of;

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;
use interfaces::{Header, LaserScan, Message};

/// A sample whose every word can be written and read.
pub(crate) trait Words: Message + 'static {
    fn words(&self) -> &[u32];
    fn words_mut(&mut self) -> &mut [u32];
}

macro_rules! payload {
    ($name:ident, $type_name:literal, $bytes:literal) => {
        #[doc = concat!($bytes, " bytes with the header.")]
        #[derive(Debug, Clone, Copy, Pod, Zeroable, ZeroCopySend)]
        #[type_name($type_name)]
        #[repr(C)]
        pub(crate) struct $name {
            header: Header,
            /// [-] Anything.
            words: [u32; ($bytes - size_of::<Header>()) / 4],
        }

        const _: () = assert!(size_of::<$name>() == $bytes);

        impl Default for $name {
            fn default() -> Self {
                Self::zeroed()
            }
        }

        impl Message for $name {
            fn header(&self) -> &Header {
                &self.header
            }

            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }

        impl Words for $name {
            fn words(&self) -> &[u32] {
                &self.words
            }

            fn words_mut(&mut self) -> &mut [u32] {
                &mut self.words
            }
        }
    };
}

payload!(Line, "bench/Line/1", 64);
payload!(Small, "bench/Small/1", 1024);
payload!(Medium, "bench/Medium/1", 65_536);
payload!(Large, "bench/Large/1", 1_048_576);

/// [byte] What a scan of [`BEAMS`] beams without intensities takes, or one of half as many with them.
pub(crate) const SCAN: usize = offset_of!(LaserScan, range) + 4 * BEAMS;

/// [-] Two thirds of what fit.
const BEAMS: usize = 960;

/// Of the message, which has room for more beams, what such a scan says.
impl Words for LaserScan {
    fn words(&self) -> &[u32] {
        &bytemuck::cast_slice(bytemuck::bytes_of(self))[size_of::<Header>() / 4..SCAN / 4]
    }

    fn words_mut(&mut self) -> &mut [u32] {
        &mut bytemuck::cast_slice_mut(bytemuck::bytes_of_mut(self))
            [size_of::<Header>() / 4..SCAN / 4]
    }
}

/// The sum of `words`: what no optimiser can leave out, since it is compared with [`expected`].
pub(crate) fn sum(words: &[u32]) -> u32 {
    words.iter().fold(0, |sum, &word| sum.wrapping_add(word))
}

/// What [`sum`] finds in `words` that are all `number`, in its low bits.
pub(crate) fn expected(words: usize, number: u64) -> u32 {
    #[expect(clippy::cast_possible_truncation, reason = "the low bits, as the sum has them")]
    (words as u32).wrapping_mul(word(number))
}

/// What every word of sample `number` is.
pub(crate) const fn word(number: u64) -> u32 {
    #[expect(clippy::cast_possible_truncation, reason = "the low bits tell neighbours apart")]
    let word = number as u32;
    word
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_that_is_missing_shows_in_the_sum() {
        let mut scan = LaserScan::default();
        scan.words_mut().fill(word(7));
        assert_eq!(sum(scan.words()), expected(scan.words().len(), 7));
        scan.words_mut()[100] = 6;
        assert_ne!(sum(scan.words()), expected(scan.words().len(), 7));
    }
}
