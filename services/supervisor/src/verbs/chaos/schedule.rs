//! What goes wrong and when, decided by a seed alone.

use std::fmt;
use std::time::Duration;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The shortest and the longest that a node is stopped: from what nobody notices to what every
/// watchdog ends.
const STOP: (Duration, Duration) = (Duration::from_millis(20), Duration::from_millis(1_500));

/// What a topic can suffer, and the most of it that is mild: of probabilities, but for the delay, in
/// seconds.
const MILD: [(&str, f64); 5] = [
    ("loss", 0.03),
    ("delay_max_s", 0.02),
    ("duplicate", 0.03),
    ("reorder", 0.03),
    ("corrupt", 0.005),
];

/// [-] However strong: with more nothing is left to go wrong.
const FAULT_MAX: f64 = 0.5;

/// [-] The generator's streams: one choice more on one side changes nothing on the other.
const BLOWS: u64 = 0;
const FAULTS: u64 = 1;

/// What happens to a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    Kill,
    /// For so long.
    Stop(Duration),
}

impl fmt::Display for What {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kill => formatter.write_str("SIGKILL"),
            Self::Stop(duration) => write!(formatter, "SIGSTOP for {} ms", duration.as_millis()),
        }
    }
}

/// What happens when to whom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Blow {
    /// Since the robot was ready.
    pub(super) at: Duration,
    pub(super) node: String,
    pub(super) what: What,
}

/// How much goes wrong.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates {
    pub(super) kills_per_minute: f64,
    pub(super) stops_per_minute: f64,
}

/// As many blows as `rates` say, within `length`, each at any moment and to any of `nodes`.
pub(super) fn blows(seed: u64, length: Duration, rates: Rates, nodes: &[String]) -> Vec<Blow> {
    if nodes.is_empty() {
        return Vec::new();
    }
    let mut random = generator(seed, BLOWS);
    let (kills, stops) =
        (count(rates.kills_per_minute, length), count(rates.stops_per_minute, length));
    let blow = |number| {
        let at = length.mul_f64(share(&mut random));
        let node = nodes[below(&mut random, nodes.len())].clone();
        let span = STOP.1.saturating_sub(STOP.0).mul_f64(share(&mut random));
        let what = if number < kills { What::Kill } else { What::Stop(STOP.0 + span) };
        Blow { at, node, what }
    };
    let mut blows: Vec<_> = (0..kills + stops).map(blow).collect();
    blows.sort_by_key(|blow| blow.at);
    blows
}

/// Settings that let something go wrong on each of `topics`, a node and what it publishes; mild where
/// `strength` is 1.
pub(super) fn faults(seed: u64, strength: f64, topics: &[(String, String)]) -> Vec<String> {
    let mut random = generator(seed, FAULTS);
    let mut settings = Vec::new();
    for (node, topic) in topics {
        for (key, mild) in MILD {
            let value = (mild * strength * share(&mut random)).min(FAULT_MAX);
            if 0.0 < value {
                settings.push(format!("{node}.faults.{topic}.{key}={value:.4}"));
            }
        }
    }
    settings
}

fn generator(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(stream);
    random
}

fn count(per_minute: f64, length: Duration) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it saturates")]
    let count = (per_minute * length.as_secs_f64() / 60.0).round() as usize;
    count
}

/// [-] In `0..1`.
fn share(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) / (f64::from(u32::MAX) + 1.0)
}

fn below(random: &mut ChaCha8Rng, limit: usize) -> usize {
    usize::try_from(random.next_u32()).unwrap_or_default() % limit
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINUTE: Duration = Duration::from_secs(60);
    const RATES: Rates = Rates { kills_per_minute: 30.0, stops_per_minute: 20.0 };

    fn nodes() -> Vec<String> {
        ["simulator", "odometry", "controller"].map(str::to_owned).to_vec()
    }

    fn topics() -> Vec<(String, String)> {
        vec![("odometry".to_owned(), "odom".to_owned())]
    }

    #[test]
    fn a_seed_is_a_schedule() {
        let of = |seed| blows(seed, MINUTE, RATES, &nodes());

        assert_eq!(of(7), of(7));
        assert_ne!(of(7), of(8));
        assert_eq!(faults(7, 1.0, &topics()), faults(7, 1.0, &topics()));
        assert_ne!(faults(7, 1.0, &topics()), faults(8, 1.0, &topics()));
    }

    #[test]
    fn there_are_as_many_as_was_asked_for_in_order_and_everybody_has_a_share() {
        let blows = blows(1, MINUTE, RATES, &nodes());

        let kills = blows.iter().filter(|blow| blow.what == What::Kill).count();
        assert_eq!((kills, blows.len()), (30, 50));
        assert!(blows.is_sorted_by_key(|blow| blow.at));
        assert!(blows.iter().all(|blow| blow.at < MINUTE));
        for node in nodes() {
            assert!(5 < blows.iter().filter(|blow| blow.node == node).count(), "{blows:?}");
        }
    }

    #[test]
    fn faults_are_as_strong_as_was_asked_for() {
        let value = |setting: &String| setting.split_once('=').unwrap().1.parse::<f64>().unwrap();

        assert_eq!(faults(1, 0.0, &topics()), [""; 0]);
        for seed in 0..100 {
            let (mild, strong) = (faults(seed, 1.0, &topics()), faults(seed, 1e9, &topics()));
            assert!(mild.iter().all(|setting| value(setting) <= 0.03), "{mild:?}");
            assert!(strong.iter().all(|setting| value(setting) <= FAULT_MAX), "{strong:?}");
            assert!(mild[0].starts_with("odometry.faults.odom.loss="), "{mild:?}");
        }
    }

    #[test]
    fn where_there_is_nobody_nobody_is_struck() {
        assert_eq!(blows(1, MINUTE, RATES, &[]), []);
    }
}
