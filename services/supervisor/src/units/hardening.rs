//! What a unit's processes cannot do: everything that they do not need (systemd.exec(5)). All of it
//! was tried with data flowing; `systemd-analyze security` gives the marks.

use std::collections::BTreeSet;
use std::path::Path;

use node::Result;
use node::launch::Process;

use super::unit::Unit;
use super::{Robot, escape};

/// All of the robot's processes are of one user, whose shared memory nobody else can touch. It is
/// made once (`useradd --system`): one made for each unit would take the shared memory with it.
pub(super) const USER: &str = "robot";

/// The service that speaks to a robot of metal.
const BRIDGE: &str = "turtlebot3";

/// The motors' controller and the LiDAR, as the bridge's machine numbers them.
const SERIAL_PORTS: [&str; 2] = ["/dev/ttyACM0", "/dev/ttyUSB0"];

/// What else would be hidden from the unit's processes, though their program may lie there.
const HIDDEN: [&str; 5] = ["/home", "/root", "/run/user", "/tmp", "/var/tmp"];

/// What some processes need, and others must not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Need {
    /// The serial ports of a robot of metal.
    SerialPorts,
    /// A program that is none of ours may speak to the network, or compile as it runs.
    Freedom,
    /// Control groups to put processes into.
    Supervision,
    /// Processes' priorities and processors.
    Scheduling,
}

/// The needs of one node.
pub(super) fn needs_of(process: &Process) -> BTreeSet<Need> {
    let needs =
        [(Need::SerialPorts, process.name == BRIDGE), (Need::Freedom, !process.is_managed())];
    needs.into_iter().filter(|(_, is_needed)| *is_needed).map(|(need, _)| need).collect()
}

/// The needs of a supervisor with all its nodes.
pub(super) fn needs_of_all(processes: &[Process]) -> BTreeSet<Need> {
    let mut needs: BTreeSet<_> = processes.iter().flat_map(needs_of).collect();
    needs.insert(Need::Supervision);
    let is_placed = |process: &Process| {
        process.cpu_scheduling_priority.is_some() || !process.cpu_affinity.is_empty()
    };
    if processes.iter().any(is_placed) {
        needs.insert(Need::Scheduling);
    }
    needs
}

/// Writes it all; `paths` are what the processes read beside the system.
pub(super) fn harden(
    unit: &mut Unit,
    robot: &Robot,
    needs: &BTreeSet<Need>,
    paths: &[&Path],
) -> Result {
    for_everybody(unit, needs);
    if !robot.is_user {
        by_the_system(unit, needs);
        devices(unit, needs);
        show(unit, paths)?;
    }
    Ok(())
}

/// What a user's systemd can do too.
fn for_everybody(unit: &mut Unit, needs: &BTreeSet<Need>) {
    unit.set("NoNewPrivileges", "yes");
    unit.set("LockPersonality", "yes");
    unit.set("RestrictNamespaces", "yes");
    unit.set("RestrictSUIDSGID", "yes");
    if !needs.contains(&Need::Scheduling) {
        unit.set("RestrictRealtime", "yes");
    }
    if !needs.contains(&Need::Freedom) {
        unit.set("MemoryDenyWriteExecute", "yes");
        unit.set("RestrictAddressFamilies", "AF_UNIX");
    }
    unit.set("SystemCallArchitectures", "native");
    unit.set("SystemCallFilter", "@system-service");
    let refused =
        if needs.contains(&Need::Scheduling) { "~@privileged" } else { "~@privileged @resources" };
    unit.set("SystemCallFilter", refused);
    unit.set("SystemCallErrorNumber", "EPERM");
    unit.set("UMask", "0077");
    unit.set("LimitCORE", "0");
    unit.because("A node in real time keeps its memory from being paged.");
    unit.set("LimitMEMLOCK", "infinity");
}

/// What takes the system's own systemd.
fn by_the_system(unit: &mut Unit, needs: &BTreeSet<Need>) {
    unit.set("User", USER);
    unit.because("With yes, the end of the user's last unit would take all shared memory along.");
    unit.set("RemoveIPC", "no");
    unit.set("OOMScoreAdjust", out_of_memory_score(needs));
    unit.set("CapabilityBoundingSet", "");
    unit.set("AmbientCapabilities", "");
    unit.set("ProtectSystem", "strict");
    unit.set("ProtectHome", "tmpfs");
    unit.because("The transport's files are below /run, so that all units see the same.");
    unit.set("PrivateTmp", "yes");
    unit.set("PrivateIPC", "yes");
    unit.set("ProtectKernelTunables", "yes");
    unit.set("ProtectKernelModules", "yes");
    unit.set("ProtectKernelLogs", "yes");
    if !needs.contains(&Need::Supervision) {
        unit.set("ProtectControlGroups", "yes");
    }
    unit.set("ProtectClock", "yes");
    unit.set("ProtectHostname", "yes");
    unit.set("ProtectProc", "invisible");
    unit.set("KeyringMode", "private");
    if !needs.contains(&Need::Freedom) {
        unit.set("ProcSubset", "pid");
        unit.set("PrivateNetwork", "yes");
        unit.set("IPAddressDeny", "any");
    }
}

/// The kernel takes the robot's other processes before the one that can stop the wheels.
fn out_of_memory_score(needs: &BTreeSet<Need>) -> i32 {
    if needs.contains(&Need::Supervision) {
        -800
    } else if needs.contains(&Need::SerialPorts) {
        -900
    } else if needs.contains(&Need::Freedom) {
        0
    } else {
        -500
    }
}

fn devices(unit: &mut Unit, needs: &BTreeSet<Need>) {
    if !needs.contains(&Need::SerialPorts) {
        unit.set("PrivateDevices", "yes");
        unit.set("PrivateUsers", "yes");
        return;
    }
    // Not PrivateUsers=: in a name space of users the group is nobody's.
    unit.set("SupplementaryGroups", "dialout");
    unit.set("DevicePolicy", "closed");
    for port in SERIAL_PORTS {
        unit.set("DeviceAllow", format!("{port} rw"));
    }
}

/// Shows the directories of `paths` where the unit would not see them.
fn show(unit: &mut Unit, paths: &[&Path]) -> Result {
    let mut directories = BTreeSet::new();
    for directory in paths.iter().filter_map(|path| path.parent()) {
        if HIDDEN.iter().any(|hidden| directory.starts_with(hidden)) {
            directories.insert(escape::word(escape::plain(directory)?));
        }
    }
    for directory in directories {
        unit.set("BindReadOnlyPaths", directory);
    }
    Ok(())
}
