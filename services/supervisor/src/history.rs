//! What has happened to the robot, as people and programs are told it.

use std::collections::VecDeque;
use std::path::Path;
use std::time::SystemTime;

use interfaces::Stamp;
use node::Error;
use serde_json::{Map, Value, json};

use crate::machine::{Kill, Told};

/// [-] A day of ordinary life, and a few hours of a bad one; about half a megabyte.
const LENGTH_MAX: usize = 2_000;

/// What kind of event a node's word about itself is.
pub(crate) const SAYS: &str = "says";

/// One thing that has happened.
#[derive(Debug, Clone)]
pub(crate) struct Happening {
    pub(crate) node: Option<usize>,
    pub(crate) text: String,
    json: Value,
}

impl Happening {
    /// As the control socket tells it.
    pub(crate) fn line(&self) -> Value {
        json!({ "event": self.json })
    }
}

/// The newest of what has happened.
#[derive(Debug)]
pub(crate) struct History {
    names: Vec<String>,
    happenings: VecDeque<Happening>,
}

impl History {
    pub(crate) fn new(names: Vec<String>) -> Self {
        Self { names, happenings: VecDeque::new() }
    }

    /// Writes them to `path`, one JSON object a line.
    pub(crate) fn write(&self, path: &Path) -> node::Result {
        let lines: Vec<_> =
            self.happenings.iter().map(|happening| happening.json.to_string()).collect();
        std::fs::write(path, lines.join("\n") + "\n")
            .map_err(|cause| Error::File { path: path.to_owned(), cause })
    }

    /// Takes in what people are told; `cause` is why a node failed, with all that is known.
    pub(crate) fn add(&mut self, told: &Told, at: Stamp, wall: SystemTime) -> &Happening {
        let mut details = Map::new();
        self.details(told, &mut details);
        self.push(Self::subject(told), self.sentence(told), details, at, wall)
    }

    /// Takes in a change of the robot's permission to move.
    pub(crate) fn add_motion(
        &mut self,
        text: String,
        details: Value,
        at: Stamp,
        wall: SystemTime,
    ) -> &Happening {
        let details = Map::from_iter([("motion".to_owned(), details)]);
        self.push(("motion", None, None), text, details, at, wall)
    }

    /// Takes in that a node's parameter was changed, or was not.
    pub(crate) fn add_parameter(
        &mut self,
        node: usize,
        epoch: u32,
        text: String,
        details: Value,
        at: Stamp,
        wall: SystemTime,
    ) -> &Happening {
        let details = Map::from_iter([("parameter".to_owned(), details)]);
        self.push(("parameter", Some(node), Some(epoch)), text, details, at, wall)
    }

    /// Takes in what a node says of itself. What it said before is forgotten where that had the same
    /// letters, and nothing else has happened since: one who tells in figures how far it has come
    /// would leave room for nothing else.
    pub(crate) fn add_words(
        &mut self,
        node: usize,
        epoch: u32,
        text: &str,
        at: Stamp,
        wall: SystemTime,
    ) -> &Happening {
        let letters = |text: &str| text.chars().filter(|c| c.is_alphabetic()).collect::<String>();
        let is_more = |last: &Happening| {
            last.node == Some(node)
                && last.json["kind"] == SAYS
                && letters(&last.text) == letters(text)
        };
        if self.happenings.back().is_some_and(is_more) {
            self.happenings.pop_back();
        }
        let subject = (SAYS, Some(node), Some(epoch));
        self.push(subject, text.to_owned(), Map::new(), at, wall)
    }

    fn push(
        &mut self,
        (kind, node, epoch): (&'static str, Option<usize>, Option<u32>),
        text: String,
        details: Map<String, Value>,
        at: Stamp,
        wall: SystemTime,
    ) -> &Happening {
        let mut json = Map::new();
        json.insert("monotonic_s".into(), json!(at.seconds()));
        json.insert("wall".into(), json!(humantime::format_rfc3339_millis(wall).to_string()));
        json.insert("node".into(), json!(node.map(|node| &self.names[node])));
        json.insert("epoch".into(), json!(epoch));
        json.insert("kind".into(), json!(kind));
        json.insert("text".into(), json!(text));
        json.extend(details);
        if self.happenings.len() == LENGTH_MAX {
            self.happenings.pop_front();
        }
        self.happenings.push_back(Happening { node, text, json: Value::Object(json) });
        self.happenings.back().unwrap_or_else(|| unreachable!("it was pushed"))
    }

    /// All that is known of one node, or of all.
    pub(crate) fn of(&self, node: Option<usize>) -> impl Iterator<Item = &Happening> {
        self.happenings.iter().filter(move |happening| node.is_none() || happening.node == node)
    }

    fn name(&self, node: usize) -> &str {
        &self.names[node]
    }

    fn names(&self, nodes: &[usize]) -> String {
        let names: Vec<_> = nodes.iter().map(|&node| self.name(node)).collect();
        names.join(", ")
    }

    fn subject(told: &Told) -> (&'static str, Option<usize>, Option<u32>) {
        match *told {
            Told::Spawned { node, epoch } => ("spawned", Some(node), Some(epoch)),
            Told::Changed { node, epoch, .. } => ("changed", Some(node), Some(epoch)),
            Told::Failed { node, epoch, .. } => ("failed", Some(node), Some(epoch)),
            Told::Restarting { node, .. } => ("restarting", Some(node), None),
            Told::TakingDown { because, .. } => ("taking-down", Some(because), None),
            Told::Flowing { node } => ("flowing", Some(node), None),
            Told::Stalled { node, .. } => ("stalled", Some(node), None),
            Told::Signalled { node, .. } => ("signalled", Some(node), None),
            Told::Ended { node, .. } => ("ended", Some(node), None),
            Told::Ready { .. } => ("ready", None, None),
            Told::GoingDown { .. } => ("going-down", None, None),
            Told::Refused { .. } => ("refused", None, None),
        }
    }

    fn sentence(&self, told: &Told) -> String {
        match told {
            Told::Spawned { epoch, .. } => format!("started (epoch {epoch})"),
            Told::Changed { start, goal, reason, .. } if reason.is_empty() => {
                format!("{start} -> {goal}")
            }
            Told::Changed { start, goal, reason, .. } => format!("{start} -> {goal}: {reason}"),
            Told::Failed { epoch, cause, age, .. } => {
                let age = age.as_secs_f64();
                format!("failed: {cause} (epoch {epoch}, up {age:.1} s)")
            }
            Told::Restarting { delay, count, burst, .. } => {
                let delay = delay.as_secs_f64();
                format!("starts again in {delay:.2} s ({count} of {burst})")
            }
            Told::TakingDown { nodes, because } => {
                let others: Vec<_> = nodes.iter().copied().filter(|node| node != because).collect();
                if others.is_empty() {
                    "is taken down".to_owned()
                } else {
                    format!("takes down {} with it", self.names(&others))
                }
            }
            Told::Flowing { .. } => "its topics carry data again".to_owned(),
            Told::Stalled { topic, .. } => format!("is active, but sends nothing on {topic}"),
            Told::Signalled { signal: Kill::Term, .. } => {
                "did not end when asked to: SIGTERM".to_owned()
            }
            Told::Signalled { signal: Kill::Kill, .. } => "killed by the supervisor".to_owned(),
            Told::Ended { what, .. } => format!("{what}, as it may"),
            Told::Ready { after } => format!("READY in {:.0} ms", after.as_secs_f64() * 1e3),
            Told::GoingDown { cause } => format!("going down: {cause}"),
            Told::Refused { why, .. } => format!("refused: {why}"),
        }
    }

    /// What programs want to know beside the sentence.
    fn details(&self, told: &Told, json: &mut Map<String, Value>) {
        let mut add = |key: &str, value: Value| drop(json.insert(key.to_owned(), value));
        match told {
            Told::Changed { start, goal, reason, .. } => {
                add("start", json!(start.label()));
                add("goal", json!(goal.label()));
                add("reason", json!(reason));
            }
            Told::Failed { cause, age, .. } => {
                add("cause", json!(cause.to_string()));
                add("age_s", json!(age.as_secs_f64()));
            }
            Told::Restarting { delay, count, burst, .. } => {
                add("delay_s", json!(delay.as_secs_f64()));
                add("count", json!(count));
                add("burst", json!(burst));
            }
            Told::TakingDown { nodes, because } => {
                let nodes: Vec<_> = nodes.iter().map(|&node| self.name(node)).collect();
                add("nodes", json!(nodes));
                add("because", json!(self.name(*because)));
            }
            Told::Stalled { topic, .. } => add("topic", json!(topic)),
            Told::Ready { after } => add("after_s", json!(after.as_secs_f64())),
            Told::GoingDown { cause } => add("cause", json!(cause)),
            Told::Spawned { .. }
            | Told::Flowing { .. }
            | Told::Signalled { .. }
            | Told::Ended { .. }
            | Told::Refused { .. } => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_who_says_how_far_it_has_come_leaves_room_for_what_has_happened() {
        let mut history = History::new(vec!["bridge".to_owned(), "odometry".to_owned()]);
        let (at, wall) = (Stamp::ZERO, SystemTime::UNIX_EPOCH);
        history.add(&Told::Flowing { node: 0 }, at, wall);
        for node in [0, 1] {
            for done in 0..2 * LENGTH_MAX {
                history.add_words(node, 1, &format!("{done} done"), at, wall);
            }
        }
        history.add(&Told::Flowing { node: 1 }, at, wall);
        history.add_words(1, 1, "all done", at, wall);

        let texts: Vec<_> = history.of(None).map(|happening| happening.text.as_str()).collect();
        let flows = "its topics carry data again";
        assert_eq!(texts, [flows, "3999 done", "3999 done", flows, "all done"]);
    }

    #[test]
    fn what_a_node_said_in_other_words_stays() {
        let mut history = History::new(vec!["multiplexer".to_owned()]);
        let words = ["autonomy drives", "teleop drives", "autonomy drives"];
        for text in words {
            history.add_words(0, 1, text, Stamp::ZERO, SystemTime::UNIX_EPOCH);
        }

        let texts: Vec<_> = history.of(None).map(|happening| happening.text.as_str()).collect();
        assert_eq!(texts, words);
    }
}
