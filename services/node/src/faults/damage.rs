//! Bytes that another program's bug could have left behind: everything but the header.

use interfaces::{Header, Message};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// What code seldom reckons with.
const DOUBLES: [f64; 6] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, f64::MIN_POSITIVE / 4.0];

/// The same where a message has single precision.
const SINGLES: [f32; 6] =
    [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, f32::MIN_POSITIVE / 4.0];

/// Overwrites part of what follows the header, as `seed` says.
pub(super) fn overwrite<T: Message>(sample: &mut T, seed: u64) {
    let payload = &mut bytemuck::bytes_of_mut(sample)[size_of::<Header>()..];
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    match random.next_u32() % 4 {
        0 => flip(payload, &mut random),
        1 => replace(payload, &mut random, &SINGLES.map(f32::to_ne_bytes)),
        _ => replace(payload, &mut random, &DOUBLES.map(f64::to_ne_bytes)),
    }
}

/// One, three or five bits: an odd number cannot undo itself.
fn flip(payload: &mut [u8], random: &mut ChaCha8Rng) {
    for _ in 0..[1, 3, 5][below(random, 3)] {
        let bit = below(random, 8);
        let byte = below(random, payload.len());
        if let Some(byte) = payload.get_mut(byte) {
            *byte ^= 1 << bit;
        }
    }
}

/// Some words in a row, one or two or four and so on up to all: few of a scan's beams say little,
/// and many are seldom drawn where each number is as likely as another.
fn replace<const N: usize>(payload: &mut [u8], random: &mut ChaCha8Rng, words: &[[u8; N]]) {
    // A header takes whole words, so what follows it begins with one.
    let slots = payload.len() / N;
    let length = slots.min(1 << below(random, 13));
    let first = below(random, slots - length + 1);
    for slot in payload.chunks_exact_mut(N).skip(first).take(length) {
        if let Some(word) = words.get(below(random, words.len())) {
            slot.copy_from_slice(word);
        }
    }
}

/// Anything less than `limit`; zero where there is nothing less.
fn below(random: &mut ChaCha8Rng, limit: usize) -> usize {
    random
        .next_u64()
        .checked_rem(limit as u64)
        .and_then(|rest| usize::try_from(rest).ok())
        .unwrap_or(0)
}

const _: () = assert!(size_of::<Header>().is_multiple_of(size_of::<f64>()));
