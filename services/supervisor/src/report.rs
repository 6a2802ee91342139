//! What is left of a run: on screen as text, in a file as JSON.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use node::config::{FileName, Parameters};
use node::{Clock, Error, Result, Settings};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::Options;
use crate::member::Member;
use crate::verdict::Verdict;

/// The counters of one topic over a whole run.
#[derive(Debug, Default)]
struct Topic {
    publisher: String,
    sent: u64,
    digest: u64,
    /// Whether it is sent by occasion: who comes late is told the newest only.
    on_event: bool,
    readers: Vec<Reader>,
}

/// What came to one reader of a topic.
#[derive(Debug)]
struct Reader {
    name: String,
    received: u64,
    lost: u64,
    unread: u64,
    stale: u64,
}

impl Topic {
    /// Whether everything that was sent is accounted for by every reader. How much one who is no
    /// node of the robot has sent, nobody knows.
    fn is_closed(&self) -> bool {
        let accounted =
            |reader: &Reader| reader.received + reader.lost + reader.unread + reader.stale;
        self.on_event
            || self.is_from_outside()
            || self.readers.iter().all(|reader| accounted(reader) == self.sent)
    }

    fn is_from_outside(&self) -> bool {
        self.publisher.is_empty()
    }

    /// Who received least: one reader's figures add up, those of several do not.
    fn worst(&self) -> Option<&Reader> {
        self.readers.iter().min_by_key(|reader| reader.received)
    }

    fn received(&self) -> u64 {
        self.worst().map_or(0, |reader| reader.received)
    }

    fn lost(&self) -> u64 {
        self.worst().map_or(0, |reader| reader.lost)
    }

    fn unread(&self) -> u64 {
        self.worst().map_or(0, |reader| reader.unread)
    }
}

/// The node in the supervisor's own process.
const PAIRING: &str = "pairing";

/// The figures that every run is asked for, line by line.
const LINES: [(&str, &[&str]); 4] = [
    ("drive", &["distance_m", "clearance_min_m", "collisions", "commands_limited"]),
    ("corridor", &["cells", "cells_out", "cells_back"]),
    (
        "scan to wheel",
        &["scan_to_command_p50_us", "scan_to_command_p99_us", "scan_to_command_max_us"],
    ),
    ("pairing", &["pairs", "resets", "tickets_whose_sample_is_gone"]),
];

/// Figures that begin so count what went wrong: what never did is not worth a line.
const REASONS: [&str; 4] = ["unfit_", "rejected_", "rebases", "dead_man_trips"];

/// What pairing did as it should: the rest of its figures are reasons.
const PAIRED: [&str; 4] = ["pairs", "resets", "scan_received", "odom_received"];

/// Figures for the live line, or told elsewhere.
const UNTOLD: [&str; 8] = [
    "simulated_s",
    "steps",
    "clearance_m",
    "x_m",
    "y_m",
    "yaw_rad",
    "estimate_error_m",
    "estimate_error_rad",
];

/// What quantiles say shorter.
const STEPS: &str = "scan_to_command_";

/// Where the robot drives, as far as a process has such parameters.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Place {
    #[serde(default)]
    pub(crate) world: Option<FileName>,
    #[serde(default)]
    pub(crate) start: Option<String>,
}

impl Parameters for Place {}

impl Place {
    pub(crate) fn of(settings: &Settings) -> Self {
        let processes = settings.launch().process.iter();
        let mut places = processes.filter_map(|process| settings.view(&process.name));
        places.find(|place: &Self| place.world.is_some()).unwrap_or_default()
    }
}

/// As the launch file says it.
pub(crate) const fn clock_label(clock: Clock) -> &'static str {
    match clock {
        Clock::Lockstep => "lockstep",
        Clock::Realtime => "realtime",
    }
}

/// What is left of a run.
#[derive(Debug)]
pub(crate) struct Report {
    run: Vec<(&'static str, Value)>,
    /// What the command line has set.
    sets: Vec<String>,
    topics: BTreeMap<String, Topic>,
    nodes: Vec<(String, Map<String, Value>)>,
    memory_peak_kib: Vec<(String, u64)>,
    wall: Duration,
    cause: String,
    code: u8,
}

impl Report {
    pub(crate) fn new(
        settings: &Settings,
        options: &Options,
        members: &[Member],
        wall: Duration,
        verdict: &Verdict,
    ) -> Self {
        let launch = settings.launch();
        let clock = clock_label(launch.clock);
        let config = options.config.display().to_string();
        let place = Place::of(settings);
        let run = vec![
            ("config", json!(config)),
            ("world", json!(place.world.map(|world| world.path().display().to_string()))),
            ("start", json!(place.start)),
            ("robot", json!(launch.robot)),
            ("clock", json!(clock)),
            ("seed", json!(launch.seed)),
        ];
        let sets = options.sets();
        let topics = topics(members);
        let (mut cause, mut code) = (verdict.cause.clone(), verdict.code);
        // In lock-step nothing may be lost, and no run may say that it went well where something was.
        if code == 0 && launch.clock == Clock::Lockstep && !topics.values().all(Topic::is_closed) {
            cause.push_str("; but the counters do not close");
            code = 1;
        }
        Self {
            run,
            sets,
            topics,
            nodes: members.iter().map(figures).collect(),
            memory_peak_kib: members
                .iter()
                .map(|member| (member.name.clone(), member.memory_peak_kib))
                .collect(),
            wall,
            cause,
            code,
        }
    }

    /// [-] The exit code of the run.
    pub(crate) fn code(&self) -> u8 {
        self.code
    }

    /// Over every sample of every topic, in order; equal digests are equal runs. None in real time,
    /// where no two runs are.
    fn digest(&self) -> Option<String> {
        if self.topics.values().all(|topic| topic.digest == 0) {
            return None;
        }
        let mut bytes = Vec::new();
        for (name, topic) in self.topics.iter().filter(|(_, topic)| 0 < topic.sent) {
            bytes.extend_from_slice(name.as_bytes());
            bytes.extend_from_slice(&topic.sent.to_le_bytes());
            bytes.extend_from_slice(&topic.digest.to_le_bytes());
        }
        Some(format!("{:016x}", xxhash_rust::xxh3::xxh3_64(&bytes)))
    }

    /// A figure of the run: the world's own comes before that of any other node.
    fn figure(&self, key: &str) -> Option<f64> {
        let mut nodes: Vec<_> = self.nodes.iter().collect();
        nodes.sort_by_key(|(name, _)| !self.is_world(name));
        nodes.into_iter().find_map(|(_, figures)| figures.get(key)?.as_f64())
    }

    /// Whether the node is the simulator, or takes its place.
    fn is_world(&self, name: &str) -> bool {
        self.topics.get("scan").is_some_and(|topic| topic.publisher == name)
    }

    /// None of a robot that drives in the real world.
    fn real_time_factor(&self) -> Option<f64> {
        let wall = self.wall.as_secs_f64();
        self.figure("simulated_s").map(|simulated| if 0.0 < wall { simulated / wall } else { 0.0 })
    }

    /// For a machine.
    fn json(&self) -> Value {
        let mut report: Map<_, _> =
            self.run.iter().map(|(key, value)| ((*key).to_owned(), value.clone())).collect();
        for key in
            ["simulated_s", "distance_m", "clearance_min_m", "collisions", "cells", "cells_out"]
        {
            report.insert(key.into(), json!(self.figure(key)));
        }
        report.insert("sets".into(), json!(self.sets));
        let age = |name: &str| json!(self.figure(&format!("scan_to_command_{name}_us")));
        let age = json!({ "p50": age("p50"), "p99": age("p99"), "max": age("max") });
        report.insert("scan_to_command_us".into(), age);
        let commands = self.topics.get("cmd_vel").map(|topic| topic.sent);
        report.insert("commands".into(), json!(commands));
        report.insert("pairs".into(), json!(self.figure("pairs")));
        report.insert("wall_s".into(), json!(self.wall.as_secs_f64()));
        report.insert("real_time_factor".into(), json!(self.real_time_factor()));
        report.insert("exit".into(), json!({ "code": self.code, "cause": self.cause }));
        report.insert("digest".into(), json!(self.digest()));
        report.insert("counters_close".into(), json!(self.topics.values().all(Topic::is_closed)));
        let nodes: Map<_, _> =
            self.nodes.iter().map(|(name, figures)| (name.clone(), json!(figures))).collect();
        report.insert("nodes".into(), Value::Object(nodes));
        let memory: Map<_, _> =
            self.memory_peak_kib.iter().map(|(name, peak)| (name.clone(), json!(peak))).collect();
        report.insert("memory_peak_kib".into(), Value::Object(memory));
        let topics: Map<_, _> =
            self.topics.iter().map(|(name, topic)| (name.clone(), topic_json(topic))).collect();
        report.insert("topics".into(), Value::Object(topics));
        Value::Object(report)
    }

    /// For a person.
    pub(crate) fn text(&self) -> String {
        let mut text = String::new();
        self.write_run(&mut text);
        self.write_topics(&mut text);
        let memory = self.memory_peak_kib.iter().filter(|(_, peak)| 0 < *peak);
        let memory: Vec<_> =
            memory.map(|(name, peak)| format!("{name} {:.1}", *peak as f64 / 1024.0)).collect();
        line(&mut text, "memory peak", &format!("{} MiB", memory.join(", ")));
        if let Some(digest) = self.digest() {
            line(&mut text, "digest", &digest);
        }
        line(&mut text, "end", &format!("{} (exit {})", self.cause, self.code));
        text
    }

    fn write_run(&self, text: &mut String) {
        text.push('\n');
        let run: Vec<_> = self
            .run
            .iter()
            .filter(|(_, value)| !value.is_null())
            .map(|(key, value)| {
                let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
                format!("{key} {value}")
            })
            .collect();
        wrapped(text, "run", &run);
        let wall = self.wall.as_secs_f64();
        let simulated = self.figure("simulated_s").zip(self.real_time_factor());
        let time = simulated.map_or_else(
            || format!("{wall:.2} s"),
            |(simulated, factor)| {
                format!("{simulated:.2} s in {wall:.2} s, {factor:.0} x real time")
            },
        );
        line(text, "time", &time);
        for (name, keys) in LINES {
            let is_unmeasured = |key: &str| self.nodes.iter().any(|(_, all)| never_met(all, key));
            let figures: Vec<_> = keys
                .iter()
                .filter(|key| !is_unmeasured(key))
                .filter_map(|key| self.figure(key).map(|figure| figure_text(key, figure)))
                .collect();
            if !figures.is_empty() {
                wrapped(text, name, &figures);
            }
        }
        let (ages, unpaired): (Vec<_>, Vec<_>) = self
            .node(PAIRING)
            .filter(|(key, figure)| !PAIRED.contains(key) && 0.0 < *figure)
            .partition(|(key, _)| key.starts_with("age_"));
        for (name, figures) in [("", ages), ("unpaired", unpaired)] {
            let figures: Vec<_> =
                figures.into_iter().map(|(key, figure)| figure_text(key, figure)).collect();
            if !figures.is_empty() {
                wrapped(text, name, &figures);
            }
        }
        self.write_others(text);
    }

    /// The figures of nodes that the lines above say nothing of.
    fn write_others(&self, text: &mut String) {
        let told = |key: &str| {
            let is_in_a_line = LINES.iter().any(|(_, keys)| keys.contains(&key));
            is_in_a_line || UNTOLD.contains(&key) || key.starts_with(STEPS)
        };
        for (name, all) in self.nodes.iter().filter(|(name, _)| name != PAIRING) {
            let unmet = |key: &str, figure: f64| {
                figure <= 0.0 && REASONS.iter().any(|reason| key.starts_with(reason))
            };
            let figures: Vec<_> = self
                .node(name)
                .filter(|&(key, figure)| !told(key) && !unmet(key, figure) && !never_met(all, key))
                .map(|(key, figure)| figure_text(key, figure))
                .collect();
            if !figures.is_empty() {
                wrapped(text, name, &figures);
            }
        }
    }

    /// The figures of one node.
    fn node(&self, name: &str) -> impl Iterator<Item = (&str, f64)> {
        let figures = self.nodes.iter().filter(move |(node, _)| node == name);
        let figures = figures.flat_map(|(_, figures)| figures);
        figures.filter_map(|(key, figure)| Some((key.as_str(), figure.as_f64()?)))
    }

    fn write_topics(&self, text: &mut String) {
        let _ = writeln!(
            text,
            "{:<14}{:<20}{:>9}{:>10}{:>7}{:>8}",
            "topics", "", "sent", "received", "lost", "unread"
        );
        for (name, topic) in &self.topics {
            if topic.sent == 0 && topic.readers.is_empty() {
                continue;
            }
            let remark = match topic.is_closed() {
                true if topic.is_from_outside() && 0 < topic.received() => "  from outside",
                true => "",
                false => "  does not close",
            };
            let _ = writeln!(
                text,
                "{:<14}{name:<20}{:>9}{:>10}{:>7}{:>8}{remark}",
                "",
                topic.sent,
                topic.received(),
                topic.lost(),
                topic.unread()
            );
        }
    }

    /// Writes the JSON to `path`, all or nothing.
    pub(crate) fn write(&self, path: &Path) -> Result {
        let failed = |cause| Error::File { path: path.to_owned(), cause };
        let text = format!("{:#}\n", self.json());
        let fresh = fresh(path);
        std::fs::write(&fresh, text).map_err(failed)?;
        std::fs::rename(&fresh, path).map_err(failed)
    }
}

/// Finds out before the run whether its report can be written after it.
pub(crate) fn check_writable(path: &Path) -> Result {
    let fresh = fresh(path);
    let tried = std::fs::write(&fresh, "").and_then(|()| std::fs::remove_file(&fresh));
    tried.map_err(|cause| Error::File { path: path.to_owned(), cause })
}

/// Makes the directory of a run's records ready: without those of a former run, and with the launch
/// file as it is now.
pub(crate) fn begin_records(records: &Path, launch_file: &Path) -> Result {
    let failed = |path: &Path, cause| Error::File { path: path.to_owned(), cause };
    std::fs::create_dir_all(records).map_err(|cause| failed(records, cause))?;
    for entry in std::fs::read_dir(records).map_err(|cause| failed(records, cause))?.flatten() {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        if RECORDS.iter().any(|kind| name.ends_with(kind)) {
            std::fs::remove_file(&path).map_err(|cause| failed(&path, cause))?;
        }
    }
    let copied = std::fs::copy(launch_file, records.join("launch.toml"));
    copied.map(drop).map_err(|cause| failed(launch_file, cause))
}

/// What the names of nodes' records end in.
const RECORDS: [&str; 2] = [".diary.csv", ".latency.csv"];

/// A name beside `path` that nobody else uses: what is half-written never bears the real name.
fn fresh(path: &Path) -> PathBuf {
    path.with_extension(format!("{}.new", std::process::id()))
}

fn topics(members: &[Member]) -> BTreeMap<String, Topic> {
    let mut topics = BTreeMap::<String, Topic>::new();
    for member in members {
        for port in member.status.ports() {
            let topic = topics.entry(port.topic.to_string()).or_default();
            if port.publishes == 1 {
                topic.publisher.clone_from(&member.name);
                topic.sent = port.samples;
                topic.digest = port.digest;
                topic.on_event = port.on_event == 1;
            } else {
                topic.readers.push(Reader {
                    name: member.name.clone(),
                    received: port.samples,
                    lost: port.lost,
                    unread: port.unread,
                    stale: port.stale,
                });
            }
        }
    }
    topics
}

fn topic_json(topic: &Topic) -> Value {
    let readers: Map<_, _> = topic
        .readers
        .iter()
        .map(|reader| {
            let counters = json!({
                "received": reader.received,
                "lost": reader.lost,
                "unread": reader.unread,
                "stale": reader.stale,
            });
            (reader.name.clone(), counters)
        })
        .collect();
    json!({
        "publisher": topic.publisher,
        "sent": topic.sent,
        "received": topic.received(),
        "lost": topic.lost(),
        "unread": topic.unread(),
        "on_event": topic.on_event,
        "digest": format!("{:016x}", topic.digest),
        "readers": readers,
    })
}

fn figures(member: &Member) -> (String, Map<String, Value>) {
    let values = member.status.values().iter();
    let figures = values.map(|value| (value.key.to_string(), json!(value.value))).collect();
    (member.name.clone(), figures)
}

/// Whether `key` is of a latency that was never measured: a 0 would look like a very good one.
fn never_met(figures: &Map<String, Value>, key: &str) -> bool {
    let mut parts = ["_p50_us", "_p99_us", "_max_us"].into_iter();
    let of = parts.find_map(|part| key.strip_suffix(part));
    let max = of.and_then(|name| figures.get(&format!("{name}_max_us")));
    max.is_some_and(|max| max.as_f64() == Some(0.0))
}

/// `distance_m`, 12.04 as `distance 12.040 m`.
fn figure_text(key: &str, value: f64) -> String {
    let (name, unit) = match key.rsplit_once('_') {
        Some((name, unit)) if UNITS.contains(&unit) => (name, unit),
        _ => (key, ""),
    };
    let name = name.trim_start_matches("scan_to_command_");
    let digits = if unit.is_empty() || unit == "us" { 0 } else { 3 };
    format!("{} {value:.digits$} {unit}", name.replace('_', " ")).trim_end().to_owned()
}

/// What a figure's name can end in.
const UNITS: [&str; 6] = ["m", "s", "us", "ms", "rad", "kib"];

fn line(text: &mut String, name: &str, content: &str) {
    let _ = writeln!(text, "{name:<14}{content}");
}

/// As many `items` to a line as fit in 100 columns.
fn wrapped(text: &mut String, name: &str, items: &[String]) {
    const WIDTH: usize = 86;
    let mut name = name;
    let mut content = String::new();
    for item in items {
        if !content.is_empty() && WIDTH < content.len() + 2 + item.len() {
            line(text, name, &content);
            name = "";
            content.clear();
        }
        if !content.is_empty() {
            content.push_str(", ");
        }
        content.push_str(item);
    }
    line(text, name, &content);
}
