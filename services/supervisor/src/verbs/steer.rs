//! `teseo restart`, `stop` and `start`: one node of a running robot.

use std::time::Duration;

use node::control::{Connection, Failure, Heard, Request, told};
use node::{Namespace, clock};
use serde_json::Value;

use super::follow::{Feed, Layout};
use node::say::say;

/// Where a node is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Goal {
    /// Down and up again.
    Restarted,
    /// Down.
    Stopped,
    /// Up.
    Started,
}

/// Asks for it, tells what happens, and returns when it is there.
pub(super) fn steer(
    namespace: &Namespace,
    node: &str,
    goal: Goal,
    wait: Duration,
) -> Result<u8, Failure> {
    let until = clock::now().after(wait);
    let mut connection = Connection::open(namespace, &goal.request(node))?;
    let mut layout = Layout::new(Feed::Events);
    let answer = loop {
        match connection.hear(Some(until))? {
            Heard::Line(line) => {
                let answer = told(&line)?;
                let Some(event) = answer.get(Feed::Events.key()) else { break answer };
                layout.make_room([event]);
                say(&layout.line(event))?;
            }
            Heard::End => return Err(connection.gone()),
            Heard::Nothing => {
                let help = "see `teseo status`";
                return Err(Failure::TooLong(format!(
                    "{node} is not {} after {wait:?}; {help}",
                    goal.label()
                )));
            }
        }
    };
    let silent = answer["silent"].as_str();
    let silent = silent.map(|topic| format!(", but sends nothing on {topic}")).unwrap_or_default();
    say(&format!("{node} is {}{silent}", goal.label()))?;
    // Who was taken down by name, or with another, is started by name.
    for node in answer["down"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        say(&format!("{node} stays finalized: teseo start {node}"))?;
    }
    Ok(0)
}

impl Goal {
    fn request(self, node: &str) -> Request {
        let node = node.to_owned();
        match self {
            Self::Restarted => Request::Restart { node },
            Self::Stopped => Request::Stop { node },
            Self::Started => Request::Start { node },
        }
    }

    const fn label(self) -> &'static str {
        match self {
            Self::Restarted => "active again",
            Self::Stopped => "finalized",
            Self::Started => "active",
        }
    }
}
