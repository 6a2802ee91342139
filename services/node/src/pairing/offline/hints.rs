//! What usually is the matter when topics do not pair.

use std::time::Duration;

use super::{Replay, Stream};

/// What looks wrong with `stream`, in sentences.
pub(super) fn hints(stream: &Stream, replay: &Replay) -> Vec<String> {
    let mut hints = Vec::new();
    for topic in &stream.topics {
        hints.extend(stuck(topic, &stamps(stream, topic)));
        hints.extend(step_back(stream, topic, replay));
    }
    for (number, one) in stream.topics.iter().enumerate() {
        for other in &stream.topics[number + 1..] {
            hints.extend(apart(stream, one, other, replay.slop_ns));
        }
    }
    hints.extend(overflow(replay));
    hints
}

/// [ns] A topic's stamps, in order of arrival.
fn stamps(stream: &Stream, topic: &str) -> Vec<i64> {
    let events = stream.events.iter().filter(|event| event.topic == topic);
    events.map(|event| event.stamp_ns).collect()
}

fn stuck(topic: &str, stamps: &[i64]) -> Option<String> {
    match stamps {
        [] => Some(format!("nothing arrived on {topic}")),
        [first, others @ ..] if !others.is_empty() && others.iter().all(|it| it == first) => {
            let count = stamps.len();
            Some(format!("all {count} stamps of {topic} are {first}: is its header filled in?"))
        }
        _ => None,
    }
}

fn step_back(stream: &Stream, topic: &str, replay: &Replay) -> Option<String> {
    let mut newest = i64::MIN;
    let mut steps = Vec::new();
    for (index, event) in stream.events.iter().enumerate().filter(|(_, it)| it.topic == topic) {
        if event.stamp_ns < newest {
            steps.push((newest.abs_diff(event.stamp_ns), index));
        }
        newest = newest.max(event.stamp_ns);
    }
    let (greatest, index) = steps.into_iter().max()?;
    let step = Duration::from_nanos(greatest);
    (replay.slop_ns < greatest && replay.resets == 0).then(|| {
        format!(
            "{topic} steps back by {step:?} at event {index}: ROS 2 does not start afresh, and may \
             pair nothing until the stamps have caught up"
        )
    })
}

fn apart(stream: &Stream, one: &str, other: &str, slop: u64) -> Option<String> {
    let mut others = stamps(stream, other);
    others.sort_unstable();
    let nearest = |stamp: i64| {
        let after = others.partition_point(|&it| it < stamp);
        let neighbours = others[after.saturating_sub(1)..].iter().take(2);
        neighbours.map(|it| it.abs_diff(stamp)).min()
    };
    let distance = stamps(stream, one).into_iter().filter_map(nearest).min()?;
    (slop <= distance).then(|| {
        let (distance, slop) = (Duration::from_nanos(distance), Duration::from_nanos(slop));
        format!(
            "{one} and {other} are never less than {distance:?} apart, and the slop is {slop:?}: \
             pairs must be less than the slop apart"
        )
    })
}

fn overflow(replay: &Replay) -> Option<String> {
    let lost = replay.dropped.iter().filter(|loss| loss.reason == "overflow").count();
    (0 < lost).then(|| {
        format!(
            "{lost} samples left a full queue of {} while a partner might still have come: one \
             topic lags behind by more than the queue holds, or is silent",
            replay.queue_size
        )
    })
}
