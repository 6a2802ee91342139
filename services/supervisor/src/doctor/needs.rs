//! What a launch file asks of a machine.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use node::config::Parameters;
use node::launch::Launch;
use node::{Clock, Namespace, Wait};
use serde::Deserialize;

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
    /// The ports of the process that talks to a real robot, and whether each is there; `None` where
    /// there is no such process.
    pub(super) serial_ports: Option<BTreeMap<String, bool>>,
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

impl Needs {
    pub(super) fn of(launch: &Launch, ports: Option<Ports>) -> Self {
        let processes = || launch.process.iter();
        let bound = processes().flat_map(|process| {
            process.cpu_affinity.iter().map(|&cpu| (cpu, process.name.clone()))
        });
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
                let ports = [ports.board_port, ports.lidar_port];
                ports.map(|port| (port.clone(), Path::new(&port).exists())).into()
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
