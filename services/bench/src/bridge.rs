//! The bridge to a TurtleBot3, before an emulated one: from command to bytes, from bytes to samples, and
//! what it takes of a processor.

use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::time::Duration;

use node::{Error, Namespace, Result, clock};

use crate::Effort;
use crate::chain::summed;
use crate::measured::{Unit, Values};
use crate::peers::own;
use crate::robot::{Cores, Running, WORLD, end, failed, processor_time, remove, write};

/// A robot with either LiDAR, at the rates that board and LiDAR have.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bridge {
    lidar: &'static str,
}

/// Either LiDAR.
pub(crate) fn configurations() -> [Bridge; 2] {
    ["lds-01", "lds-02"].map(|lidar| Bridge { lidar })
}

/// The launch file of a real robot, and its wall follower.
const LAUNCH: &str = include_str!("../../../config/turtlebot3.toml");
const CONTROLLER: &str = include_str!("../../../config/controller/lab_robot.toml");

/// What the bridge tells: a name, the figure, and the topic of which there is one value a sample.
const FIGURES: [(&str, &str, &str); 4] = [
    ("command heard to bytes written", "command_to_bytes", "cmd_vel"),
    ("last byte read to joint_states sent", "bytes_to_joints", "joint_states"),
    ("last byte read to scan sent", "bytes_to_scan", "scan"),
    ("first ray to command heard", "scan_to_command", "cmd_vel"),
];

/// Until the board has measured its gyro, the LiDAR is found out and the robot drives.
const SETTLE: Duration = Duration::from_secs(3);

/// How long the processors' time is counted.
const WINDOW: Duration = Duration::from_secs(10);

/// How long the emulated robot may take to be there.
const PATIENCE: Duration = Duration::from_secs(10);

/// Between two looks for it.
const POLL: Duration = Duration::from_millis(10);

impl Bridge {
    /// What it yields, in the order of [`Bridge::measure`].
    pub(crate) fn names(self) -> Vec<(String, Unit)> {
        let durations = FIGURES.map(|(what, ..)| (what, Unit::Nanoseconds));
        let shares = ["the bridge", "the emulated robot"];
        let shares = shares.map(|who| (who, Unit::PercentOfACore)).into_iter();
        let all = durations.into_iter().chain(shares);
        all.map(|(what, unit)| {
            let share = if unit == Unit::PercentOfACore { ", share of a core" } else { "" };
            (format!("{what}{share}, {}", self.lidar), unit)
        })
        .collect()
    }

    /// One round: a drive of some seconds.
    pub(crate) fn measure(self, namespace: &Namespace, effort: Effort) -> Result<Vec<Values>> {
        let window = if effort == Effort::Quick { WINDOW / 10 } else { WINDOW };
        let name = format!("{}-bridge", namespace.robot());
        let body = Body::start(&format!("{name}-body"), self.lidar)?;
        let launch = body.launch_file(&name, (SETTLE + window).as_secs_f64());
        let files = [("launch.toml", &*launch), ("controller.toml", CONTROLLER)];
        let running = Running::start(&name, &files, Cores::Any)?;
        clock::nap(SETTLE);
        let bridge = running.processes().into_iter().find(|(name, _)| name == "turtlebot3");
        let bridge = bridge.map_or(0, |(_, process)| process);
        let processes = [bridge, body.child.id()];
        let (before, begun) = (processes.map(processor_time), clock::now());
        clock::nap(window);
        let (after, ended) = (processes.map(processor_time), clock::now());
        let report = running.finish()?.report;

        let absent = |what: &str| Error::Fault(format!("the bridge does not tell {what}"));
        let mut values = Vec::new();
        for (what, figure, topic) in FIGURES {
            let count = report["topics"][topic]["sent"].as_u64().unwrap_or_default();
            let told = summed(&report, "turtlebot3", figure, count);
            values.push(told.ok_or_else(|| absent(what))?);
        }
        for (before, after) in before.into_iter().zip(after) {
            let used = after.zip(before).map(|(after, before)| after - before);
            let used = used.ok_or_else(|| absent("its processor time"))?;
            values.push(Values::One(100.0 * used / ended.since(begun).as_nanos() as f64));
        }
        Ok(values)
    }
}

/// The emulated robot. Told to end, and its files removed, when dropped.
struct Body {
    directory: PathBuf,
    child: Child,
}

impl Body {
    fn start(name: &str, lidar: &str) -> Result<Self> {
        let directory = write(name, &[("world.toml", WORLD)])?;
        let mut command = own()?;
        command.args(["emulate", "turtlebot3", "--calibration=0.1", "--lidar", lidar]);
        command.arg("--ports").arg(directory.join("ports"));
        command.arg("--world").arg(directory.join("world.toml"));
        command.stdin(Stdio::null()).stdout(Stdio::null());
        let child = command.spawn().map_err(failed(&directory))?;
        let body = Self { directory, child };
        let until = clock::now().after(PATIENCE);
        while !body.port("lidar").exists() {
            if until < clock::now() {
                return Err(Error::Fault("the emulated robot does not come up".to_owned()));
            }
            clock::nap(POLL);
        }
        Ok(body)
    }

    fn port(&self, name: &str) -> PathBuf {
        self.directory.join("ports").join(name)
    }

    /// The launch file of a robot of this name that drives this body for so long.
    fn launch_file(&self, name: &str, length_s: f64) -> String {
        let (board, lidar) = (self.port("board"), self.port("lidar"));
        LAUNCH
            .replace("robot = \"burger\"", &format!("robot = \"{name}\"\nfor_s = {length_s}"))
            .replace("/dev/ttyACM0", &board.to_string_lossy())
            .replace("/dev/ttyUSB0", &lidar.to_string_lossy())
            .replace("controller/lab_robot.toml", "controller.toml")
    }
}

impl Drop for Body {
    fn drop(&mut self) {
        end(&mut self.child);
        remove(&self.directory);
    }
}
