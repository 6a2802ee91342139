//! Whether a node's topics carry data, by the counters that it reports.

use std::time::Duration;

use interfaces::{NodeStatus, PortStatus, Stamp, State};

use crate::machine::News;

/// An active node whose topic has carried nothing for so long has stalled: a few of the slowest
/// sensor's periods (5 Hz).
const STALL: Duration = Duration::from_secs(1);

/// [-] Two reports at 10 Hz are too few to tell a rate by.
const RATE_WINDOW: Duration = Duration::from_secs(1);

/// What is known of a node's topics in this life.
#[derive(Debug, Default)]
pub(crate) struct Flow {
    topics: Vec<TopicFlow>,
    told: Told,
}

/// One topic that the node publishes.
#[derive(Debug)]
struct TopicFlow {
    name: String,
    samples: u64,
    /// When it was last seen to carry more than before.
    moved: Stamp,
    counted: (Stamp, u64),
    rate: f64,
}

#[derive(Debug, Default, PartialEq, Eq)]
enum Told {
    #[default]
    Nothing,
    Flows,
    Stalled,
}

impl Flow {
    /// Looks at the newest status; returns what has changed about the flow.
    pub(crate) fn turn(&mut self, status: &NodeStatus, now: Stamp) -> Option<News> {
        if status.state != State::Active as u8 {
            // What pauses does not stall; what is resumed flows as it did.
            self.topics.iter_mut().for_each(|topic| topic.moved = now);
            return None;
        }
        self.count(status, now);
        let dry = self.topics.iter().find(|topic| topic.samples == 0);
        let stalled = self.topics.iter().find(|topic| STALL < now.since(topic.moved));
        match self.told {
            Told::Nothing if dry.is_none() => {
                self.told = Told::Flows;
                Some(News::Flows)
            }
            Told::Flows => stalled.map(|topic| {
                self.told = Told::Stalled;
                News::Stalled { topic: topic.name.clone() }
            }),
            Told::Stalled if stalled.is_none() => {
                self.told = Told::Flows;
                Some(News::Flows)
            }
            Told::Nothing | Told::Stalled => None,
        }
    }

    /// The topic that has stalled, if one has.
    pub(crate) fn stalled(&self, now: Stamp) -> Option<&str> {
        let is_told = self.told == Told::Stalled;
        let mut topics = self.topics.iter().filter(|topic| STALL < now.since(topic.moved));
        topics.next().filter(|_| is_told).map(|topic| topic.name.as_str())
    }

    /// [Hz] Each topic and how often it carries a sample.
    pub(crate) fn rates(&self) -> impl Iterator<Item = (&str, f64)> {
        self.topics.iter().map(|topic| (topic.name.as_str(), topic.rate))
    }

    fn count(&mut self, status: &NodeStatus, now: Stamp) {
        let is_published = |port: &&PortStatus| port.publishes == 1;
        for port in status.ports().iter().filter(is_published) {
            let name = port.topic.as_str();
            match self.topics.iter_mut().find(|topic| topic.name == name) {
                Some(topic) => topic.count(port.samples, now),
                None => self.topics.push(TopicFlow {
                    name: name.to_owned(),
                    samples: port.samples,
                    moved: now,
                    counted: (now, port.samples),
                    rate: 0.0,
                }),
            }
        }
    }
}

impl TopicFlow {
    fn count(&mut self, samples: u64, now: Stamp) {
        if self.samples < samples {
            self.samples = samples;
            self.moved = now;
        }
        let elapsed = now.since(self.counted.0);
        if RATE_WINDOW <= elapsed {
            let more = samples.saturating_sub(self.counted.1);
            self.rate = more as f64 / elapsed.as_secs_f64();
            self.counted = (now, samples);
        }
    }
}
