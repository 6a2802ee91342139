//! What a launch file asks of a machine.

use std::collections::BTreeSet;
use std::fs::{self, Metadata};
use std::os::unix::fs::{FileTypeExt, MetadataExt};

use node::config::Parameters;
use node::launch::Launch;
use node::{Clock, Namespace, Wait};
use rustix::fs::Access;
use serde::Deserialize;

use crate::supervise::PAIRING;

/// What a launch file asks of a machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Needs {
    pub(super) robot: String,
    /// [byte] Of shared memory, at the most.
    pub(super) shared_memory: u64,
    pub(super) memory_lock: MemoryLock,
    /// [-] The highest real-time priority; `None` where nobody has one.
    pub(super) priority: Option<u32>,
    /// The processors that processes are bound to, with the process.
    pub(super) processors: BTreeSet<(usize, String)>,
    /// Whether the wall's time is the robot's, and which processes keep a processor while they wait.
    pub(super) clock: Clock,
    pub(super) pollers: Vec<String>,
    /// The ports of the process that talks to a real robot; `None` where there is no such process.
    pub(super) serial_ports: Option<[SerialPort; 2]>,
}

/// One port, and how it was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct SerialPort {
    pub(super) key: &'static str,
    pub(super) path: String,
    pub(super) state: PortState,
}

/// Whether a port can be opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PortState {
    /// By this user.
    Open,
    /// Not by this user.
    Forbidden,
    /// It is a file of another kind.
    NoPort,
    /// Nothing is there.
    Absent,
}

/// Whether memory is to be kept from being paged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MemoryLock {
    /// By nobody.
    None,
    /// Where the limit allows it.
    IfAllowed,
    /// A process does not start without.
    Demanded,
}

/// The service behind serial ports.
pub(super) const BRIDGE: &str = "turtlebot3";

/// Where that looks for its board and its LiDAR.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(default)]
pub(super) struct Ports {
    board_port: String,
    lidar_port: String,
}

impl Default for Ports {
    fn default() -> Self {
        Self { board_port: "/dev/ttyACM0".to_owned(), lidar_port: "/dev/ttyUSB0".to_owned() }
    }
}

impl Parameters for Ports {}

impl PortState {
    /// Without opening it, which would disturb whoever uses it.
    fn of(path: &str) -> Self {
        match fs::metadata(path) {
            Err(_) => Self::Absent,
            Ok(file) if !is_terminal(&file) => Self::NoPort,
            Ok(_) if rustix::fs::access(path, Access::READ_OK | Access::WRITE_OK).is_ok() => {
                Self::Open
            }
            Ok(_) => Self::Forbidden,
        }
    }
}

/// Whether it is a terminal's device, which a serial port is, as far as the system tells.
fn is_terminal(file: &Metadata) -> bool {
    let (major, minor) = (rustix::fs::major(file.rdev()), rustix::fs::minor(file.rdev()));
    // A pseudo-terminal's, of which the system tells nothing there.
    let is_pseudo = (136..144).contains(&major);
    let device = fs::read_link(format!("/sys/dev/char/{major}:{minor}"));
    let is_other = device.is_ok_and(|device| !device.iter().any(|part| part == "tty"));
    file.file_type().is_char_device() && (is_pseudo || !is_other)
}

impl Needs {
    pub(super) fn of(launch: &Launch, ports: Option<Ports>) -> Self {
        let processes = || launch.process.iter();
        let pairing = (PAIRING, launch.pairing().cpu_affinity);
        let bound = processes()
            .map(|process| (process.name.as_str(), process.cpu_affinity.clone()))
            .chain([pairing])
            .flat_map(|(name, cpus)| cpus.into_iter().map(|cpu| (cpu, name.to_owned())));
        let memory_lock = if processes().any(|process| process.memory_lock == Some(true)) {
            MemoryLock::Demanded
        } else if launch.clock == Clock::Realtime
            && processes().any(|process| process.memory_lock.is_none())
        {
            MemoryLock::IfAllowed
        } else {
            MemoryLock::None
        };
        let pollers = processes().filter(|process| {
            process.is_managed() && matches!(launch.wait(Some(process)), Wait::Poll | Wait::Hybrid)
        });
        Self {
            robot: launch.robot.clone(),
            shared_memory: Namespace::need(launch),
            memory_lock,
            priority: processes().filter_map(|process| process.cpu_scheduling_priority).max(),
            processors: bound.collect(),
            clock: launch.clock,
            pollers: pollers.map(|process| process.name.clone()).collect(),
            serial_ports: processes().any(|process| process.name == BRIDGE).then(|| {
                let ports = ports.unwrap_or_default();
                [("board_port", ports.board_port), ("lidar_port", ports.lidar_port)]
                    .map(|(key, path)| SerialPort { key, state: PortState::of(&path), path })
            }),
        }
    }

    /// A robot in real time that asks for nothing unusual.
    #[cfg(test)]
    pub(super) fn usual() -> Self {
        Self {
            robot: "burger".to_owned(),
            shared_memory: 4 << 20,
            memory_lock: MemoryLock::IfAllowed,
            priority: None,
            processors: BTreeSet::new(),
            clock: Clock::Realtime,
            pollers: Vec::new(),
            serial_ports: None,
        }
    }
}
