//! All that a publisher has sent, as one number: two runs that sent the same have the same.

use xxhash_rust::xxh3::Xxh3;

/// [byte] What is zero as a whole is passed over: most of a scan of few beams.
const BLOCK: usize = 512;

/// XXH3 of every sample, in order.
///
/// Of a sample it takes each stretch of blocks that are not all zero, with its place and its length, so
/// that what is passed over is told too.
#[derive(Default)]
pub(crate) struct Digest(Xxh3);

impl Digest {
    /// Takes one more sample.
    pub(crate) fn update(&mut self, sample: &[u8]) {
        let mut rest = sample;
        while !rest.is_empty() {
            let zero = stretch(rest, |block| block == &[0; BLOCK][..block.len()]);
            rest = &rest[zero..];
            let said = stretch(rest, |block| block != &[0; BLOCK][..block.len()]);
            self.0.update(bytemuck::bytes_of(&[sample.len() - rest.len(), said]));
            self.0.update(&rest[..said]);
            rest = &rest[said..];
        }
    }

    /// [-] Of what it was given so far.
    pub(crate) fn value(&self) -> u64 {
        self.0.digest()
    }
}

/// [byte] How long the blocks at the beginning are of which this is true.
fn stretch(bytes: &[u8], is_so: impl Fn(&[u8]) -> bool) -> usize {
    let blocks = bytes.chunks(BLOCK).take_while(|block| is_so(block));
    blocks.map(<[u8]>::len).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digest(samples: &[&[u8]]) -> u64 {
        let mut digest = Digest::default();
        for sample in samples {
            digest.update(sample);
        }
        digest.value()
    }

    // Breaks, as it should, where the place of a stretch is not told.
    #[test]
    fn a_byte_that_differs_anywhere_shows_and_so_does_its_place() {
        let length = 5 * BLOCK + 40;
        let with = |at: usize| {
            let mut sample = vec![0; length];
            sample[3] = 1;
            sample[at] = 7;
            sample
        };
        let mut digests: Vec<_> = (0..length).map(|at| digest(&[&with(at)])).collect();
        digests.push(digest(&[&vec![0; length]]));
        digests.sort_unstable();
        digests.dedup();
        assert_eq!(digests.len(), length + 1);
    }

    #[test]
    fn samples_have_an_order_and_an_end() {
        let (one, other) = (vec![1; 2 * BLOCK], vec![2; BLOCK]);
        let all = digest(&[&one, &other]);
        assert_eq!(digest(&[&one, &other]), all);
        assert_ne!(digest(&[&other, &one]), all);
        assert_ne!(digest(&[&[one, other].concat()]), all);
        assert_ne!(digest(&[&[0; BLOCK], &[0; BLOCK]]), digest(&[&[0; BLOCK]]));
    }
}
