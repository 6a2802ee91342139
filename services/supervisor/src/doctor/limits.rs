//! Judges what the system lets this user have: memory, priority, files, ports.

use super::finding::{Finding, Level, mebibytes};
use super::machine::{Group, Machine, User};
use super::needs::{MemoryLock, Needs, PortState, SerialPort};

/// What stands where the launch file would say what is needed.
const UNKNOWN_NEED: &str = "what is needed the launch file does not say";

/// [-] Every distribution's default; with less, somebody has lowered it.
const FILES_MIN: u64 = 1024;

/// Free shared memory against what the robot takes: a full one kills a running process.
pub(super) fn shared_memory(machine: &Machine, needs: Option<&Needs>) -> Finding {
    let what = "shared memory";
    let Some(space) = machine.shared_memory else {
        let found = "/dev/shm is not there, and so no robot can run";
        let command = as_root(&machine.user, "mount -t tmpfs -o mode=1777 tmpfs /dev/shm");
        return Finding::new(Level::Failure, what, found).mend(command);
    };
    let of = format!("{} free of {}", mebibytes(space.free), mebibytes(space.size));
    let Some(needs) = needs else { return Finding::ok(what, format!("{of}; {UNKNOWN_NEED}")) };
    let need = needs.shared_memory;
    let found = format!("{of}, {} needed", mebibytes(need));
    let level = match space.free {
        free if free < need => Level::Failure,
        free if free < 2 * need => Level::Warning,
        _ => return Finding::ok(what, found),
    };
    // What others hold stays theirs, and this robot gets twice its need.
    let size = (space.size.saturating_sub(space.free) + 2 * need).div_ceil(1 << 20);
    let command = format!("mount -o remount,size={size}M /dev/shm");
    Finding::new(level, what, found).mend(as_root(&machine.user, &command))
}

/// Whether a process could keep all its memory from being paged.
pub(super) fn memory_lock(machine: &Machine, needs: Option<&Needs>) -> Finding {
    let what = "locked memory";
    let wanted = needs.map_or(MemoryLock::IfAllowed, |needs| needs.memory_lock);
    let need = machine.own_memory + needs.map_or(0, |needs| needs.shared_memory);
    let limit = match machine.memory_lock_limit {
        _ if machine.user.ignores_memory_lock_limit => None,
        limit => limit,
    };
    let Some(limit) = limit else { return Finding::ok(what, "no limit") };
    let at_most = format!("{} at most, some {} needed", mebibytes(limit), mebibytes(need));
    let (level, found) = match wanted {
        _ if need <= limit => return Finding::ok(what, at_most),
        MemoryLock::None => {
            let found = format!("{} at most; no process locks any", mebibytes(limit));
            return Finding::ok(what, found);
        }
        MemoryLock::IfAllowed => (Level::Note, format!("{at_most}: pages may go to disk")),
        MemoryLock::Demanded => (Level::Warning, format!("{at_most} by `memory_lock = true`")),
    };
    Finding::new(level, what, found)
        .mend(raise_here(&machine.user, "memlock", "unlimited"))
        .mend(raise_for_good(&machine.user, "memlock", "unlimited"))
}

/// The priority that a process asks for, and the program that gives it.
pub(super) fn priority(machine: &Machine, needs: Option<&Needs>) -> Finding {
    let what = "real-time priority";
    let user = &machine.user;
    let limit = if user.ignores_priority_limit { 99 } else { machine.priority_limit };
    let Some(wanted) = needs.and_then(|needs| needs.priority) else {
        if limit == 0 {
            let found = "none is to be had, and no process asks for any";
            return Finding::note(what, found)
                .mend(raise_here(user, "rtprio", "20"))
                .mend(raise_for_good(user, "rtprio", "20"));
        }
        return Finding::ok(what, format!("{limit} at most, and no process asks for any"));
    };
    if !machine.has_chrt {
        let found = format!("{wanted} is asked for, which takes `chrt`, and that is not in PATH");
        let command = as_root(user, "apt-get install util-linux");
        return Finding::new(Level::Failure, what, found).mend(command);
    }
    let found = format!("{limit} at most, {wanted} asked for");
    if u64::from(wanted) <= limit {
        return Finding::ok(what, found);
    }
    let wanted = wanted.to_string();
    Finding::new(Level::Failure, what, found)
        .mend(raise_here(user, "rtprio", &wanted))
        .mend(raise_for_good(user, "rtprio", &wanted))
}

/// Files and sockets that a process may have open.
pub(super) fn open_files(machine: &Machine) -> Finding {
    let what = "open files";
    match machine.files_limit {
        None => Finding::ok(what, "no limit"),
        Some(limit) if limit < FILES_MIN => {
            let found = format!("{limit} in each process; {FILES_MIN} is usual");
            let files = FILES_MIN.to_string();
            Finding::warning(what, found)
                .mend(raise_here(&machine.user, "nofile", &files))
                .mend(raise_for_good(&machine.user, "nofile", &files))
        }
        Some(limit) => Finding::ok(what, format!("{limit} in each process")),
    }
}

/// Whether the robot's serial ports are there, and this user may open them.
pub(super) fn serial_ports(machine: &Machine, needs: Option<&Needs>) -> Finding {
    let what = "serial ports";
    let Some(needs) = needs else { return Finding::ok(what, UNKNOWN_NEED) };
    let Some(ports) = &needs.serial_ports else {
        return Finding::ok(what, "no process uses a serial port");
    };
    let user = &machine.user;
    let has = |state| ports.iter().any(|port| port.state == state);
    if ports.iter().all(|port| port.state == PortState::Open) {
        let [board, lidar] = ports.each_ref().map(|port| port.path.as_str());
        return Finding::ok(what, format!("{} may open {board} and {lidar}", user.name));
    }
    let found = ports.each_ref().map(|port| described(port, user)).join("; ");
    let mut finding = Finding::new(Level::Failure, what, found);
    if has(PortState::Absent) || has(PortState::NoPort) {
        finding = finding.mend("ls -l /dev/serial/by-id");
    }
    // Of a port that is not there yet nothing but the group can be told.
    let is_member = |group: &Group| user.id == 0 || user.groups.contains(&group.id);
    match &machine.dialout {
        None => finding.mend(as_root(user, "groupadd --system dialout")),
        Some(group) if is_member(group) && has(PortState::Forbidden) => {
            let rules = "/etc/udev/rules.d/";
            finding
                .mend(as_root(user, &format!("cp config/99-teseo-turtlebot3.rules {rules}")))
                .mend(as_root(user, "udevadm control --reload"))
                .mend(as_root(user, "udevadm trigger"))
        }
        Some(group) if is_member(group) => finding,
        Some(group) => {
            if !group.has_user {
                let command = format!("usermod -aG dialout {}", user.name);
                finding = finding.mend(as_root(user, &command));
            }
            finding.mend("newgrp dialout")
        }
    }
}

fn described(port: &SerialPort, user: &User) -> String {
    let SerialPort { key, path, state } = port;
    match state {
        PortState::Open => format!("{} may open {path}", user.name),
        PortState::Forbidden => format!("{} may not open {path}", user.name),
        PortState::NoPort => format!("{path} is no serial port: set `{key}` to the right one"),
        PortState::Absent => format!("{path} is not there: plug it in, or set `{key}`"),
    }
}

/// The command, for one who may not do it as they are.
pub(super) fn as_root(user: &User, command: &str) -> String {
    if user.id == 0 { command.to_owned() } else { format!("sudo {command}") }
}

/// For the shell that it is typed into and all that it starts, as `ulimit` does within the hard limit.
fn raise_here(user: &User, item: &str, value: &str) -> String {
    as_root(user, &format!("prlimit --pid $$ --{item}={value}"))
}

/// For every later session of the user; see limits.conf(5).
fn raise_for_good(user: &User, item: &str, value: &str) -> String {
    let tee = as_root(user, "tee -a /etc/security/limits.conf");
    format!("echo '{} - {item} {value}' | {tee}", user.name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::machine::Space;

    const MIB: u64 = 1 << 20;

    #[test]
    fn little_shared_memory_is_a_warning_and_too_little_a_failure() {
        let needs = Needs::usual();
        for (free, level, size) in [
            (63, Level::Ok, None),
            (8, Level::Ok, None),
            (7, Level::Warning, Some("size=65M")),
            (4, Level::Warning, Some("size=68M")),
            (3, Level::Failure, Some("size=69M")),
            (0, Level::Failure, Some("size=72M")),
        ] {
            let space = Space { size: 64 * MIB, free: free * MIB };
            let machine = Machine { shared_memory: Some(space), ..Machine::good() };
            let finding = shared_memory(&machine, Some(&needs));

            assert_eq!(finding.level, level, "{finding:?}");
            assert_eq!(finding.mend.is_empty(), size.is_none(), "{finding:?}");
            assert!(finding.mend.iter().all(|mend| mend.contains(size.unwrap_or_default())));
        }
        let machine = Machine { shared_memory: None, ..Machine::good() };
        assert_eq!(shared_memory(&machine, Some(&needs)).level, Level::Failure);
    }

    #[test]
    fn a_limit_of_locked_memory_matters_as_much_as_the_launch_file_says() {
        let (small, large) = (Some(8 * MIB), Some(64 * MIB));
        for (limit, wanted, level) in [
            (None, MemoryLock::Demanded, Level::Ok),
            (large, MemoryLock::Demanded, Level::Ok),
            (small, MemoryLock::None, Level::Ok),
            (small, MemoryLock::IfAllowed, Level::Note),
            (small, MemoryLock::Demanded, Level::Warning),
        ] {
            let machine = Machine { memory_lock_limit: limit, ..Machine::good() };
            let needs = Needs { memory_lock: wanted, ..Needs::usual() };
            let finding = memory_lock(&machine, Some(&needs));

            assert_eq!(finding.level, level, "{finding:?}");
            assert_eq!(finding.mend.is_empty(), level == Level::Ok, "{finding:?}");
        }
    }

    #[test]
    fn who_may_lock_all_memory_has_no_limit_of_it() {
        let mut machine = Machine { memory_lock_limit: Some(0), ..Machine::good() };
        machine.user.ignores_memory_lock_limit = true;

        assert_eq!(memory_lock(&machine, Some(&Needs::usual())).level, Level::Ok);
    }

    #[test]
    fn a_priority_that_is_not_to_be_had_is_a_failure() {
        for (limit, wanted, has_chrt, level) in [
            (0, None, false, Level::Note),
            (99, None, false, Level::Ok),
            (20, Some(20), true, Level::Ok),
            (19, Some(20), true, Level::Failure),
            (99, Some(20), false, Level::Failure),
        ] {
            let machine = Machine { priority_limit: limit, has_chrt, ..Machine::good() };
            let needs = Needs { priority: wanted, ..Needs::usual() };
            let finding = priority(&machine, Some(&needs));

            assert_eq!(finding.level, level, "{finding:?}");
            assert_eq!(finding.mend.is_empty(), level == Level::Ok, "{finding:?}");
        }
    }

    #[test]
    fn few_open_files_are_a_warning() {
        for (limit, level) in
            [(None, Level::Ok), (Some(1024), Level::Ok), (Some(256), Level::Warning)]
        {
            let machine = Machine { files_limit: limit, ..Machine::good() };
            assert_eq!(open_files(&machine).level, level, "{limit:?}");
        }
    }

    /// Needs of a robot whose board's port was found so.
    fn needs(state: PortState) -> Needs {
        let port = |key, path: &str, state| SerialPort { key, path: path.to_owned(), state };
        let board = port("board_port", "/dev/ttyACM0", state);
        let lidar = port("lidar_port", "/dev/ttyUSB0", PortState::Open);
        Needs { serial_ports: Some([board, lidar]), ..Needs::usual() }
    }

    #[test]
    fn who_may_not_open_a_port_is_told_what_gives_it() {
        let (usermod, udev) = ("sudo usermod -aG dialout ada", "sudo udevadm trigger");
        for (state, is_member, is_entered, mend) in [
            (PortState::Open, false, false, None),
            (PortState::Forbidden, false, false, Some(usermod)),
            (PortState::Forbidden, false, true, Some("newgrp dialout")),
            (PortState::Forbidden, true, true, Some(udev)),
            // Whoever plugs it in later is told now.
            (PortState::Absent, false, false, Some(usermod)),
            (PortState::Absent, true, true, Some("ls -l /dev/serial/by-id")),
        ] {
            let mut machine = Machine::good();
            machine.dialout = Some(Group { id: 20, has_user: is_entered });
            if !is_member {
                machine.user.groups.remove(&20);
            }
            let finding = serial_ports(&machine, Some(&needs(state)));

            assert_eq!(finding.level == Level::Ok, mend.is_none(), "{finding:?}");
            let is_told = mend.is_none_or(|mend| finding.mend.contains(&mend.to_owned()));
            assert!(is_told, "{finding:?}");
            assert_eq!(finding.mend.is_empty(), mend.is_none(), "{finding:?}");
        }
    }

    #[test]
    fn a_port_that_is_not_there_or_none_is_named_with_its_parameter() {
        for (state, what) in [
            (PortState::Absent, "/dev/ttyACM0 is not there: plug it in, or set `board_port`"),
            (PortState::NoPort, "/dev/ttyACM0 is no serial port: set `board_port`"),
        ] {
            let finding = serial_ports(&Machine::good(), Some(&needs(state)));
            assert_eq!(finding.level, Level::Failure);
            assert!(finding.found.starts_with(what), "{finding:?}");
            assert!(finding.found.ends_with("; ada may open /dev/ttyUSB0"), "{finding:?}");
        }
    }

    #[test]
    fn without_a_launch_file_nothing_is_said_to_fail() {
        let machine = Machine::good();
        for finding in [
            shared_memory(&machine, None),
            memory_lock(&machine, None),
            priority(&machine, None),
            serial_ports(&machine, None),
        ] {
            assert_eq!(finding.level, Level::Ok, "{finding:?}");
        }
    }
}
