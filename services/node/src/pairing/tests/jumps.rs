//! Stamps that jump, as a false clock or a false driver makes them jump.

use std::time::Duration;

use interfaces::Stamp;

use super::super::{Bounds, Config, Entry, Pairing, Policy};
use super::streams::{MILLISECOND, Random};

const PERIOD: u64 = 50 * MILLISECOND;
const HOUR: u64 = 3_600_000 * MILLISECOND;
const DELAY: Duration = Duration::from_millis(20);

/// [-] Of each topic, before and after the jump.
const SAMPLES: u64 = 30;

const NEAREST: Config = Config {
    policy: Policy::Nearest,
    topics: 2,
    queue_size: 10,
    slop: Duration::from_millis(20),
    bounds: Bounds::Limited { max_age: Duration::from_millis(500), max_delay: DELAY },
};

const CONFIGS: [Config; 4] = [
    NEAREST,
    Config { policy: Policy::ADAPTIVE, ..NEAREST },
    Config { slop: Duration::from_secs(10), ..NEAREST },
    Config { slop: Duration::from_secs(10), policy: Policy::ADAPTIVE, ..NEAREST },
];

/// What a stamp becomes.
#[derive(Debug, Clone, Copy)]
enum Jump {
    Ahead,
    Back,
    /// By a nanosecond, from the stamp before.
    BackByOne,
    /// The stamp before.
    Equal,
    Zero,
    /// The last moment that a stamp may show.
    End,
    /// One that it may not.
    BeyondEnd,
    /// Another for each sample.
    Any,
}

const JUMPS: [Jump; 8] = [
    Jump::Ahead,
    Jump::Back,
    Jump::BackByOne,
    Jump::Equal,
    Jump::Zero,
    Jump::End,
    Jump::BeyondEnd,
    Jump::Any,
];

impl Jump {
    fn of(self, stamp: u64, before: u64, random: &mut Random) -> u64 {
        match self {
            Self::Ahead => stamp + HOUR,
            Self::Back => stamp - HOUR,
            Self::BackByOne => before - 1,
            Self::Equal => before,
            Self::Zero => 0,
            Self::End => i64::MAX.cast_unsigned(),
            Self::BeyondEnd => u64::MAX,
            Self::Any => random.below(u64::MAX),
        }
    }
}

/// One sample on its way in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Arrival {
    received: u64,
    topic: usize,
    sequence: u64,
    stamp: u64,
}

/// Two topics, some of whose samples have jumped; sorted by receive time.
fn arrivals(random: &mut Random, jump: Jump, topics: &[usize], jumped: u64) -> Vec<Arrival> {
    let mut arrivals = Vec::new();
    for topic in [0, 1] {
        let (offset, latency) = (random.below(MILLISECOND * 5), random.below(PERIOD));
        let mut before = 0;
        for sequence in 0..2 * SAMPLES + jumped {
            let time = 2 * HOUR + offset + sequence * PERIOD + random.below(MILLISECOND);
            let is_false = topics.contains(&topic) && is_false(sequence, jumped);
            let stamp = if is_false { jump.of(time, before, random) } else { time };
            before = stamp.clamp(1, u64::MAX - HOUR);
            arrivals.push(Arrival { received: time + latency, topic, sequence, stamp });
        }
    }
    arrivals.sort_unstable();
    arrivals
}

fn is_false(sequence: u64, jumped: u64) -> bool {
    (SAMPLES..SAMPLES + jumped).contains(&sequence)
}

fn entry(arrival: &Arrival) -> Entry {
    Entry {
        stamp: Stamp::from_nanoseconds(arrival.stamp),
        sequence: arrival.sequence,
        epoch: 1,
        received: Stamp::from_nanoseconds(arrival.received),
    }
}

/// Receive time and sequence numbers of every pair.
fn pairs_of(config: &Config, arrivals: &[Arrival]) -> Vec<(u64, [u64; 2])> {
    let mut pairing = Pairing::new(config).unwrap();
    let mut pairs = Vec::new();
    for arrival in arrivals {
        while let Some(due) =
            pairing.next_deadline().filter(|due| due.nanoseconds <= arrival.received)
        {
            let outcome = pairing.poll(due);
            let found = outcome.pairs().map(|pair| [0, 1].map(|it| pair.members[it].sequence));
            pairs.extend(found.map(|sequences| (due.nanoseconds, sequences)));
        }
        let outcome = pairing.push(arrival.topic, entry(arrival));
        let found = outcome.pairs().map(|pair| [0, 1].map(|it| pair.members[it].sequence));
        pairs.extend(found.map(|sequences| (arrival.received, sequences)));
        for topic in [0, 1] {
            assert!(pairing.books(topic).close());
        }
    }
    pairs
}

#[test]
fn two_periods_after_stamps_are_sane_again_they_pair() {
    for seed in 0..200 {
        let mut random = Random::new(seed);
        for (config, jump) in CONFIGS.iter().flat_map(|config| JUMPS.map(|jump| (config, jump))) {
            let topics = random.choose::<&[usize]>(&[&[0], &[1], &[0, 1]]);
            let jumped = 1 + random.below(15);
            let arrivals = arrivals(&mut random, jump, topics, jumped);
            let case = format!("SEED={seed}, {config:?}, {jump:?} of {topics:?}, {jumped} times");

            // From then on everything that comes is sane.
            let last = SAMPLES + jumped;
            let sane = arrivals.iter().filter(|it| it.sequence == last).map(|it| it.received);
            let sane = sane.max().unwrap();
            let delay = u64::try_from(DELAY.as_nanos()).unwrap();
            let end = arrivals.last().unwrap().received - PERIOD;
            let pairs = pairs_of(config, &arrivals);
            let mut silent_since = sane;
            for &(at, sequences) in &pairs {
                if sane <= at && sequences.iter().all(|&it| !is_false(it, jumped)) {
                    let silence = at - silent_since;
                    assert!(silence <= 2 * PERIOD + delay, "{case}: silent for {silence} ns");
                    silent_since = at;
                }
            }
            assert!(end <= silent_since + 2 * PERIOD + delay, "{case}: silent at the end");
        }
    }
}

#[test]
fn a_clock_that_is_set_ahead_costs_at_most_two_periods() {
    for seed in 0..500 {
        let mut random = Random::new(seed);
        for config in &CONFIGS {
            let mut arrivals = arrivals(&mut random, Jump::Ahead, &[], 0);
            let set_at = 2 * HOUR + SAMPLES * PERIOD + random.below(PERIOD);
            for arrival in &mut arrivals {
                arrival.stamp += if set_at <= arrival.stamp { HOUR } else { 0 };
            }
            let pairs = pairs_of(config, &arrivals);
            let silence = pairs.windows(2).map(|pairs| pairs[1].0 - pairs[0].0).max().unwrap();
            assert!(silence <= 3 * PERIOD, "SEED={seed}, {config:?}: silent for {silence} ns");
        }
    }
}

#[test]
fn whatever_the_stamps_the_books_close_and_no_pair_is_wider_than_the_slop() {
    let mut pairs = 0;
    for seed in 0..2_000 {
        let mut random = Random::new(seed);
        let config = random.choose(&CONFIGS);
        let mut pairing = Pairing::new(&config).unwrap();
        let (mut now, mut stamp) = (2 * HOUR, 0);
        for sequence in 0..100 {
            now += random.below(PERIOD);
            let jump = random.choose(&JUMPS);
            let is_false = random.chance(30);
            stamp = if is_false { jump.of(now, stamp.max(1), &mut random) } else { now };
            // A receive time is our own, but nothing may hang on that either.
            let received = if random.chance(1) { random.below(u64::MAX) } else { now };
            let topic = usize::from(random.chance(50));
            let arrival = Arrival { received, topic, sequence, stamp };
            for pair in pairing.push(topic, entry(&arrival)).pairs() {
                pairs += 1;
                assert!(pair.spread() < config.slop, "SEED={seed}: {pair:?}");
            }
            if let Some(due) = pairing.next_deadline() {
                pairing.poll(due);
            }
            for topic in [0, 1] {
                assert!(pairing.books(topic).close(), "SEED={seed}");
            }
        }
    }
    assert!(10_000 < pairs, "only {pairs} pairs");
}
