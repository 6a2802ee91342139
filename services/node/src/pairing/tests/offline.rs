//! The tool for recorded streams: what it says, and what it refuses.

use std::time::Duration;

use super::super::Bounds;
use super::super::offline::{Algorithm, Options, pair_streams};

const STREAM: &str = r#"{"id":"demo","topics":["scan","odom"],"slop":0.05,"queue_size":2,"events":[
{"topic":"scan","stamp_ns":0},{"topic":"odom","stamp_ns":60000000},
{"topic":"odom","stamp_ns":90000000},{"topic":"scan","stamp_ns":100000000},
{"topic":"odom","stamp_ns":110000000},{"topic":"odom","stamp_ns":190000000}]}"#;

/// A stream on one line.
fn stream() -> String {
    STREAM.replace('\n', "")
}

fn written(text: &str, options: &Options) -> String {
    let mut output = Vec::new();
    pair_streams(text, options, &mut output).unwrap();
    String::from_utf8(output).unwrap()
}

fn refused(text: &str) -> String {
    pair_streams(text, &Options::default(), &mut Vec::new()).unwrap_err().to_string()
}

#[test]
fn a_report_tells_every_pair_and_every_loss() {
    let expected = "\
demo: nearest, queue 2, slop 50ms, topics scan odom, 6 events, 1 pairs
  at     3  pair          scan 100000000 (event 3)  odom 90000000 (event 2)  spread 10ms  delay 0ns
  at     5  superseded    odom 60000000 (event 1)
  scan: received 2 = paired 1 + queued 1
  odom: received 4 = paired 1 + queued 2 + superseded 1
  spread: median 10ms, greatest 10ms
  delay: median 0ns, greatest 0ns

";
    assert_eq!(written(&stream(), &Options::default()), expected);
}

#[test]
fn json_has_the_fields_of_the_reference_vectors() {
    let options = Options { json: true, ..Options::default() };
    let report: serde_json::Value = serde_json::from_str(&written(&stream(), &options)).unwrap();

    assert_eq!(report["matches"], serde_json::json!([[100_000_000, 90_000_000]]));
    assert_eq!(report["match_events"], serde_json::json!([[3, 2]]));
    assert_eq!(report["match_at"], serde_json::json!([3]));
    assert_eq!(report["leftover"], serde_json::json!([[0], [110_000_000, 190_000_000]]));
    assert_eq!(report["books"]["odom"]["dropped"], serde_json::json!({ "superseded": 1 }));
}

#[test]
fn what_the_caller_wants_comes_before_what_the_file_says() {
    let options = Options {
        algorithm: Some(Algorithm::Adaptive),
        slop: Some(Duration::from_millis(10)),
        queue_size: Some(7),
        bounds: Bounds::Limited { max_age: Duration::from_secs(1), max_delay: Duration::ZERO },
        json: false,
    };
    let report = written(&stream(), &options);
    assert!(report.starts_with("demo: adaptive, queue 7, slop 10ms,"), "{report}");
}

#[test]
fn hints_name_what_usually_is_the_matter() {
    let cases = [
        (r#"{"topic":"a","stamp_ns":1}"#, "nothing arrived on b"),
        (r#"{"topic":"a","stamp_ns":0},{"topic":"a","stamp_ns":0}"#, "is its header filled in?"),
        (r#"{"topic":"a","stamp_ns":0},{"topic":"b","stamp_ns":60000000}"#, "less than 60ms apart"),
        (
            r#"{"topic":"a","stamp_ns":9000000000},{"topic":"a","stamp_ns":0}"#,
            "a steps back by 9s at event 1",
        ),
    ];
    for (events, expected) in cases {
        let text = format!(r#"{{"topics":["a","b"],"events":[{events}]}}"#);
        let report = written(&text, &Options::default());
        assert!(report.contains(expected), "{report}");
    }
}

#[test]
fn an_error_names_its_line() {
    let good = stream();
    let cases = [
        ("", "there is no stream"),
        ("{", "line 2, column 1: EOF while parsing an object"),
        (r#"{"topics":["a","b"]}"#, "line 2, column 20: missing field `events`"),
        (r#"{"topics":["a"],"events":[]}"#, "line 2: pairing takes 2 to 8 topics"),
        (r#"{"topics":["a","a"],"events":[]}"#, "line 2: topic `a` is listed twice"),
        (
            r#"{"topics":["a","b"],"events":[{"topic":"c","stamp_ns":0}]}"#,
            "line 2: event 0 is on `c`, which is not among the topics",
        ),
        (
            r#"{"topics":["a","b"],"events":[{"topic":"a","stamp_ns":-1}]}"#,
            "line 2: event 0 has a negative stamp",
        ),
        (
            r#"{"topics":["a","b"],"inter_message_lower_bound_ns":[0],"events":[]}"#,
            "line 2: inter_message_lower_bound_ns needs one number for each topic",
        ),
    ];
    for (line, expected) in cases {
        let text = if line.is_empty() { String::new() } else { format!("{good}\n{line}\n") };
        let error = refused(&text);
        assert!(error.starts_with(expected), "{error}");
    }
}
