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
    /// Whether it may be silent.
    on_event: bool,
    samples: u64,
    /// When it was last seen to carry more than before.
    moved: Stamp,
    counted: (Stamp, u64),
    /// [Hz] Unknown for the first second.
    rate: Option<f64>,
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
        let dry = self.topics.iter().find(|topic| topic.is_dry());
        let stalled = self.topics.iter().find(|topic| topic.is_stalled(now));
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
        self.overdue(now).filter(|_| self.told == Told::Stalled)
    }

    /// A topic that carries nothing, and should have for longer than its slowest publisher takes.
    pub(crate) fn overdue(&self, now: Stamp) -> Option<&str> {
        let stalled = self.topics.iter().find(|topic| topic.is_stalled(now));
        stalled.map(|topic| topic.name.as_str())
    }

    /// [Hz] Each topic and how often it carries a sample, where that is known yet.
    pub(crate) fn rates(&self) -> impl Iterator<Item = (&str, Option<f64>)> {
        self.topics.iter().map(|topic| (topic.name.as_str(), topic.rate))
    }

    fn count(&mut self, status: &NodeStatus, now: Stamp) {
        let is_published = |port: &&PortStatus| port.publishes == 1;
        for port in status.ports().iter().filter(is_published) {
            let name = port.topic.as_str();
            match self.topics.iter_mut().find(|topic| topic.name == name) {
                Some(topic) => topic.count(port.samples, status.header.stamp, now),
                None => self.topics.push(TopicFlow {
                    name: name.to_owned(),
                    on_event: port.on_event == 1,
                    samples: port.samples,
                    moved: now,
                    counted: (status.header.stamp, port.samples),
                    rate: None,
                }),
            }
        }
    }
}

impl TopicFlow {
    const fn is_dry(&self) -> bool {
        !self.on_event && self.samples == 0
    }

    fn is_stalled(&self, now: Stamp) -> bool {
        !self.on_event && STALL < now.since(self.moved)
    }

    /// `told` is when the node said so: a status is sent in a turn, and a turn comes with a sample, so
    /// that the rate of a steady topic is exact.
    fn count(&mut self, samples: u64, told: Stamp, now: Stamp) {
        if self.samples < samples {
            self.samples = samples;
            self.moved = now;
        }
        let elapsed = told.since(self.counted.0);
        if RATE_WINDOW <= elapsed {
            let more = samples.saturating_sub(self.counted.1);
            self.rate = Some(more as f64 / elapsed.as_secs_f64());
            self.counted = (told, samples);
        }
    }
}

#[cfg(test)]
mod tests {
    use interfaces::Text;

    use super::*;

    /// An active node that has sent so many samples on the one topic, none on the other.
    fn status(samples: u64, on_event: u8) -> NodeStatus {
        let port = |name: &str, samples, on_event| PortStatus {
            topic: Text::new(name),
            publishes: 1,
            on_event,
            samples,
            ..PortStatus::default()
        };
        let mut status = NodeStatus { state: State::Active as u8, ..NodeStatus::default() };
        status.port[0] = port("odom", samples, 0);
        status.port[1] = port("alarm", 0, on_event);
        status.port_count = 2;
        status
    }

    #[test]
    fn what_is_published_steadily_is_waited_for_and_missed() {
        let mut flow = Flow::default();
        let at = |seconds| Stamp::ZERO.after(Duration::from_secs(seconds));

        assert_eq!(flow.turn(&status(0, 1), at(1)), None);
        assert_eq!(flow.turn(&status(1, 1), at(2)), Some(News::Flows));
        assert_eq!(flow.turn(&status(2, 1), at(3)), None);
        let stalled = News::Stalled { topic: "odom".to_owned() };
        assert_eq!(flow.turn(&status(2, 1), at(5)), Some(stalled));
        assert_eq!(flow.stalled(at(5)), Some("odom"));
    }

    #[test]
    fn what_is_published_on_events_is_neither_waited_for_nor_missed() {
        let mut flow = Flow::default();
        let at = |seconds| Stamp::ZERO.after(Duration::from_secs(seconds));
        assert_eq!(flow.turn(&status(1, 0), at(1)), None, "the other topic is waited for");

        let mut flow = Flow::default();
        let news: Vec<_> =
            (1..10).filter_map(|second| flow.turn(&status(second, 1), at(second))).collect();
        assert_eq!(news, [News::Flows]);
        assert_eq!(flow.stalled(at(9)), None);
    }
}
