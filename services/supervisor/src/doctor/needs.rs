//! What a launch file asks of a machine.

use std::collections::BTreeSet;

use node::launch::Launch;
use node::{Clock, Namespace};

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
    /// Whether a process talks to a real robot.
    pub(super) serial_port: bool,
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

/// The service behind a serial port.
const BRIDGE: &str = "turtlebot3";

impl Needs {
    pub(super) fn of(launch: &Launch) -> Self {
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
        Self {
            robot: launch.robot.clone(),
            shared_memory: Namespace::need(launch),
            memory_lock,
            priority: processes().filter_map(|process| process.cpu_scheduling_priority).max(),
            processors: bound.collect(),
            serial_port: processes().any(|process| process.name == BRIDGE),
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
            serial_port: false,
        }
    }
}
