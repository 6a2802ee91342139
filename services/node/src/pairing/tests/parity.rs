//! ROS 2's own results, case by case.

use std::time::Duration;

use serde::Deserialize;

use super::super::Bounds;
use super::super::offline::{Algorithm, Options, Replay, Stream, replay};

const NEAREST: [&str; 2] = [
    include_str!("../../../../../tests/data/pairing/approximate_time_public.jsonl"),
    include_str!("../../../../../tests/data/pairing/approximate_time_3topic_public.jsonl"),
];

const ADAPTIVE: [&str; 2] = [
    include_str!("../../../../../tests/data/pairing/approximate_time_adaptive_public.jsonl"),
    include_str!("../../../../../tests/data/pairing/approximate_time_adaptive_3topic_public.jsonl"),
];

/// Both algorithms, up to four topics, and ties and rate bounds that the others do not have.
const BOTH: &str = include_str!("../../../../../tests/data/pairing/two_to_four_topics.jsonl");

/// Bounds that no vector reaches.
const HUGE: Bounds =
    Bounds::Limited { max_age: Duration::from_secs(60), max_delay: Duration::from_secs(60) };

/// What ROS 2 made of a stream.
#[derive(Debug, Deserialize)]
struct Expected {
    id: String,
    matches: Vec<Vec<u64>>,
    match_events: Vec<Vec<usize>>,
    match_at: Vec<usize>,
    /// Only for `nearest`.
    leftover: Option<Vec<Vec<u64>>>,
    /// Only for `nearest`.
    slop_ns: Option<u64>,
}

impl Expected {
    #[track_caller]
    fn assert_is(&self, replay: &Replay) {
        let id = &self.id;
        assert_eq!(replay.matches, self.matches, "{id}");
        assert_eq!(replay.match_events, self.match_events, "{id}");
        assert_eq!(replay.match_at, self.match_at, "{id}");
        if let Some(leftover) = &self.leftover {
            assert_eq!(&replay.leftover, leftover, "{id}");
        }
    }
}

fn cases<const N: usize>(files: [&'static str; N]) -> impl Iterator<Item = (Stream, Expected)> {
    let lines = files.into_iter().flat_map(str::lines);
    lines.map(|line| (Stream::parse(line).unwrap(), serde_json::from_str(line).unwrap()))
}

#[test]
fn nearest_does_what_ros_2_does_in_python() {
    let mut count = 0;
    for (stream, expected) in cases(NEAREST) {
        assert_eq!(stream.algorithm(), Algorithm::Nearest);
        assert!(expected.leftover.is_some());
        expected.assert_is(&replay(&stream, &Options::default()).unwrap());
        count += 1;
    }
    assert_eq!(count, 130);
}

#[test]
fn adaptive_does_what_ros_2_does_in_cpp() {
    let mut count = 0;
    for (stream, expected) in cases(ADAPTIVE) {
        assert_eq!(stream.algorithm(), Algorithm::Adaptive);
        expected.assert_is(&replay(&stream, &Options::default()).unwrap());
        count += 1;
    }
    assert_eq!(count, 130);
}

#[test]
fn four_topics_and_ties_are_as_in_ros_2() {
    let mut count = 0;
    for (stream, expected) in cases([BOTH]) {
        assert_eq!(stream.algorithm() == Algorithm::Nearest, expected.leftover.is_some());
        expected.assert_is(&replay(&stream, &Options::default()).unwrap());
        count += 1;
    }
    assert_eq!(count, 77);
}

#[test]
fn a_slop_in_seconds_is_cut_off_as_python_does() {
    for (mut stream, expected) in cases(NEAREST) {
        stream.slop_ns = None;
        let replay = replay(&stream, &Options::default()).unwrap();
        assert_eq!(Some(replay.slop_ns), expected.slop_ns, "{}", expected.id);
    }
}

#[test]
fn limits_that_nothing_reaches_change_nothing() {
    let mut count = 0;
    for (stream, expected) in cases(NEAREST).chain(cases(ADAPTIVE)) {
        let options = Options { bounds: HUGE, ..Options::default() };
        // What ROS 2 runs without a slop is refused.
        let Ok(replay) = replay(&stream, &options) else { continue };
        if is_in_order(&stream) {
            assert_eq!(replay.resets, 0);
            expected.assert_is(&replay);
            count += 1;
        }
    }
    assert!(100 < count, "only {count} cases compared");
}

fn is_in_order(stream: &Stream) -> bool {
    stream.topics.iter().all(|topic| {
        let events = stream.events.iter().filter(|event| event.topic == *topic);
        events.map(|event| event.stamp_ns).is_sorted()
    })
}
