//! What holds for every stream and every configuration.

use std::collections::BTreeSet;
use std::time::Duration;

use interfaces::Stamp;

use super::super::{Bounds, Config, Entry, Outcome, Pairing, Policy};
use super::streams::{Arrival, MILLISECOND, Random, Trouble, config, stream};

const SEEDS: std::ops::Range<u64> = 0..3_000;

/// Later than any stream.
const FAR: Stamp = Stamp::from_nanoseconds(1_000_000 * MILLISECOND);

/// Checks each outcome against all that came before.
#[derive(Debug)]
struct Auditor {
    config: Config,
    seed: u64,
    received: Vec<u64>,
    paired: Vec<u64>,
    dropped: Vec<u64>,
    /// Topic and sequence of those that are paired or dropped.
    gone: BTreeSet<(usize, u64)>,
    pairs: u64,
}

impl Auditor {
    fn new(config: Config, seed: u64) -> Self {
        let zeros = vec![0; config.topics];
        let (received, paired, dropped) = (zeros.clone(), zeros.clone(), zeros);
        Self { config, seed, received, paired, dropped, gone: BTreeSet::new(), pairs: 0 }
    }

    fn audit(&mut self, outcome: &Outcome<'_>, now: Stamp) {
        let seed = self.seed;
        for pair in outcome.pairs() {
            self.pairs += 1;
            assert_eq!(pair.members.len(), self.config.topics, "SEED={seed}");
            for (topic, member) in pair.members.iter().enumerate() {
                let fresh = self.gone.insert((topic, member.sequence));
                assert!(fresh, "SEED={seed}: {topic}/{member:?} is used twice");
                self.paired[topic] += 1;
            }
            let in_order = matches!(self.config.bounds, Bounds::Limited { .. });
            if in_order || self.config.policy == Policy::Nearest {
                assert!(pair.spread() < self.config.slop, "SEED={seed}: {pair:?}");
            }
            if let Bounds::Limited { max_age, .. } = self.config.bounds {
                let oldest = pair.members.iter().map(|member| member.received).min().unwrap();
                assert!(now.since(oldest) <= max_age, "SEED={seed}: {pair:?} at {now:?}");
            }
        }
        for dropped in outcome.dropped() {
            let fresh = self.gone.insert((dropped.topic, dropped.entry.sequence));
            assert!(fresh, "SEED={seed}: {dropped:?} is used twice");
            self.dropped[dropped.topic] += 1;
        }
    }

    fn compare(&self, pairing: &Pairing) {
        let seed = self.seed;
        for topic in 0..self.config.topics {
            let books = pairing.books(topic);
            assert!(books.close(), "SEED={seed}: {topic}: {books:?}");
            assert_eq!(books.received, self.received[topic], "SEED={seed}");
            assert_eq!(books.paired, self.paired[topic], "SEED={seed}");
            assert_eq!(books.dropped_total(), self.dropped[topic], "SEED={seed}");
            let mut queued = pairing.queue(topic).map(|entry| (topic, entry.sequence));
            assert!(queued.all(|sample| !self.gone.contains(&sample)), "SEED={seed}");
        }
    }
}

/// Topics, a configuration and a stream.
fn setting(seed: u64, trouble: Trouble) -> (Random, Config, Vec<Arrival>) {
    let mut random = Random::new(seed);
    let topics = random.choose(&[2, 2, 3, 4]);
    let config = config(&mut random, topics);
    let arrivals = stream(&mut random, topics, trouble);
    (random, config, arrivals)
}

#[test]
fn the_books_close_and_no_sample_is_used_twice() {
    let mut pairs = 0;
    for seed in SEEDS {
        let (mut random, config, arrivals) = setting(seed, Trouble::Any);
        let mut pairing = Pairing::new(&config).unwrap();
        let mut auditor = Auditor::new(config, seed);
        for Arrival { topic, entry } in arrivals {
            if random.chance(10) {
                let now = Stamp::from_nanoseconds(entry.received.nanoseconds.saturating_sub(1));
                auditor.audit(&pairing.poll(now), now);
            }
            if random.below(1_000) == 0 {
                auditor.audit(&pairing.reset(), entry.received);
            }
            auditor.received[topic] += 1;
            auditor.audit(&pairing.push(topic, entry), entry.received);
            auditor.compare(&pairing);
        }
        pairs += auditor.pairs;
    }
    assert!(10 * SEEDS.end < pairs, "only {pairs} pairs");
}

#[test]
fn nothing_waits_longer_than_the_greatest_age() {
    for seed in SEEDS {
        let (_, config, arrivals) = setting(seed, Trouble::Any);
        let Bounds::Limited { max_age, .. } = config.bounds else { continue };
        let mut pairing = Pairing::new(&config).unwrap();
        for Arrival { topic, entry } in arrivals {
            pairing.push(topic, entry);
            for topic in 0..config.topics {
                for waiting in pairing.queue(topic) {
                    let age = entry.received.since(waiting.received);
                    assert!(age <= max_age, "SEED={seed}: {waiting:?} is {age:?} old");
                }
            }
        }
    }
}

#[test]
fn no_pair_is_later_than_the_greatest_delay() {
    let mut forced = 0;
    for seed in SEEDS {
        let (mut random, config, arrivals) = setting(seed, Trouble::Any);
        let max_delay = Duration::from_millis(random.choose(&[0, 1, 10, 60]));
        let bounds = Bounds::Limited { max_age: Duration::from_millis(150), max_delay };
        let mut pairing = Pairing::new(&Config { bounds, ..config }).unwrap();
        let check = |outcome: &Outcome<'_>, now: Stamp| {
            for pair in outcome.pairs() {
                let delay = now.since(pair.completed());
                assert!(delay <= max_delay, "SEED={seed}: {pair:?} after {delay:?}");
            }
        };
        for Arrival { topic, entry } in arrivals {
            while let Some(due) = pairing.next_deadline().filter(|&due| due <= entry.received) {
                check(&pairing.poll(due), due);
            }
            check(&pairing.push(topic, entry), entry.received);
        }
        while let Some(due) = pairing.next_deadline() {
            check(&pairing.poll(due), due);
        }
        forced += pairing.forced();
    }
    assert!(SEEDS.end < forced, "only {forced} pairs were forced out");
}

#[test]
fn nearest_finds_what_an_exhaustive_search_finds() {
    let mut pairs = 0;
    for seed in SEEDS {
        let (_, mut config, arrivals) = setting(seed, Trouble::Any);
        (config.policy, config.bounds) = (Policy::Nearest, Bounds::Unlimited);
        let mut pairing = Pairing::new(&config).unwrap();
        let mut queues = vec![Vec::new(); config.topics];
        for Arrival { topic, entry } in arrivals {
            let expected = search_exhaustively(&mut queues, topic, entry, &config);
            let outcome = pairing.push(topic, entry);
            let found: Vec<Vec<Entry>> =
                outcome.pairs().map(|pair| pair.members.to_vec()).collect();
            assert_eq!(found, expected.into_iter().collect::<Vec<_>>(), "SEED={seed}");
            pairs += found.len();
        }
        for (topic, queue) in queues.iter().enumerate() {
            assert!(pairing.queue(topic).eq(queue), "SEED={seed}");
        }
    }
    assert!(10_000 < pairs, "only {pairs} pairs");
}

/// The algorithm as the reference tells it, without a thought to cost.
fn search_exhaustively(
    queues: &mut [Vec<Entry>],
    topic: usize,
    entry: Entry,
    config: &Config,
) -> Option<Vec<Entry>> {
    match queues[topic].iter_mut().find(|queued| queued.stamp == entry.stamp) {
        Some(same_stamp) => *same_stamp = entry,
        None => queues[topic].push(entry),
    }
    if config.queue_size < queues[topic].len() {
        let smallest = queues[topic].iter().map(|queued| queued.stamp).min()?;
        queues[topic].retain(|queued| queued.stamp != smallest);
    }
    let mut combinations = vec![Vec::new()];
    for (other, queue) in queues.iter().enumerate() {
        let mut candidates = if other == topic { vec![entry] } else { queue.clone() };
        candidates.sort_by_key(|it| it.stamp.nanoseconds.abs_diff(entry.stamp.nanoseconds));
        combinations = combinations
            .into_iter()
            .flat_map(|begun: Vec<Entry>| {
                candidates.iter().map(move |it| [begun.as_slice(), &[*it]].concat())
            })
            .filter(|begun| {
                let stamps = begun.iter().map(|it| it.stamp);
                stamps.clone().max().unwrap().since(stamps.min().unwrap()) < config.slop
            })
            .collect();
    }
    let mut still_queued = combinations
        .into_iter()
        .filter(|found| found.iter().zip(queues.iter()).all(|(it, queue)| queue.contains(it)));
    let found = still_queued.next()?;
    for (queue, member) in queues.iter_mut().zip(&found) {
        queue.retain(|queued| queued != member);
    }
    Some(found)
}

#[test]
fn adaptive_depends_on_stamps_and_not_on_the_order_of_arrival() {
    let mut pairs = 0;
    for seed in SEEDS {
        let (mut random, mut config, arrivals) = setting(seed, Trouble::InOrder);
        config.queue_size = arrivals.len() + 1;
        config.bounds = Bounds::Unlimited;
        if config.policy == Policy::Nearest {
            continue;
        }
        // What is last may be decided sooner or later. A far sample on each topic decides it.
        let end = |topic| Arrival { topic, entry: Entry { stamp: FAR, ..Entry::default() } };
        let ended = |arrivals| [arrivals, (0..config.topics).map(end).collect()].concat();
        let chance = shuffled(&mut random, &config, &arrivals);
        let by_time = pairs_of(&config, &ended(arrivals));
        let by_chance = pairs_of(&config, &ended(chance));
        assert_eq!(by_time, by_chance, "SEED={seed}");
        pairs += by_time.len();
    }
    assert!(10_000 < pairs, "only {pairs} pairs");
}

#[test]
fn adaptive_sets_never_cross() {
    for seed in SEEDS {
        let (_, mut config, arrivals) = setting(seed, Trouble::InOrder);
        if config.policy == Policy::Nearest {
            config.policy = Policy::ADAPTIVE;
        }
        let pairs = pairs_of(&config, &arrivals);
        for (earlier, later) in pairs.iter().zip(pairs.iter().skip(1)) {
            let in_order = earlier.iter().zip(later).all(|(earlier, later)| earlier < later);
            assert!(in_order, "SEED={seed}: {earlier:?} before {later:?}");
        }
    }
}

/// The sequence numbers of every pair.
fn pairs_of(config: &Config, arrivals: &[Arrival]) -> Vec<Vec<u64>> {
    let mut pairing = Pairing::new(config).unwrap();
    let mut pairs = Vec::new();
    for &Arrival { topic, entry } in arrivals {
        let outcome = pairing.push(topic, entry);
        let sequences = |members: &[Entry]| members.iter().map(|it| it.sequence).collect();
        pairs.extend(outcome.pairs().map(|pair| sequences(pair.members)));
    }
    pairs
}

/// The same samples, every topic in its order, the topics anyhow.
fn shuffled(random: &mut Random, config: &Config, arrivals: &[Arrival]) -> Vec<Arrival> {
    let of_topic = |topic| arrivals.iter().filter(move |arrival| arrival.topic == topic);
    let mut lanes: Vec<_> = (0..config.topics).map(|topic| of_topic(topic).peekable()).collect();
    let mut shuffled = Vec::new();
    let mut now = 0;
    while shuffled.len() < arrivals.len() {
        let lane = usize::try_from(random.below(config.topics as u64)).unwrap();
        for _ in 0..=random.below(4) {
            now += MILLISECOND;
            let received = Stamp::from_nanoseconds(now);
            shuffled.extend(lanes[lane].next().map(|&Arrival { topic, entry }| Arrival {
                topic,
                entry: Entry { received, ..entry },
            }));
        }
    }
    shuffled
}
