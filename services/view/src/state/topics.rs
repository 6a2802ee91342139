//! How a topic flows: rate, age, jitter, loss.

use std::collections::BTreeMap;
use std::time::Duration;

use interfaces::{Header, Stamp};
use node::observe::Statistics;

use super::NodeRow;

/// Over which rate and jitter are told.
const WINDOW: Duration = Duration::from_secs(4);

/// A topic that was silent for longer, and for some of its periods, has no rate.
const SILENCE: Duration = Duration::from_secs(1);

/// [-] What "some periods" are.
const PERIODS: f64 = 5.0;

/// How one topic flows by the stamps of its samples, so that it does not matter when they are looked
/// at.
#[derive(Debug, Clone)]
pub(crate) struct Pace {
    statistics: Statistics,
    newest: Stamp,
}

impl Default for Pace {
    fn default() -> Self {
        Self { statistics: Statistics::new(0, WINDOW), newest: Stamp::ZERO }
    }
}

impl Pace {
    pub(crate) fn hear(&mut self, header: &Header) {
        self.statistics.add(header, header.stamp);
        self.newest = header.stamp;
    }

    pub(crate) fn forget(&mut self, now: Stamp) {
        self.statistics.forget(now);
    }

    /// [Hz] Of the samples sent, whether they were seen or not.
    pub(crate) fn rate(&self, now: Stamp) -> Option<f64> {
        let silence = self.age(now);
        let rate = self.statistics.rate_by_stamp();
        match rate {
            Some(rate) if silence < SILENCE || silence.as_secs_f64() * rate < PERIODS => Some(rate),
            None if silence < SILENCE => None,
            Some(_) | None => Some(0.0),
        }
    }

    /// Since the newest sample's data was true.
    pub(crate) fn age(&self, now: Stamp) -> Duration {
        now.since(self.newest)
    }

    /// The standard deviation of the time between two neighbours' stamps.
    pub(crate) fn jitter(&self) -> Option<Duration> {
        let period = self.statistics.period()?;
        Duration::try_from_secs_f64(period.deviation).ok()
    }
}

/// One topic, as the screen shows it.
#[derive(Debug, Default)]
pub(crate) struct TopicRow {
    pub(crate) name: String,
    pub(crate) publisher: String,
    pub(crate) rate: Option<f64>,
    pub(crate) age: Option<Duration>,
    pub(crate) jitter: Option<Duration>,
    pub(crate) sent: u64,
    /// [-] By the robot's own readers, all together.
    pub(crate) lost: u64,
    pub(crate) unread: u64,
    pub(crate) stale: u64,
    pub(crate) readers: Vec<String>,
}

/// What nodes say about their ports, and what was seen of the topics.
pub(super) fn rows(nodes: &[NodeRow], paces: &BTreeMap<String, Pace>, now: Stamp) -> Vec<TopicRow> {
    let mut rows: BTreeMap<&str, TopicRow> = BTreeMap::new();
    for (node, port) in
        nodes.iter().flat_map(|node| node.ports.iter().map(move |port| (node, port)))
    {
        let row = rows.entry(port.topic.as_str()).or_default();
        if port.publishes == 1 {
            row.publisher.clone_from(&node.name);
            row.sent = port.samples;
            let rate = node.rates.iter().find(|(topic, _)| topic == port.topic.as_str());
            row.rate = rate.map(|(_, rate)| *rate);
        } else {
            row.readers.push(node.name.clone());
            row.lost += port.lost;
            row.unread += port.unread;
            row.stale += port.stale;
        }
    }
    for (topic, pace) in paces {
        let row = rows.entry(topic).or_default();
        row.rate = pace.rate(now).or(row.rate);
        row.age = Some(pace.age(now));
        row.jitter = pace.jitter();
    }
    let named = rows.into_iter().map(|(name, row)| TopicRow { name: name.to_owned(), ..row });
    named.filter(|row| !row.publisher.is_empty() || row.rate.is_some()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(milliseconds: u64) -> Stamp {
        Stamp::from_nanoseconds(milliseconds * 1_000_000)
    }

    fn header(sequence: u64, stamp: Stamp) -> Header {
        Header { sequence, stamp, epoch: 1, ..Header::default() }
    }

    #[test]
    fn one_who_sees_every_fiftieth_sample_knows_the_rate() {
        let mut pace = Pace::default();
        for look in 0..20 {
            pace.hear(&header(50 * look, ms(50 * look)));
        }

        assert!((pace.rate(ms(960)).unwrap() - 1000.0).abs() < 1e-6);
        assert_eq!(pace.jitter(), None, "no two were neighbours");
        assert_eq!(pace.age(ms(960)), Duration::from_millis(10));
    }

    #[test]
    fn a_topic_that_is_silent_has_no_rate_at_once_and_later() {
        let mut pace = Pace::default();
        for number in 0..20 {
            pace.hear(&header(number, ms(50 * number)));
        }
        assert!((pace.rate(ms(1_500)).unwrap() - 20.0).abs() < 1e-6);
        for later in [2_500, 60_000] {
            pace.forget(ms(later));
            assert!(pace.rate(ms(later)).unwrap() < 1e-9);
        }
    }

    #[test]
    fn jitter_is_how_unevenly_neighbours_are_apart() {
        let mut pace = Pace::default();
        for (number, at) in (0..).zip([0, 10, 30, 40, 60]) {
            pace.hear(&header(number, ms(at)));
        }

        assert_eq!(pace.jitter().unwrap().as_micros(), 5_000);
    }
}
