//! The robot as one unit: `teseo up` supervises, systemd looks after the supervisor.

use std::path::PathBuf;

use node::Result;

use super::hardening::{harden, needs_of_all};
use super::unit::Unit;
use super::{File, Robot, escape, per_node};
use crate::shim;

/// [ms] What guardian and supervisor take for themselves, at the start and at the end.
const SPARE_MS: u64 = 5_000;

/// [-] Steps up, and as many down: process, configured, active.
const STEPS: u64 = 3;

pub(super) fn file(robot: &Robot) -> Result<File> {
    let mut unit = Unit::new(&robot.mark());
    unit.section("Unit");
    unit.set("Description", format!("The robot {}", robot.launch.robot));
    unit.because("The same robot in the other shape; the pairing is the last of it to stop.");
    let pairing = per_node::service(robot, crate::supervise::PAIRING);
    unit.set("Conflicts", format!("{}.target {pairing}", robot.name()));
    unit.set("After", pairing);
    unit.set("StartLimitIntervalSec", "5min");
    unit.set("StartLimitBurst", 3);
    unit.section("Service");
    run(&mut unit, robot)?;
    let programs = programs(robot);
    let mut paths = vec![robot.config.as_path(), robot.program.as_path()];
    paths.extend(programs.iter().map(PathBuf::as_path));
    let needs = needs_of_all(&robot.launch.process);
    let priorities =
        robot.launch.process.iter().filter_map(|process| process.cpu_scheduling_priority);
    if let Some(priority) = priorities.max() {
        unit.because("The supervisor gives processes their priority.");
        unit.set("LimitRTPRIO", priority);
    }
    harden(&mut unit, robot, &needs, &paths)?;
    unit.section("Install");
    unit.set("WantedBy", robot.wanted_by());
    Ok(File { name: format!("{}.service", robot.name()), text: unit.into_text() })
}

fn run(unit: &mut Unit, robot: &Robot) -> Result {
    let config = escape::plain(&robot.config)?.to_owned();
    unit.set("Type", "notify");
    unit.because("The main process is the guardian, and it is the supervisor that speaks.");
    unit.set("NotifyAccess", "all");
    unit.set("ExecStart", escape::command(&robot.program, &["up".to_owned(), config])?);
    unit.set("Environment", format!("TESEO_RUNTIME_DIR={}", robot.runtime_directory()));
    unit.set("Restart", "on-failure");
    unit.set("RestartSec", "1s");
    unit.because("What starting again does not mend: another holds the robot, its configuration.");
    unit.set("RestartPreventExitStatus", "5 78 125");
    unit.set("WatchdogSec", "1s");
    unit.set("WatchdogSignal", "SIGKILL");
    let processes = &robot.launch.process;
    let start: u64 = processes.iter().map(|process| STEPS * process.start_timeout_ms).sum();
    let stop: u64 = processes.iter().map(|process| STEPS * process.stop_timeout_ms).sum();
    unit.because("The supervisor gives up first: its time-outs know which node it is.");
    unit.set("TimeoutStartSec", format!("{}ms", start + SPARE_MS));
    unit.set("TimeoutStopSec", format!("{}ms", stop + SPARE_MS));
    unit.because("The guardian alone is asked to stop; whoever is left after it is killed.");
    unit.set("KillMode", "mixed");
    unit.set("Delegate", "yes");
    unit.set("RuntimeDirectory", super::RUNTIME);
    unit.set("RuntimeDirectoryMode", "0700");
    unit.because("Other robots' directories are there too.");
    unit.set("RuntimeDirectoryPreserve", "yes");
    Ok(())
}

/// The programs that are none of ours; `check` has found them all.
fn programs(robot: &Robot) -> Vec<PathBuf> {
    let named = robot.launch.process.iter().filter_map(|process| process.exec.first());
    let found = named.filter_map(|name| shim::find_program(name).ok());
    found.filter_map(|path| std::path::absolute(path).ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::super::per_node::tests::robot;
    use super::*;

    #[test]
    fn the_guardian_is_asked_to_stop_and_the_supervisor_is_heard() {
        let text = file(&robot(|_| {})).unwrap().text;

        for line in ["NotifyAccess=all", "KillMode=mixed", "Delegate=yes", "WatchdogSec=1s"] {
            assert!(text.lines().any(|other| other == line), "no {line} in\n{text}");
        }
        assert!(
            text.contains("\nExecStart=:/opt/teseo/teseo up /etc/teseo/robot.toml\n"),
            "{text}"
        );
    }

    #[test]
    fn the_supervisor_has_time_for_every_node_to_go_down() {
        let text = file(&robot(|launch| launch.process[2].stop_timeout_ms = 4_000)).unwrap().text;

        // Three steps of the third process, and as many of each of the two that take two seconds.
        assert!(text.contains("\nTimeoutStopSec=29000ms\n"), "{text}");
    }

    #[test]
    fn a_priority_takes_a_limit_and_the_leave_to_set_it() {
        let robot = robot(|launch| launch.process[2].cpu_scheduling_priority = Some(20));
        let text = file(&robot).unwrap().text;

        assert!(text.contains("\nLimitRTPRIO=20\n"), "{text}");
        assert!(!text.contains("RestrictRealtime") && !text.contains("@resources"), "{text}");
    }
}
