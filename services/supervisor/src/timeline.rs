//! One timeline of all processes, in the Trace Event Format that Perfetto and Chromium read: each
//! node's turns, and an arrow from whoever sent a sample to each who received it.
//!
//! Source of the format: Google, "Trace Event Format" (2016); flow events and `bp: "e"` are its
//! section "Flow Events".

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use node::{Error, Result};
use serde_json::{Value, json};

use crate::member::Member;

/// A sample: its topic, its sender's life, its number.
type Sample = (String, u32, u64);

/// One line of a node's part.
struct Happening {
    /// [ns] On `CLOCK_MONOTONIC`.
    at: u64,
    kind: String,
    sample: Sample,
}

/// What one life of a node did.
struct Part {
    name: String,
    happenings: Vec<Happening>,
}

/// Makes the timeline at `path` of what the lives of `members` have left, and removes that. A node that
/// was killed has left nothing.
pub(crate) fn join(path: &Path, members: &[Member]) -> Result {
    let failed = |cause| Error::File { path: path.to_owned(), cause };
    let mut parts = Vec::new();
    for member in members {
        for life in 1..=member.epoch {
            let file = node::trace::part(path, &member.name, life);
            let Ok(text) = fs::read_to_string(&file) else { continue };
            let name = if life == 1 {
                member.name.clone()
            } else {
                format!("{}, life {life}", member.name)
            };
            parts.push(Part { name, happenings: text.lines().filter_map(happening).collect() });
            fs::remove_file(&file).map_err(failed)?;
        }
    }
    fs::write(path, timeline(&parts).to_string()).map_err(failed)
}

fn happening(line: &str) -> Option<Happening> {
    let mut cells = line.split(',');
    let mut cell = || cells.next();
    let (at, kind, topic) = (cell()?.parse().ok()?, cell()?.to_owned(), cell()?.to_owned());
    Some(Happening { at, kind, sample: (topic, cell()?.parse().ok()?, cell()?.parse().ok()?) })
}

fn timeline(parts: &[Part]) -> Value {
    let all = || parts.iter().flat_map(|part| &part.happenings);
    let begin = all().map(|happening| happening.at).min().unwrap_or_default();
    let us = |at: u64| (at - begin) as f64 / 1e3;
    let mut senders = BTreeMap::new();
    for (process, part) in parts.iter().enumerate() {
        for sent in part.happenings.iter().filter(|happening| happening.kind == "sent") {
            senders.insert(&sent.sample, (process, sent.at));
        }
    }
    let mut events = Vec::new();
    let at = |process: usize, at: u64| json!({ "pid": process, "tid": process, "ts": us(at) });
    for (process, part) in parts.iter().enumerate() {
        events.push(json!({ "ph": "M", "name": "process_name", "pid": process, "tid": process, "args": { "name": part.name } }));
        let mut turn = None;
        for happening in &part.happenings {
            match happening.kind.as_str() {
                "begin" => turn = Some(happening.at),
                "end" => {
                    if let Some(begun) = turn.take() {
                        let length = (happening.at - begun) as f64 / 1e3;
                        let slice = json!({ "ph": "X", "name": part.name, "dur": length });
                        events.push(merged(slice, at(process, begun)));
                    }
                }
                "received" => {
                    let Some(&(sender, sent)) = senders.get(&happening.sample) else { continue };
                    let (topic, epoch, sequence) = &happening.sample;
                    let id = format!("{topic} {epoch} {sequence} {process}");
                    let flow = |ph: &str| json!({ "ph": ph, "bp": "e", "cat": "sample", "name": topic, "id": id });
                    events.push(merged(flow("s"), at(sender, sent)));
                    events.push(merged(flow("f"), at(process, happening.at)));
                }
                _ => {}
            }
        }
    }
    json!({ "displayTimeUnit": "ms", "traceEvents": events })
}

fn merged(mut one: Value, other: Value) -> Value {
    if let (Value::Object(one), Value::Object(other)) = (&mut one, other) {
        one.extend(other);
    }
    one
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(name: &str, text: &str) -> Part {
        Part { name: name.to_owned(), happenings: text.lines().filter_map(happening).collect() }
    }

    #[test]
    fn a_sample_is_an_arrow_from_its_sender_s_turn_to_its_reader_s() {
        let simulator = "1000,begin,,0,0\n2000,sent,scan,1,7\n3000,end,,0,0\n";
        let controller =
            "4000,begin,,0,0\n5000,received,scan,1,7\n5500,received,scan,1,8\n9000,end,,0,0\n";
        let parts = [part("simulator", simulator), part("controller", controller)];
        let timeline = timeline(&parts);
        let events = timeline["traceEvents"].as_array().unwrap();
        let of =
            |ph: &str| events.iter().filter(move |event| event["ph"] == ph).collect::<Vec<_>>();
        let turns: Vec<_> =
            of("X").iter().map(|turn| (&turn["name"], &turn["ts"], &turn["dur"])).collect();
        assert_eq!(
            turns,
            [
                (&json!("simulator"), &json!(0.0), &json!(2.0)),
                (&json!("controller"), &json!(3.0), &json!(5.0))
            ]
        );
        // Of the sample whose sender is not known there is no arrow.
        let (begins, ends) = (of("s"), of("f"));
        assert_eq!((begins.len(), ends.len()), (1, 1));
        assert_eq!((&begins[0]["pid"], &begins[0]["ts"]), (&json!(0), &json!(1.0)));
        assert_eq!((&ends[0]["pid"], &ends[0]["ts"]), (&json!(1), &json!(4.0)));
        assert_eq!(begins[0]["id"], ends[0]["id"]);
    }
}
