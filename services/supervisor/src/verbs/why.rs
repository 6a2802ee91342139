//! `teseo why`: what is known of one node, as a few sentences.

use node::control::{Connection, Failure, Request, told};
use node::{Namespace, clock};
use serde_json::Value;

use super::follow::{Feed, Layout, all};
use super::table::state;
use crate::history::SAYS;
use node::say::{say, shown, span, time_of_day};

/// [-] The last words of a life that failed.
const LINES: usize = 5;

/// [-] Among which they are looked for: all that the supervisor keeps of a node.
const LINES_MAX: usize = 1_000;

pub(super) fn why(namespace: &Namespace, name: &str) -> Result<u8, Failure> {
    let node = Some(name.to_owned());
    // First, because it is refused where there is no such node.
    let logs = Request::Logs { node, follow: false, lines: LINES_MAX };
    let logs = items(namespace, &logs, Feed::Logs)?;
    let status = Connection::open(namespace, &Request::Status)?.answer()?;
    // Of all nodes: what went down because another failed is told of that one.
    let events = Request::Events { node: None, follow: false };
    let events = items(namespace, &events, Feed::Events)?;
    let nodes = status["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    let node = nodes.iter().find(|node| node["name"] == name).unwrap_or(&Value::Null);
    say(&explain(node, &events, &logs, clock::now().seconds()))?;
    Ok(0)
}

fn items(namespace: &Namespace, request: &Request, feed: Feed) -> Result<Vec<Value>, Failure> {
    let lines = all(&mut Connection::open(namespace, request)?)?;
    lines.iter().map(|line| Ok(told(line)?[feed.key()].take())).collect()
}

/// All that is known; `now` is in seconds of the clock that stamped `events`.
fn explain(node: &Value, events: &[Value], logs: &[Value], now: f64) -> String {
    let name = node["name"].as_str().unwrap_or("?");
    let own = |event: &&Value| event["node"] == name;
    let failure = events.iter().rposition(|event| own(&event) && event["kind"] == "failed");
    let taken = events.iter().rposition(|event| is_taken_down(event, name));
    let mut sentences = vec![standing(name, node)];
    if let Some(topic) = node["stalled"].as_str() {
        sentences.push(format!("It is active, but sends nothing on {topic}."));
    }
    if let Some(says) = node["text"].as_str().filter(|says| !says.is_empty()) {
        sentences.push(format!("It says of itself: {says}"));
    }
    match (failure, &node["last_failure"]) {
        (Some(index), _) => sentences.push(failed(&events[index], now)),
        // The history is shorter than the node's memory.
        (None, Value::Object(last)) => {
            let ago = span(last["ago_s"].as_f64().unwrap_or_default());
            let what = last["what"].as_str().unwrap_or_default();
            sentences.push(format!("It last failed {ago} ago: {what}."));
        }
        (None, _) => sentences.push("It has not failed.".to_owned()),
    }
    if let Some(index) = taken.filter(|&index| failure.is_none_or(|failure| failure < index)) {
        sentences.push(taken_down(events, index, now));
    }
    // What it says of itself stands above.
    let happened = |event: &&Value| own(event) && event["kind"] != SAYS;
    if let Some(last) = events.iter().rfind(happened) {
        let (ago, text) = (since(last, now), last["text"].as_str().unwrap_or_default());
        sentences.push(format!("The last that happened to it, {ago} ago: {text}."));
    }
    let mut text: String =
        sentences.iter().flat_map(|sentence| [shown(sentence), "\n".to_owned()]).collect();
    if let Some(index) = failure {
        text.push_str(&last_words(&events[index], logs));
    }
    text
}

/// What it is, since when, and how often it was started again.
fn standing(name: &str, node: &Value) -> String {
    let epoch = node["epoch"].as_u64().unwrap_or_default();
    let up = node["uptime_s"].as_f64();
    let up = up.map_or(String::new(), |up| format!(", up {} (epoch {epoch})", span(up)));
    let pid = node["pid"].as_u64();
    let process = pid.map_or(String::new(), |pid| format!(", as process {pid}"));
    let again = match node["restarts"].as_u64() {
        None | Some(0) => String::new(),
        Some(1) => "; it was started again once".to_owned(),
        Some(count) => format!("; it was started again {count} times"),
    };
    let state = match (state(node), node["doing"].as_str()) {
        (again, _) if again.starts_with("starts ") => format!("finalized and {again}"),
        (state, Some("stopped")) => format!("{state}, until somebody starts it"),
        (state, Some("ended")) => format!("{state}: it ended by itself, as it may"),
        (state, _) => state,
    };
    format!("{name} is {state}{up}{process}{again}.")
}

fn failed(event: &Value, now: f64) -> String {
    let (ago, at) = (since(event, now), time_of_day(event));
    let (cause, epoch) = (event["cause"].as_str().unwrap_or_default(), &event["epoch"]);
    let age = event["age_s"].as_f64().unwrap_or_default();
    format!("It last failed {ago} ago, at {at} (epoch {epoch}, after {age:.1} s): {cause}.")
}

fn is_taken_down(event: &Value, name: &str) -> bool {
    let nodes = event["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    event["kind"] == "taking-down"
        && event["because"] != name
        && nodes.iter().any(|node| node == name)
}

/// That another is to blame, and why that one went down, where it had failed.
fn taken_down(events: &[Value], index: usize, now: f64) -> String {
    let because = &events[index]["because"];
    let (ago, other) = (since(&events[index], now), because.as_str().unwrap_or_default());
    let is_blamed = |event: &&Value| event["node"] == *because && event["kind"] == "failed";
    // Only what happened at the same time is the reason.
    let is_near = |event: &&Value| {
        let at = |event: &Value| event["monotonic_s"].as_f64().unwrap_or_default();
        at(&events[index]) - at(event) < 1.0
    };
    match events[..index].iter().rfind(is_blamed).filter(is_near) {
        Some(failure) => {
            let cause = failure["cause"].as_str().unwrap_or_default();
            format!("It went down {ago} ago because {other} failed: {cause}.")
        }
        None => format!("It went down {ago} ago together with {other}."),
    }
}

fn last_words(failure: &Value, logs: &[Value]) -> String {
    let of_that_life: Vec<_> =
        logs.iter().filter(|line| line["epoch"] == failure["epoch"]).collect();
    if of_that_life.is_empty() {
        return "It wrote nothing in the life that failed.\n".to_owned();
    }
    let mut text = "The last that it wrote in the life that failed:\n".to_owned();
    let mut layout = Layout::new(Feed::Logs);
    for line in of_that_life.iter().skip(of_that_life.len().saturating_sub(LINES)) {
        text.push_str("  ");
        text.push_str(&layout.line(line));
    }
    text
}

fn since(event: &Value, now: f64) -> String {
    span(now - event["monotonic_s"].as_f64().unwrap_or(now))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const WALL: &str = "2026-11-25T12:01:07.412Z";

    fn node() -> Value {
        json!({
            "name": "odometry", "state": "active", "doing": "running", "pid": 7, "epoch": 1,
            "uptime_s": 72.0, "restarts": 0, "stalled": null, "text": "", "last_failure": null,
        })
    }

    fn failure(node: &str, at: f64, epoch: u64) -> Value {
        json!({
            "monotonic_s": at, "wall": WALL, "node": node, "epoch": epoch, "kind": "failed",
            "text": "failed", "cause": "was killed by signal 9 (SIGKILL)", "age_s": 42.1,
        })
    }

    #[test]
    fn a_node_that_is_fine_is_said_to_be_fine_and_what_happened_last() {
        let event = json!({
            "monotonic_s": 28.0, "wall": WALL, "node": "odometry", "epoch": 1, "kind": "changed",
            "text": "inactive -> active",
        });

        assert_eq!(
            explain(&node(), &[event], &[], 100.0),
            "\
odometry is active, up 1m12s (epoch 1), as process 7.
It has not failed.
The last that happened to it, 1m12s ago: inactive -> active.
"
        );
    }

    #[test]
    fn a_failure_is_told_with_its_cause_and_the_last_words_of_that_life() {
        let mut again = node();
        (again["restarts"], again["epoch"]) = (json!(2), json!(3));
        let log = |epoch: u64, text: String| json!({ "wall": WALL, "node": "odometry", "epoch": epoch, "text": text });
        let mut logs: Vec<_> = (1..=9).map(|number| log(2, format!("word {number}"))).collect();
        logs.push(log(3, "of another life".to_owned()));
        let text = explain(&again, &[failure("odometry", 70.0, 2)], &logs, 100.0);

        assert!(text.starts_with("odometry is active, up 1m12s (epoch 3), as process 7; it was started again 2 times.\n"), "{text}");
        let failed = "It last failed 30s ago, at 12:01:07.412 (epoch 2, after 42.1 s): \
                      was killed by signal 9 (SIGKILL).\n";
        assert!(text.contains(failed), "{text}");
        assert!(text.contains("word 5\n") && text.contains("word 9\n"), "{text}");
        assert!(!text.contains("word 4") && !text.contains("another life"), "{text}");
    }

    #[test]
    fn a_node_that_went_down_with_another_blames_the_other() {
        let mut down = node();
        (down["state"], down["doing"]) = (json!("finalized"), json!("stopped"));
        (down["pid"], down["uptime_s"]) = (Value::Null, Value::Null);
        let taking = json!({
            "monotonic_s": 70.0, "wall": WALL, "node": "simulator", "kind": "taking-down",
            "text": "", "nodes": ["controller", "odometry"], "because": "simulator",
        });
        let failed = [failure("simulator", 69.9, 1), taking.clone()];
        let asked = [failure("simulator", 10.0, 1), taking];

        let because = "odometry is finalized, until somebody starts it.\nIt has not failed.\nIt went down 30s ago because \
                       simulator failed: was killed by signal 9 (SIGKILL).\n";
        assert_eq!(explain(&down, &failed, &[], 100.0), because);
        let with = "It went down 30s ago together with simulator.\n";
        assert!(explain(&down, &asked, &[], 100.0).ends_with(with));
    }
}
