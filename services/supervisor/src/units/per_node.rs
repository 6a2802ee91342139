//! The robot as a unit for each node, with systemd as its supervisor.
//!
//! The units are a chain in the order of start. Each is bound to the one before it, to stop with it,
//! and upholds the one after it, which so starts again. Upheld from the target alone a chain of
//! three stays down: whoever is to start would have to stop.

use std::collections::BTreeMap;
use std::path::PathBuf;

use node::config::{Report, Table};
use node::launch::{Kind, Launch, Process, Restart, Strategy};
use node::{Clock, Error, Result};

use super::hardening::{harden, needs_of};
use super::unit::Unit;
use super::{File, Robot, escape};
use crate::shim;
use crate::supervise::PAIRING;

/// `Upholds=` is of version 249.
const SYSTEMD_MIN: u32 = 249;

/// `RestartSteps=`, `RestartMaxDelaySec=` and `RestartMode=` are of version 254.
const SYSTEMD_STEPS: u32 = 254;

/// [ms] Two lives of a node that begin in the same tenth of a second would have the same epoch.
const RESTART_DELAY_MIN_MS: u64 = 100;

/// [-] Steps up: process, configured, active.
const STEPS: u64 = 3;

/// Refuses what systemd cannot do with a unit for each node.
pub(super) fn check(launch: &Launch, systemd: u32, report: &mut Report<'_>) {
    let help = "leave out --per-node: `teseo up` can do it";
    if systemd < SYSTEMD_MIN {
        let message = format!("takes `Upholds=`, which systemd {systemd} does not have");
        report.refuse("process", message, help);
    }
    if launch.clock == Clock::Lockstep {
        report.refuse("clock", "in lock-step a run has an end, which no unit can give it", help);
        return;
    }
    for (index, process) in launch.process.iter().enumerate() {
        let key = |key: &str| format!("process[{index}].{key}");
        if process.restart == Restart::Never {
            let message = "the robot cannot end with this one: its unit would be upheld";
            report.refuse(key("restart"), message, "say \"on-failure\", or leave out --per-node");
        }
        let is_strange =
            |value: &&String| value.contains(|c: char| c.is_control() && c != '\n' && c != '\t');
        for (name, _) in process.environment.iter().filter(|(_, value)| is_strange(value)) {
            let message = "systemd bears no control characters in it";
            report.refuse(key(&format!("environment.{name}")), message, help);
        }
    }
}

/// What is other than the launch file says.
pub(super) fn notes(launch: &Launch, systemd: u32) -> Vec<String> {
    let note = |process: &Process| {
        let name = &process.name;
        match process.strategy {
            Strategy::RestForOne => None,
            Strategy::All => Some(format!(
                "{name}: those that start before it run on when it fails: systemd starts again \
                 the rest only"
            )),
            Strategy::OneForOne if restarts_alone(launch, process, systemd) => None,
            Strategy::OneForOne => Some(format!(
                "{name}: all that start after it start again with it: to leave them takes \
                 systemd {SYSTEMD_STEPS}, and nobody that requires it"
            )),
        }
    };
    launch.process.iter().filter_map(note).collect()
}

/// Whether nobody else need notice that it starts again, and systemd can do it so.
fn restarts_alone(launch: &Launch, process: &Process, systemd: u32) -> bool {
    let is_required = launch.process.iter().any(|other| other.requires.contains(&process.name));
    process.strategy == Strategy::OneForOne && !is_required && SYSTEMD_STEPS <= systemd
}

/// The name of a node's unit. The full stop is in no name of a robot or a node, so that no two pairs
/// of them have the same unit, nor a node that of a robot.
pub(super) fn service(robot: &Robot, node: &str) -> String {
    format!("{}.{node}.service", robot.name())
}

/// The target, and the chain in the order of start.
pub(super) fn files(robot: &Robot) -> Result<Vec<File>> {
    let mut chain = vec![pairing()];
    chain.extend(robot.launch.start_order().into_iter().cloned());
    let mut files = vec![target(robot, &chain)];
    for index in 0..chain.len() {
        files.push(node(robot, &chain, index)?);
    }
    Ok(files)
}

/// What the launch file does not call a process: under `teseo up` it is a part of the supervisor.
fn pairing() -> Process {
    Process {
        drives: false,
        name: PAIRING.to_owned(),
        exec: Vec::new(),
        kind: Kind::Lifecycle,
        wait: None,
        parameters_file: None,
        parameters: Table::default(),
        faults: Table::default(),
        after: Vec::new(),
        requires: Vec::new(),
        restart: Restart::OnFailure,
        strategy: Strategy::RestForOne,
        restart_delay_ms: 100,
        restart_delay_max_ms: 5_000,
        restart_steps: 5,
        start_limit_burst: 5,
        start_limit_interval_s: 30,
        start_timeout_ms: 10_000,
        stop_timeout_ms: 2_000,
        watchdog_ms: Some(1_000),
        environment: BTreeMap::new(),
        cpu_affinity: Vec::new(),
        cpu_scheduling_priority: None,
        memory_lock: None,
    }
}

fn target(robot: &Robot, chain: &[Process]) -> File {
    let mut unit = Unit::new(&robot.mark());
    unit.section("Unit");
    unit.set("Description", format!("The robot {}", robot.launch.robot));
    let all: Vec<_> = chain.iter().map(|process| service(robot, &process.name)).collect();
    unit.set("Wants", all.join(" "));
    unit.section("Install");
    unit.set("WantedBy", robot.wanted_by());
    File { name: format!("{}.target", robot.name()), text: unit.into_text() }
}

fn node(robot: &Robot, chain: &[Process], index: usize) -> Result<File> {
    let process = &chain[index];
    let name = service(robot, &process.name);
    let mut unit = Unit::new(&robot.mark());
    unit.section("Unit");
    let description = format!("The node {} of the robot {}", process.name, robot.launch.robot);
    unit.set("Description", description);
    unit.set("PartOf", format!("{}.target", robot.name()));
    if let Some(before) = index.checked_sub(1) {
        let before = service(robot, &chain[before].name);
        unit.set("BindsTo", &before);
        unit.set("After", &before);
    } else {
        unit.because("The same robot in the other shape.");
        unit.set("Conflicts", format!("{}.service", robot.name()));
        unit.set("After", format!("{}.service", robot.name()));
    }
    if let Some(after) = chain.get(index + 1) {
        unit.set("Upholds", service(robot, &after.name));
    }
    let (burst, interval) = start_limit(&chain[..=index]);
    unit.set("StartLimitIntervalSec", format!("{interval}s"));
    unit.set("StartLimitBurst", burst);
    unit.section("Service");
    let program = run(&mut unit, robot, process)?;
    if index == 0 {
        let clear = ["clear", "--robot", &robot.launch.robot].map(str::to_owned);
        unit.because(
            "The last to stop. Where others are still there it is refused, and that is right.",
        );
        unit.set("ExecStopPost", format!("-{}", escape::command(&robot.program, &clear)?));
    }
    restart(&mut unit, robot, process);
    placement(&mut unit, process);
    // No /dev/shm for the robot alone, though then nobody else could fill it: whoever looks at the
    // robot from a shell has to see what it shares.
    harden(&mut unit, robot, &needs_of(process), &[&robot.config, &robot.program, &program])?;
    Ok(File { name, text: unit.into_text() })
}

/// How often the last of `chain` may start, within how many seconds: as often as it may fail, and
/// all before it, for with each of those it starts again.
fn start_limit(chain: &[Process]) -> (u32, u64) {
    let burst = chain.iter().map(|process| process.start_limit_burst).sum();
    let interval = chain.iter().map(|process| process.start_limit_interval_s).max();
    (burst, interval.unwrap_or_default())
}

/// What runs, and how it is told; returns the program.
fn run(unit: &mut Unit, robot: &Robot, process: &Process) -> Result<PathBuf> {
    match process.kind {
        Kind::Lifecycle | Kind::Notify => {
            unit.set("Type", "notify");
            unit.set("NotifyAccess", "main");
        }
        Kind::Simple => unit.set("Type", "simple"),
    }
    let (program, mut arguments) = match process.exec.split_first() {
        Some((program, rest)) => (find(program)?, rest.to_vec()),
        None => (robot.program.clone(), vec![process.name.clone()]),
    };
    if process.is_managed() {
        arguments.push(format!("--config={}", escape::plain(&robot.config)?));
        arguments.push(format!("--name={}", process.name));
        arguments.push("--autostart".to_owned());
    }
    let clear = ["clear", "--robot", &robot.launch.robot, "--or-unfinished"].map(str::to_owned);
    unit.because("What a process leaves that is killed as it starts would be waited for.");
    unit.set("ExecStartPre", escape::command(&robot.program, &clear)?);
    unit.set("ExecStart", escape::command(&program, &arguments)?);
    unit.set("Environment", format!("TESEO_RUNTIME_DIR={}", robot.runtime_directory()));
    for (name, value) in &process.environment {
        unit.set("Environment", escape::word(&format!("{name}={value}")));
    }
    unit.set("RuntimeDirectory", super::RUNTIME);
    unit.set("RuntimeDirectoryMode", "0700");
    unit.because("The other nodes are still there when this one stops.");
    unit.set("RuntimeDirectoryPreserve", "yes");
    Ok(program)
}

fn find(program: &str) -> Result<PathBuf> {
    let found = shim::find_program(program).map_err(Error::Fault)?;
    std::path::absolute(&found).map_err(|cause| Error::File { path: found, cause })
}

/// When it is started again, and when it is taken to hang.
fn restart(unit: &mut Unit, robot: &Robot, process: &Process) {
    let is_always = process.restart == Restart::Always;
    unit.set("Restart", if is_always { "always" } else { "on-failure" });
    let delay = process.restart_delay_ms.max(RESTART_DELAY_MIN_MS);
    unit.set("RestartSec", format!("{delay}ms"));
    if SYSTEMD_STEPS <= robot.systemd && delay < process.restart_delay_max_ms {
        unit.set("RestartSteps", process.restart_steps);
        unit.set("RestartMaxDelaySec", format!("{}ms", process.restart_delay_max_ms));
    }
    if restarts_alone(&robot.launch, process, robot.systemd) {
        unit.set("RestartMode", "direct");
    }
    unit.set("RestartPreventExitStatus", "78 125");
    if let Some(limit) = process.watchdog_ms {
        unit.set("WatchdogSec", format!("{limit}ms"));
        unit.set("WatchdogSignal", "SIGKILL");
    }
    unit.set("TimeoutStartSec", format!("{}ms", STEPS * process.start_timeout_ms));
    unit.set("TimeoutStopSec", format!("{}ms", process.stop_timeout_ms));
    unit.set("KillMode", "control-group");
}

/// On which processors it runs, and before whom.
fn placement(unit: &mut Unit, process: &Process) {
    if !process.cpu_affinity.is_empty() {
        let cpus: Vec<_> = process.cpu_affinity.iter().map(usize::to_string).collect();
        unit.set("CPUAffinity", cpus.join(" "));
    }
    if let Some(priority) = process.cpu_scheduling_priority {
        unit.set("CPUSchedulingPolicy", "fifo");
        unit.set("CPUSchedulingPriority", priority);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;
    use crate::units::one_unit;

    /// The lab's robot with a change, as it would be installed.
    pub(in crate::units) fn robot(change: impl FnOnce(&mut Launch)) -> Robot {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/lab_robot.toml");
        let mut launch = Launch::read(Path::new(path), &[]).unwrap();
        change(&mut launch);
        Robot {
            launch,
            config: "/etc/teseo/robot.toml".into(),
            program: "/opt/teseo/teseo".into(),
            is_user: false,
            systemd: 252,
        }
    }

    /// The values of `key` in the unit `name`.
    fn values(files: &[File], name: &str, key: &str) -> Vec<String> {
        let file = files.iter().find(|file| file.name == name).unwrap();
        let lines = file.text.lines().filter_map(|line| line.split_once('='));
        lines.filter(|(other, _)| *other == key).map(|(_, value)| value.to_owned()).collect()
    }

    #[test]
    fn each_unit_is_bound_to_the_one_before_and_upholds_the_one_after() {
        let files = files(&robot(|_| {})).unwrap();

        let chain = ["pairing", "simulator", "odometry", "controller"];
        let chain = chain.map(|name| format!("teseo-burger.{name}.service"));
        let names: Vec<_> = files.iter().map(|file| file.name.as_str()).collect();
        assert_eq!(names[0], "teseo-burger.target");
        assert_eq!(names[1..], chain);
        assert_eq!(values(&files, names[0], "Wants"), [chain.join(" ")]);
        assert_eq!(values(&files, names[0], "Upholds"), [""; 0]);
        for pair in chain.windows(2) {
            assert_eq!(values(&files, &pair[0], "Upholds"), [pair[1].clone()]);
            assert_eq!(values(&files, &pair[1], "BindsTo"), [pair[0].clone()]);
            assert_eq!(values(&files, &pair[1], "After"), [pair[0].clone()]);
            assert_eq!(values(&files, &pair[1], "PartOf"), ["teseo-burger.target"]);
        }
    }

    #[test]
    fn no_two_robots_have_a_unit_of_the_same_name() {
        let of = |name: &str, node: &str| {
            let robot = robot(|launch| {
                launch.robot = name.to_owned();
                launch.process[2].name = node.to_owned();
            });
            let mut files = files(&robot).unwrap();
            files.push(one_unit::file(&robot).unwrap());
            files.into_iter().map(|file| file.name).collect::<Vec<_>>()
        };
        let all = [of("a-b", "c"), of("a", "b-c"), of("a-b-c", "d"), of("a-b-", "-c")].concat();
        let different: BTreeSet<_> = all.iter().collect();

        assert_eq!(different.len(), all.len(), "{all:?}");
    }

    #[test]
    fn a_unit_may_start_as_often_as_all_before_it_may_fail() {
        let files = files(&robot(|launch| launch.process[0].start_limit_interval_s = 60)).unwrap();

        let of = |name: &str, key| values(&files, &format!("teseo-burger.{name}.service"), key);
        assert_eq!(of("pairing", "StartLimitBurst"), ["5"]);
        assert_eq!(of("controller", "StartLimitBurst"), ["20"]);
        assert_eq!(of("pairing", "StartLimitIntervalSec"), ["30s"]);
        assert_eq!(of("controller", "StartLimitIntervalSec"), ["60s"]);
    }

    #[test]
    fn steps_of_the_restart_delay_are_for_a_systemd_that_knows_them() {
        let count = |systemd| {
            let files = files(&Robot { systemd, ..robot(|_| {}) }).unwrap();
            files.iter().filter(|file| file.text.contains("RestartSteps=")).count()
        };

        assert_eq!((count(253), count(254)), (0, 4));
    }

    #[test]
    fn one_alone_starts_again_where_systemd_can_do_it_and_nobody_requires_it() {
        let robot = robot(|launch| {
            launch.process[1].strategy = Strategy::OneForOne;
            launch.process[2].strategy = Strategy::OneForOne;
        });
        let files = files(&Robot { systemd: 254, ..robot }).unwrap();

        let mode = |name| values(&files, &format!("teseo-burger.{name}.service"), "RestartMode");
        assert_eq!(mode("odometry"), [""; 0], "the controller requires it");
        assert_eq!(mode("controller"), ["direct"]);
    }

    #[test]
    fn nothing_is_said_that_breaks_shared_memory_or_leaves_processes_behind() {
        let bridge = robot(|launch| launch.process[0].name = "turtlebot3".into());
        let user = Robot { is_user: true, ..robot(|_| {}) };
        let mut all = files(&bridge).unwrap();
        all.extend(files(&user).unwrap());
        all.push(one_unit::file(&bridge).unwrap());
        let never = ["DynamicUser=", "TemporaryFileSystem=", "KillMode=process", "RemoveIPC=yes"];

        for file in all {
            for directive in never {
                assert!(!file.text.contains(directive), "{directive} in {}", file.name);
            }
            let is_private = file.text.contains("PrivateTmp=yes");
            let is_elsewhere = file.text.contains("TESEO_RUNTIME_DIR=/run/teseo\n");
            assert!(!is_private || is_elsewhere, "{} hides the transport's files", file.name);
        }
    }
}
