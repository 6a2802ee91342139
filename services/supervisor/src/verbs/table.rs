//! A robot's status as text: a table of its nodes, and what they share.

use serde_json::Value;

use node::say::{shown, span};

const TITLES: [&str; COLUMNS] = ["NODE", "STATE", "PID", "UP", "RESTARTS", "RATE", "LAST FAULT"];

const COLUMNS: usize = 7;

/// Which column has a colour.
const STATE: usize = 1;

/// [character] So that a long name leaves room for the last fault, which has what is left.
const WIDTHS_MAX: [usize; COLUMNS - 1] = [16, 22, 7, 6, 8, 23];

/// [character] Of a topic's name, lest its rate be cut off.
const TOPIC_MAX: usize = 12;

/// [-] Rates that differ by less are one and the same, a little off: the first is told.
const FASTER: f64 = 1.2;

/// Between two columns.
const GAP: &str = "  ";

/// The whole of `status`, no line of it longer than `width`.
pub(super) fn table(status: &Value, width: usize, is_coloured: bool) -> String {
    let nodes = status["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    let rows: Vec<_> = nodes.iter().map(cells).collect();
    let mut widths = [0; COLUMNS];
    for (column, &most) in WIDTHS_MAX.iter().enumerate() {
        let cells = rows.iter().map(|row| row[column].chars().count());
        widths[column] = cells.chain([TITLES[column].len()]).max().unwrap_or_default().min(most);
    }
    let used: usize = widths.iter().sum::<usize>() + GAP.len() * (COLUMNS - 1);
    widths[COLUMNS - 1] = width.saturating_sub(used);

    let mut text = line(&TITLES.map(str::to_owned), &widths, None);
    for row in &rows {
        text.push_str(&line(row, &widths, is_coloured.then(|| colour(&row[STATE]))));
    }
    for sentence in sentences(status) {
        text.push_str(&cut(&sentence, width));
        text.push('\n');
    }
    text
}

fn line(cells: &[String; COLUMNS], widths: &[usize; COLUMNS], colour: Option<&str>) -> String {
    let cells = cells.iter().zip(widths).enumerate();
    let padded = cells.map(|(column, (cell, &width))| {
        let cell = format!("{:<width$}", cut(cell, width));
        match colour {
            Some(colour) if column == STATE => format!("{colour}{cell}\x1b[0m"),
            Some(_) | None => cell,
        }
    });
    let line = padded.collect::<Vec<_>>().join(GAP);
    format!("{}\n", line.trim_end())
}

fn cells(node: &Value) -> [String; COLUMNS] {
    let number = |key: &str| node[key].as_u64().map_or("-".to_owned(), |number| number.to_string());
    [
        plain(node["name"].as_str().unwrap_or("?")),
        plain(&state(node)),
        number("pid"),
        node["uptime_s"].as_f64().map_or("-".to_owned(), span),
        number("restarts"),
        plain(&rate(node)),
        plain(&last_fault(node)),
    ]
}

/// Where it stands, in ROS 2's words, or what will not stay so where that says more.
pub(super) fn state(node: &Value) -> String {
    let text = |key: &str| node[key].as_str().unwrap_or_default();
    if let Some(topic) = node["stalled"].as_str() {
        return format!("no data on {topic}");
    }
    match text("doing") {
        "" | "running" | "starting" | "stopping" | "stopped" | "ended" => text("state").to_owned(),
        doing => doing.to_owned(),
    }
}

/// The fastest topic of those that it publishes: what sets the pace of whoever reads it.
fn rate(node: &Value) -> String {
    let topics = node["topics"].as_array().filter(|_| !node["pid"].is_null());
    let topics = topics.map_or(&[][..], Vec::as_slice);
    let hz = |topic: &Value| topic["hz"].as_f64().unwrap_or_default();
    let faster = |best, topic| if FASTER * hz(best) < hz(topic) { topic } else { best };
    let Some(fastest) = topics.iter().reduce(faster) else { return "-".to_owned() };
    let topic = cut(fastest["topic"].as_str().unwrap_or("?"), TOPIC_MAX);
    let more = if topics.len() < 2 { String::new() } else { format!(" +{}", topics.len() - 1) };
    match fastest["hz"].as_f64() {
        Some(hz) => format!("{topic} {hz} Hz{more}"),
        None => format!("{topic} -{more}"),
    }
}

/// When first, which a long reason must not push out.
fn last_fault(node: &Value) -> String {
    let failure = &node["last_failure"];
    let (what, ago) = (failure["what"].as_str(), failure["ago_s"].as_f64());
    what.map_or("-".to_owned(), |what| format!("{} ago: {what}", span(ago.unwrap_or_default())))
}

fn colour(state: &str) -> &'static str {
    match state {
        "active" => "\x1b[32m",
        "unknown" | "finalized" => "\x1b[31m",
        _ => "\x1b[33m",
    }
}

/// What the nodes share.
fn sentences(status: &Value) -> Vec<String> {
    let text = |value: &Value| plain(value.as_str().unwrap_or("?"));
    let (memory, log) = (&status["shared_memory"], &status["log"]);
    let mut sentences = vec![
        format!(
            "{} is {}, up {}; supervisor {}: {}, {} % CPU",
            text(&status["robot"]),
            text(&status["state"]),
            span(status["uptime_s"].as_f64().unwrap_or_default()),
            status["supervisor"],
            size(status["memory_kib"].as_f64().unwrap_or_default() * 1024.0),
            status["cpu_percent"].as_f64().unwrap_or_default(),
        ),
        format!(
            "shared memory: {} files, {}; {} at the most, {} free",
            memory["files"],
            size(memory["bytes"].as_f64().unwrap_or_default()),
            size(memory["need"].as_f64().unwrap_or_default()),
            size(memory["free"].as_f64().unwrap_or_default()),
        ),
    ];
    if let Some(permission) = status["motion"]["permission"].as_str() {
        let motion = &status["motion"];
        let cause = match text(&motion["cause"]).as_str() {
            "none" => String::new(),
            cause => format!(": {cause}"),
        };
        let rejected = motion["rejected"].as_object().into_iter().flatten();
        let rejected: u64 = rejected.filter_map(|(_, count)| count.as_u64()).sum();
        let person = if motion["needs_person"] == true { "; teseo arm" } else { "" };
        sentences.push(format!(
            "motion: {permission}{cause}{person}; trips {}, commands refused {rejected}",
            motion["trips"]
        ));
    }
    let ignored = |socket: &str| status["ignored"][socket].as_u64().unwrap_or_default();
    let (notify, control) = (ignored("notify"), ignored("control"));
    if 0 < notify + control {
        sentences.push(format!("ignored: {notify} at the notify socket, {control} at this one"));
    }
    let dropped = log["dropped"].as_u64().unwrap_or_default();
    if 0 < dropped {
        sentences.push(format!("log: {dropped} bytes were written faster than they can be read"));
    }
    if let Some(disk) = log["disk"].as_str() {
        sentences.push(format!("log: on disk {}", plain(disk)));
    }
    sentences
}

fn size(bytes: f64) -> String {
    if bytes < 1024.0 * 1024.0 {
        format!("{:.0} KiB", bytes / 1024.0)
    } else {
        format!("{:.1} MiB", bytes / 1024.0 / 1024.0)
    }
}

/// A character that is wider, or none, would move what follows out of its column.
fn plain(text: &str) -> String {
    let text = shown(text);
    text.chars().map(|c| if c.is_ascii() && c != '\t' { c } else { '?' }).collect()
}

/// The beginning of `text`, and a mark where it goes on.
fn cut(text: &str, width: usize) -> String {
    const MARK: &str = "..";
    if text.chars().count() <= width {
        return text.to_owned();
    }
    let kept: String = text.chars().take(width.saturating_sub(MARK.len())).collect();
    format!("{kept}{MARK}").chars().take(width).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn node(name: &str, state: &str, doing: &str) -> Value {
        json!({
            "name": name, "state": state, "doing": doing, "pid": 12041, "epoch": 1,
            "uptime_s": 72.3, "restarts": 0, "stalled": null,
            "topics": [{ "topic": "odom", "hz": 50.0 }], "text": "", "last_failure": null,
        })
    }

    fn status(nodes: &[Value]) -> Value {
        json!({
            "robot": "burger", "state": "ready", "uptime_s": 75.0, "supervisor": 12039,
            "memory_kib": 6_400, "cpu_percent": 0.31,
            "shared_memory":
                { "files": 34, "bytes": 6_501_171, "need": 21_000_000, "free": 536_870_912 },
            "ignored": { "notify": 0, "control": 0 }, "log": { "dropped": 0, "disk": null },
            "nodes": nodes,
        })
    }

    #[test]
    fn a_robot_reads_like_this() {
        let mut fallen = node("controller", "active", "running");
        fallen["last_failure"] =
            json!({ "what": "was killed by signal 9 (SIGKILL)", "ago_s": 30.2 });
        fallen["restarts"] = json!(1);
        fallen["topics"] = json!([{ "topic": "cmd_vel", "hz": 19.9 }, { "topic": "x", "hz": 1.0 }]);
        let mut down = node("odometry", "finalized", "stopped");
        (down["pid"], down["uptime_s"], down["topics"]) = (Value::Null, Value::Null, json!([]));

        assert_eq!(
            table(&status(&[down, fallen]), 100, false),
            "\
NODE        STATE      PID    UP     RESTARTS  RATE                LAST FAULT
odometry    finalized  -      -      0         -                   -
controller  active     12041  1m12s  1         cmd_vel 19.9 Hz +1  30s ago: was killed by signal 9..
burger is ready, up 1m15s; supervisor 12039: 6.2 MiB, 0.31 % CPU
shared memory: 34 files, 6.2 MiB; 20.0 MiB at the most, 512.0 MiB free
"
        );
    }

    #[test]
    fn the_rate_is_that_of_the_fastest_topic_and_of_the_first_where_they_are_alike() {
        let mut bridge = node("turtlebot3", "active", "running");
        for (rates, shown) in [
            (
                &[("battery_state", 1.0), ("joint_states", 50.1), ("imu", 50.3)][..],
                "joint_states 50.1 Hz +2",
            ),
            (&[("scan", 5.0), ("imu", 50.0)], "imu 50 Hz +1"),
            (&[("motion_state", 0.0)], "motion_state 0 Hz"),
            (&[], "-"),
        ] {
            let topic = |(topic, hz): &(&str, f64)| json!({ "topic": topic, "hz": hz });
            bridge["topics"] = rates.iter().map(topic).collect();
            assert_eq!(rate(&bridge), shown);
        }
    }

    #[test]
    fn columns_stand_under_their_titles_and_no_line_is_too_long_whatever_nodes_are_called() {
        let long = "wide \u{1F600} and \t long ".repeat(20);
        let mut wordy = node(&long, &long, &long);
        wordy["last_failure"] = json!({ "what": long, "ago_s": 1e9 });
        wordy["topics"] = json!([{ "topic": long, "hz": 1e300 }]);
        wordy["stalled"] = json!(long);
        let mut whole = status(&[wordy, node("simulator", "active", "running")]);
        (whole["robot"], whole["log"]["disk"]) = (json!(long), json!(long));
        whole["log"]["dropped"] = json!(u64::MAX);
        for width in [96, 100] {
            let text = table(&whole, width, false);
            assert!(text.is_ascii(), "{text}");
            assert!(text.lines().all(|line| line.len() <= width), "{width}\n{text}");
        }
        let text = table(&whole, 100, false);
        let lines: Vec<_> = text.lines().collect();
        let fault = lines[0].find("LAST").unwrap();
        assert_eq!(&lines[1][fault - 2..fault], "  ", "{text}");
        assert_eq!(lines[2].find('-'), Some(fault), "{text}");
    }

    #[test]
    fn colours_are_there_only_where_they_are_wanted() {
        let states = [("active", "running"), ("activating", "starting"), ("finalized", "stopped")];
        let nodes = states.map(|(state, doing)| node("x", state, doing));
        let plain = table(&status(&nodes), 100, false);
        let coloured = table(&status(&nodes), 100, true);

        assert!(!plain.contains('\x1b'), "{plain}");
        for state in ["\x1b[32mactive", "\x1b[33mactivating", "\x1b[31mfinalized"] {
            assert!(coloured.contains(state), "{coloured}");
        }
        let mut bare = coloured;
        for code in ["\x1b[32m", "\x1b[33m", "\x1b[31m", "\x1b[0m"] {
            bare = bare.replace(code, "");
        }
        assert_eq!(bare, plain, "colours move nothing");
    }

    #[test]
    fn a_status_of_another_build_is_shown_as_far_as_it_goes() {
        for strange in [json!({}), json!(null), json!({ "nodes": [{}, 7] })] {
            assert!(table(&strange, 100, true).starts_with("NODE"));
        }
    }
}
