//! Seeded streams: rates, jitter, drops, reorder, ties, jumps, bursts.

use std::time::Duration;

use interfaces::Stamp;

use super::super::{Bounds, Config, Entry, Policy};

pub(super) const MILLISECOND: u64 = 1_000_000;

/// Splitmix64: small, and the same everywhere.
#[derive(Debug, Clone)]
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Anything less than `limit`, which is not zero.
    pub(super) fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (bits ^ (bits >> 31)) % limit
    }

    pub(super) fn chance(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }

    pub(super) fn choose<T: Copy>(&mut self, among: &[T]) -> T {
        among[usize::try_from(self.below(among.len() as u64)).unwrap()]
    }
}

/// One sample on its way in.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arrival {
    pub(super) topic: usize,
    pub(super) entry: Entry,
}

/// What may happen to a stream.
#[derive(Debug, Clone, Copy)]
pub(super) enum Trouble {
    /// Jitter, drops, ties, bursts and latency, but every topic in order.
    InOrder,
    /// The same, and samples that overtake each other, and clocks that step back.
    Any,
}

/// Two or three seconds of `topics` topics, sorted by receive time.
pub(super) fn stream(random: &mut Random, topics: usize, trouble: Trouble) -> Vec<Arrival> {
    let duration = (2_000 + random.below(1_000)) * MILLISECOND;
    let any = matches!(trouble, Trouble::Any);
    let (jump_at, jump) = if any && random.chance(30) {
        (random.below(duration), random.below(5_000) * MILLISECOND)
    } else {
        (u64::MAX, 0)
    };
    let mut arrivals = Vec::new();
    for topic in 0..topics {
        let mut entries = one_topic(random, duration, any);
        for entry in &mut entries {
            if jump_at < entry.received.nanoseconds {
                entry.stamp.nanoseconds -= jump;
            }
        }
        arrivals.extend(entries.into_iter().map(|entry| Arrival { topic, entry }));
    }
    arrivals.sort_by_key(|arrival| arrival.entry.received);
    arrivals
}

fn one_topic(random: &mut Random, duration: u64, any: bool) -> Vec<Entry> {
    let period = random.choose(&[5, 10, 20, 25, 50, 50, 50, 70]) * MILLISECOND;
    let offset = random.below(period);
    let jitter = 1 + random.choose(&[0, 0, period / 10, period / 2]);
    let dropped = random.choose(&[0, 0, 20, 50]);
    let latency = random.choose(&[0, MILLISECOND, 30 * MILLISECOND, 120 * MILLISECOND]);
    let overtaking = if any { random.choose(&[1, 1, 3 * period]) } else { 1 };
    // Ties within a topic and across topics.
    let grid = random.choose(&[1, 1, 1, 10 * MILLISECOND, 40 * MILLISECOND]);
    // Many samples at one receive time.
    let burst = random.choose(&[1, 1, 1, 100 * MILLISECOND]);

    let start = 10_000 * MILLISECOND;
    let mut stamps = Vec::new();
    let mut received = Vec::new();
    for number in 0..duration / period {
        if random.chance(dropped) {
            continue;
        }
        let time = offset + number * period;
        stamps.push((start + time + random.below(jitter)) / grid * grid);
        let arrival = time + latency + random.below(jitter) + random.below(overtaking);
        received.push(arrival.next_multiple_of(burst));
    }
    if !any {
        stamps.sort_unstable();
        received.sort_unstable();
    }
    let entries = stamps.into_iter().zip(received).enumerate();
    entries
        .map(|(sequence, (stamp, received))| Entry {
            stamp: Stamp::from_nanoseconds(stamp),
            sequence: sequence as u64,
            epoch: 1,
            received: Stamp::from_nanoseconds(received),
        })
        .collect()
}

/// Any sensible configuration.
pub(super) fn config(random: &mut Random, topics: usize) -> Config {
    let adaptive = Policy::Adaptive {
        age_penalty: random.choose(&[0.0, 0.1, 0.1, 0.3, 1.0]),
        period_min: [Duration::ZERO; _],
    };
    let max_age = Duration::from_millis(random.choose(&[60, 150, 400, 2_000]));
    let max_delay = Duration::from_millis(random.choose(&[0, 5, 20, 60]));
    Config {
        policy: random.choose(&[Policy::Nearest, adaptive]),
        topics,
        queue_size: random.choose(&[1, 2, 3, 5, 10, 40]),
        slop: Duration::from_millis(random.choose(&[2, 10, 30, 50, 150])),
        bounds: random.choose(&[Bounds::Unlimited, Bounds::Limited { max_age, max_delay }]),
    }
}
