//! From the scan to the wheels: how old the data is that moves the robot.

use std::collections::VecDeque;
use std::time::Duration;

use interfaces::{NodeStatus, Stamp};

/// Over which the histogram is told.
const WINDOW: Duration = Duration::from_secs(10);

/// Between two counts that are kept.
const STEP: Duration = Duration::from_millis(500);

/// How a step's name begins in the figures of whoever drives the wheels, and the last one's.
const UP_TO: &str = "scan_to_command_up_to_";
const OVER: &str = "scan_to_command_over_";

/// Commands by the age of the scan that they were computed from.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ages {
    /// [us] Up to which a command counts for each step but the last.
    bounds: Vec<f64>,
    /// [-] Commands by step, since the node's start, and when it said so.
    counts: VecDeque<(Stamp, Vec<f64>)>,
}

impl Ages {
    pub(super) fn hear(&mut self, now: Stamp, status: &NodeStatus) {
        let steps = status.values().iter().filter_map(|value| {
            let key = value.key.as_str();
            let bound = key.strip_prefix(UP_TO)?.strip_suffix("_us")?.parse::<f64>().ok()?;
            Some((bound, value.value))
        });
        let (bounds, mut counts): (Vec<f64>, Vec<f64>) = steps.unzip();
        if bounds.is_empty() {
            return;
        }
        let over = status.values().iter().find(|value| value.key.as_str().starts_with(OVER));
        counts.push(over.map_or(0.0, |value| value.value));
        let is_less = |former: &Vec<f64>| counts.iter().sum::<f64>() < former.iter().sum::<f64>();
        if self.bounds != bounds || self.counts.back().is_some_and(|(_, former)| is_less(former)) {
            // Another node, or another life of it.
            self.counts.clear();
            self.bounds = bounds;
        }
        // The newest always; of the older ones a few.
        let last_but_one = self.counts.iter().rev().nth(1).map(|(at, _)| *at);
        let newest = self.counts.back().map(|(at, _)| *at);
        if let (Some(before), Some(newest)) = (last_but_one, newest)
            && newest.since(before) < STEP
        {
            self.counts.pop_back();
        }
        self.counts.push_back((now, counts));
        while 2 < self.counts.len() && WINDOW < now.since(self.counts[0].0) {
            self.counts.pop_front();
        }
    }

    /// [us] Each step's bound, none for the last, and [-] the commands that fell into it lately.
    pub(crate) fn steps(&self) -> Vec<(Option<f64>, f64)> {
        let (Some((_, first)), Some((_, last))) = (self.counts.front(), self.counts.back()) else {
            return Vec::new();
        };
        let is_alone = self.counts.len() == 1;
        let bounds = self.bounds.iter().map(|bound| Some(*bound)).chain([None]);
        let counts = last.iter().zip(first);
        let counts = counts.map(|(last, first)| if is_alone { *last } else { last - first });
        bounds.zip(counts).collect()
    }
}

#[cfg(test)]
mod tests {
    use interfaces::{Text, Value};

    use super::*;

    fn status(counts: [f64; 3]) -> NodeStatus {
        let mut status = NodeStatus { value_count: 3, ..NodeStatus::default() };
        let keys = ["up_to_100_us", "up_to_200_us", "over_200_us"];
        for (slot, (key, value)) in status.value.iter_mut().zip(keys.iter().zip(counts)) {
            *slot = Value { key: Text::new(&format!("scan_to_command_{key}")), value };
        }
        status
    }

    fn second(number: u64) -> Stamp {
        Stamp::from_nanoseconds(number * 1_000_000_000)
    }

    #[test]
    fn what_counts_is_what_came_lately() {
        let mut ages = Ages::default();
        ages.hear(second(0), &status([100.0, 0.0, 0.0]));
        assert_eq!(ages.steps()[0], (Some(100.0), 100.0));
        for number in 1..=30 {
            ages.hear(second(number), &status([100.0, number as f64, 7.0]));
        }

        assert_eq!(ages.steps(), [(Some(100.0), 0.0), (Some(200.0), 10.0), (None, 0.0)]);
    }

    #[test]
    fn a_node_that_begins_anew_is_counted_anew() {
        let mut ages = Ages::default();
        ages.hear(second(0), &status([100.0, 0.0, 0.0]));
        ages.hear(second(1), &status([2.0, 1.0, 0.0]));

        assert_eq!(ages.steps()[..2], [(Some(100.0), 2.0), (Some(200.0), 1.0)]);
    }
}
