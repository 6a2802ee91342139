//! `teseo logs` and `teseo events`: what has been written and what has happened, and what will be.

use std::collections::BTreeMap;

use node::control::{Connection, Failure, Heard, Request, told};
use node::{Namespace, signal};
use serde_json::Value;

use node::say::{say, shown, time_of_day};

/// [character] Of a node's name, before a longer one has been seen.
const NAME_MIN: usize = 10;

/// Which of the two.
#[derive(Debug, Clone, Copy)]
pub(super) enum Feed {
    Logs,
    Events,
}

impl Feed {
    pub(super) fn show(
        self,
        namespace: &Namespace,
        request: &Request,
        follow: bool,
        json: bool,
    ) -> Result<u8, Failure> {
        if follow {
            signal::listen();
        }
        let mut connection = Connection::open(namespace, request)?;
        let mut layout = Layout::new(self);
        if follow {
            return self.follow(&mut connection, &mut layout, json);
        }
        // All of it first: a pager that waits must not hold up what the supervisor has to tell.
        let lines = all(&mut connection)?;
        let values = lines.iter().map(|line| told(line)).collect::<Result<Vec<_>, _>>()?;
        layout.make_room(values.iter().map(|value| &value[self.key()]));
        let text: String = if json {
            lines.iter().flat_map(|line| [line, "\n"]).collect()
        } else {
            values.iter().map(|value| layout.line(&value[self.key()])).collect()
        };
        if text.is_empty() {
            node::say::mention("nothing so far");
        } else {
            say(&text)?;
        }
        Ok(0)
    }

    fn follow(
        self,
        connection: &mut Connection,
        layout: &mut Layout,
        json: bool,
    ) -> Result<u8, Failure> {
        while let Heard::Line(line) = connection.hear(None)? {
            let value = told(&line)?;
            layout.make_room([&value[self.key()]]);
            say(&if json { line } else { layout.line(&value[self.key()]) })?;
        }
        Err(connection.gone())
    }

    /// What its lines are called on the control socket.
    pub(super) const fn key(self) -> &'static str {
        match self {
            Self::Logs => "log",
            Self::Events => "event",
        }
    }
}

/// Every line of an answer that ends.
pub(super) fn all(connection: &mut Connection) -> Result<Vec<String>, Failure> {
    let mut lines = Vec::new();
    while let Some(line) = connection.next_in_time()? {
        lines.push(line);
    }
    Ok(lines)
}

/// How lines stand under one another.
#[derive(Debug)]
pub(super) struct Layout {
    feed: Feed,
    width: usize,
    /// The life in which each node wrote its last line.
    epochs: BTreeMap<String, u64>,
}

impl Layout {
    pub(super) const fn new(feed: Feed) -> Self {
        Self { feed, width: NAME_MIN, epochs: BTreeMap::new() }
    }

    /// From now on the names have a column at least as wide as those of `items`.
    pub(super) fn make_room<'a>(&mut self, items: impl IntoIterator<Item = &'a Value>) {
        let widths = items.into_iter().map(|item| name(item).chars().count());
        self.width = widths.fold(self.width, usize::max);
    }

    /// What is to be printed for one item: a line, and one before it where another life begins.
    pub(super) fn line(&mut self, item: &Value) -> String {
        let (time, name, width) = (shown(time_of_day(item)), shown(name(item)), self.width);
        let text = shown(item["text"].as_str().unwrap_or_default());
        match self.feed {
            Feed::Events => format!("{time} {name:<width$} {text}\n"),
            Feed::Logs => {
                let line = format!("{time} {name:<width$}| {text}\n");
                let Some(epoch) = item["epoch"].as_u64() else { return line };
                match self.epochs.insert(name.clone(), epoch) {
                    Some(last) if last != epoch => {
                        format!("{time} {name:<width$}| -- epoch {epoch} --\n{line}")
                    }
                    Some(_) | None => line,
                }
            }
        }
    }
}

/// What has happened to no node has happened to the robot.
fn name(item: &Value) -> &str {
    item["node"].as_str().unwrap_or("robot")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn log(node: &str, epoch: u64, text: &str) -> Value {
        json!({ "wall": "2026-11-25T12:01:07.412Z", "node": node, "epoch": epoch, "text": text })
    }

    #[test]
    fn logs_read_like_this_and_another_life_is_announced() {
        let mut layout = Layout::new(Feed::Logs);
        let items = [
            log("odometry", 1, "one"),
            log("controller", 4, "two"),
            log("odometry", 1, "three"),
            log("odometry", 2, "four"),
        ];
        layout.make_room(&items);
        let text: String = items.iter().map(|item| layout.line(item)).collect();

        assert_eq!(
            text,
            "\
12:01:07.412 odometry  | one
12:01:07.412 controller| two
12:01:07.412 odometry  | three
12:01:07.412 odometry  | -- epoch 2 --
12:01:07.412 odometry  | four
"
        );
    }

    #[test]
    fn events_read_like_this_and_those_of_no_node_are_the_robot_s() {
        let mut layout = Layout::new(Feed::Events);
        let mut ready = log("", 1, "READY in 31 ms");
        ready["node"] = Value::Null;
        let items = [ready, log("collision_monitor", 1, "started (epoch 1)")];
        layout.make_room(&items);
        let text: String = items.iter().map(|item| layout.line(item)).collect();

        assert_eq!(
            text,
            "\
12:01:07.412 robot             READY in 31 ms
12:01:07.412 collision_monitor started (epoch 1)
"
        );
    }

    #[test]
    fn what_a_node_has_written_is_one_line_and_steers_no_terminal() {
        let line = Layout::new(Feed::Logs).line(&log("x\x1b[2J", 1, "a\nb\rc\x07"));

        assert_eq!(line.matches('\n').count(), 1);
        assert!(!line.trim_end_matches('\n').contains(char::is_control), "{line:?}");
    }
}
