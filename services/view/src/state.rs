//! Everything that the screen knows about a robot, put together from what it has told.

mod age;
mod place;
mod topics;

use std::collections::{BTreeMap, VecDeque};

use interfaces::{
    Header, LaserScan, MotionState, NodeStatus, Odometry, Permission, PortStatus, Stamp, StopCause,
};
use node::Clock;
use serde_json::Value;

use crate::map::Map;
use age::Ages;
pub(crate) use place::Place;
pub(crate) use topics::{Pace, TopicRow};

/// [-] Events that are kept: more than the largest terminal has lines.
const EVENTS_MAX: usize = 200;

/// The states that a node stays in.
const PRIMARY: [&str; 4] = ["unconfigured", "inactive", "active", "finalized"];

/// What pairing did as it should: the rest of its figures about topics are reasons.
const PAIRED: [&str; 2] = ["received", "queued"];

/// Everything that the screen knows.
#[derive(Debug, Clone, Default)]
pub struct State {
    /// [-] The robot's name.
    pub(crate) robot: String,
    pub(crate) supervisor: Supervisor,
    pub(crate) motion: Motion,
    pub(crate) nodes: Vec<NodeRow>,
    pub(crate) events: VecDeque<Event>,
    pub(crate) place: Place,
    pub(crate) ages: Ages,
    paces: BTreeMap<String, Pace>,
    /// When it was last told anything.
    pub(crate) now: Stamp,
}

/// What the supervisor says about itself and the robot.
#[derive(Debug, Clone, Default)]
pub(crate) struct Supervisor {
    /// Starting, ready, degraded, ending, or gone; empty where it has not answered yet.
    pub(crate) state: String,
    pub(crate) clock: Option<Clock>,
    pub(crate) config: String,
    pub(crate) world: Option<(String, String)>,
    pub(crate) uptime_s: f64,
    pub(crate) files: u64,
    pub(crate) bytes: u64,
}

/// Whether the robot may move.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motion {
    /// Armed, braking or held; empty where nobody drives wheels.
    pub(crate) permission: String,
    pub(crate) cause: String,
    pub(crate) needs_person: bool,
    pub(crate) emergency_stop: bool,
    pub(crate) trips: u64,
}

/// One node, as the supervisor, the node itself and the kernel tell of it.
#[derive(Debug, Clone, Default)]
pub(crate) struct NodeRow {
    pub(crate) name: String,
    pub(crate) state: String,
    pub(crate) doing: String,
    pub(crate) pid: Option<u32>,
    pub(crate) epoch: u64,
    pub(crate) uptime_s: Option<f64>,
    pub(crate) restarts: u64,
    pub(crate) text: String,
    pub(crate) last_failure: Option<String>,
    pub(crate) rates: Vec<(String, f64)>,
    /// [%] Of one processor, lately.
    pub(crate) cpu_percent: Option<f64>,
    pub(crate) memory_kib: Option<u64>,
    pub(crate) ports: Vec<PortStatus>,
    pub(crate) figures: Vec<(String, f64)>,
}

/// One thing that has happened.
#[derive(Debug, Clone, Default)]
pub(crate) struct Event {
    /// Of people's clocks, to the millisecond.
    pub(crate) time: String,
    pub(crate) node: String,
    pub(crate) kind: String,
    pub(crate) text: String,
}

/// From the scan to the wheels: how old is what moves the robot.
#[derive(Debug, Default, Clone, PartialEq)]
pub(crate) struct Age {
    /// [us] Of half of the commands.
    pub(crate) p50: f64,
    /// [us] Of all but one in a hundred.
    pub(crate) p99: f64,
    /// [us] Of the oldest.
    pub(crate) max: f64,
}

impl State {
    /// What is known before anything was heard of the robot called `robot`.
    pub fn new(robot: &str) -> Self {
        Self { robot: robot.to_owned(), ..Self::default() }
    }

    /// The robot as its supervisor tells it, by `teseo status`.
    pub fn hear_status(&mut self, now: Stamp, status: &Value) {
        self.now = now;
        let memory = &status["shared_memory"];
        self.supervisor = Supervisor {
            state: text(&status["state"]),
            clock: match status["clock"].as_str() {
                Some("lockstep") => Some(Clock::Lockstep),
                Some("realtime") => Some(Clock::Realtime),
                Some(_) | None => None,
            },
            config: text(&status["config"]),
            world: status["world"].as_str().map(|world| (world.to_owned(), text(&status["start"]))),
            uptime_s: status["uptime_s"].as_f64().unwrap_or_default(),
            files: memory["files"].as_u64().unwrap_or_default(),
            bytes: memory["bytes"].as_u64().unwrap_or_default(),
        };
        let motion = &status["motion"];
        self.motion = Motion {
            permission: text(&motion["permission"]),
            cause: text(&motion["cause"]),
            needs_person: motion["needs_person"] == true,
            emergency_stop: motion["emergency_stop"] == true,
            trips: motion["trips"].as_u64().unwrap_or_default(),
        };
        let mut former = std::mem::take(&mut self.nodes);
        for told in status["nodes"].as_array().into_iter().flatten() {
            let name = text(&told["name"]);
            let known = former.iter().position(|node| node.name == name);
            let mut node = known.map(|index| former.swap_remove(index)).unwrap_or_default();
            node.hear(name, told);
            self.nodes.push(node);
        }
    }

    /// The supervisor is not there any more.
    pub fn lose(&mut self, now: Stamp) {
        self.now = now;
        "gone".clone_into(&mut self.supervisor.state);
        for node in &mut self.nodes {
            node.cpu_percent = None;
            node.memory_kib = None;
        }
    }

    /// Something has happened, as the supervisor's socket tells it.
    pub fn hear_event(&mut self, event: &Value) {
        let goal = text(&event["goal"]);
        let is_on_its_way = event["kind"] == "changed" && !PRIMARY.contains(&goal.as_str());
        if event["kind"] == "spawned" || (is_on_its_way && event["reason"] == "") {
            // What comes next says as much.
            return;
        }
        let wall = text(&event["wall"]);
        // The date is everybody's; a day is long enough for what a screen shows.
        let time = wall.split_once('T').map_or(wall.as_str(), |(_, time)| time);
        if self.events.len() == EVENTS_MAX {
            self.events.pop_front();
        }
        self.events.push_back(Event {
            time: time.trim_end_matches('Z').to_owned(),
            node: event["node"].as_str().unwrap_or("robot").to_owned(),
            kind: text(&event["kind"]),
            // Where it is now is what matters, and where it was stands a few lines above.
            text: if event["kind"] == "changed" && event["reason"] == "" {
                goal
            } else {
                text(&event["text"])
            },
        });
    }

    /// A node's own counters and figures.
    pub fn hear_node(&mut self, name: &str, status: &NodeStatus) {
        let Some(node) = self.nodes.iter_mut().find(|node| node.name == name) else { return };
        node.ports = status.ports().to_vec();
        let figures = status.values().iter();
        node.figures =
            figures.map(|figure| (figure.key.as_str().to_owned(), figure.value)).collect();
        self.ages.hear(self.now, status);
        if self.supervisor.clock == Some(Clock::Lockstep)
            && let (Some(x), Some(y), Some(yaw)) =
                (status.value("x_m"), status.value("y_m"), status.value("yaw_rad"))
        {
            let header = Header { stamp: self.now, ..status.header };
            self.place.hear_odometry(&Odometry { header, x, y, yaw, ..Odometry::default() });
        }
    }

    /// [%, KiB] What a node's process takes.
    pub(crate) fn hear_process(&mut self, node: usize, cpu: Option<f64>, memory: Option<u64>) {
        let node = &mut self.nodes[node];
        node.cpu_percent = cpu;
        node.memory_kib = memory;
    }

    /// A sample of a topic, seen at `now`.
    pub fn hear_sample(&mut self, now: Stamp, topic: &str, header: &Header) {
        if !self.paces.contains_key(topic) {
            self.paces.insert(topic.to_owned(), Pace::default());
        }
        if let Some(pace) = self.paces.get_mut(topic) {
            pace.hear(header);
        }
        self.now = now;
    }

    /// Whether the robot may move, from whoever drives its wheels.
    pub fn hear_motion(&mut self, motion: &MotionState) {
        let permission = match Permission::try_from(motion.permission) {
            Ok(Permission::Armed) => "armed",
            Ok(Permission::Braking) => "braking",
            Ok(Permission::Held) => "held",
            Err(_) => "unknown",
        };
        let cause = StopCause::try_from(motion.cause).unwrap_or_default();
        self.motion = Motion {
            permission: permission.to_owned(),
            cause: cause.label().to_owned(),
            needs_person: motion.needs_person == 1,
            emergency_stop: motion.emergency_stop == 1,
            trips: motion.trips,
        };
    }

    /// Where the robot believes to be.
    pub fn hear_odometry(&mut self, odometry: &Odometry) {
        self.place.hear_odometry(odometry);
    }

    /// What the LiDAR sees.
    pub fn hear_scan(&mut self, scan: &LaserScan) {
        self.place.hear_scan(scan);
    }

    /// The world in which the robot drives, and where it started in it.
    pub fn set_map(&mut self, map: Option<Map>) {
        self.place.set_map(map);
    }

    /// It is `now`, and everything that had come by then was told.
    pub fn settle(&mut self, now: Stamp) {
        self.now = now;
        self.paces.values_mut().for_each(|pace| pace.forget(now));
        self.place.reports_pose = self.publishes("robot_pose");
        self.place.settle();
    }

    /// Whether some node says that it publishes this topic.
    pub(crate) fn publishes(&self, topic: &str) -> bool {
        let mut ports = self.nodes.iter().flat_map(|node| &node.ports);
        ports.any(|port| port.publishes == 1 && port.topic.as_str() == topic)
    }

    /// Every topic of the robot, by name.
    pub(crate) fn topics(&self) -> Vec<TopicRow> {
        topics::rows(&self.nodes, &self.paces, self.now)
    }

    /// [-] Pairs so far.
    pub(crate) fn pairs(&self) -> Option<f64> {
        self.figure("pairs")
    }

    /// What found no partner: topic, reason and how often, the most frequent first; what never
    /// happened at the end.
    pub(crate) fn unmatched(&self) -> Vec<(String, String, f64)> {
        let pairing = self.nodes.iter().find(|node| node.name == "pairing");
        let figures = pairing.map_or(&[][..], |node| &node.figures);
        let mut rows: Vec<_> = figures
            .iter()
            .filter_map(|(key, count)| {
                let (topic, reason) = key.split_once('_')?;
                let is_reason = ["scan", "odom"].contains(&topic) && !PAIRED.contains(&reason);
                is_reason.then(|| (topic.to_owned(), reason.replace('_', " "), *count))
            })
            .collect();
        rows.sort_by(|a, b| b.2.total_cmp(&a.2));
        rows
    }

    /// How old is what moves the robot; nothing before the first command.
    pub(crate) fn age(&self) -> Option<Age> {
        let figure = |name| self.figure(&format!("scan_to_command_{name}_us"));
        let age = Age { p50: figure("p50")?, p99: figure("p99")?, max: figure("max")? };
        (0.0 < age.max).then_some(age)
    }

    /// A figure that one of the nodes reports.
    pub(crate) fn figure(&self, key: &str) -> Option<f64> {
        let mut figures = self.nodes.iter().rev().flat_map(|node| &node.figures);
        figures.find(|(known, _)| known == key).map(|(_, value)| *value)
    }
}

impl NodeRow {
    fn hear(&mut self, name: String, told: &Value) {
        self.name = name;
        self.state = text(&told["state"]);
        self.doing = text(&told["doing"]);
        self.pid = told["pid"].as_u64().and_then(|pid| pid.try_into().ok());
        self.epoch = told["epoch"].as_u64().unwrap_or_default();
        self.uptime_s = told["uptime_s"].as_f64();
        self.restarts = told["restarts"].as_u64().unwrap_or_default();
        self.text = text(&told["text"]);
        let failure = &told["last_failure"];
        self.last_failure = failure["what"].as_str().map(str::to_owned);
        let topics = told["topics"].as_array().into_iter().flatten();
        self.rates = topics
            .map(|topic| (text(&topic["topic"]), topic["hz"].as_f64().unwrap_or_default()))
            .collect();
    }
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}
