//! Judges the machine itself: its processors, its clock, and what runs it.

use node::Clock;

use super::finding::{Finding, Level};
use super::limits::as_root;
use super::machine::Machine;
use super::needs::Needs;

/// Which systemd has all that our units use.
const SYSTEMD_FULL: u32 = 254;

/// The first user who is a person; the shared memory of others survives their logout.
const REGULAR_USER: u32 = 1000;

/// Whether the processors are there that processes are bound to.
pub(super) fn processors(machine: &Machine, needs: Option<&Needs>) -> Finding {
    let what = "processors";
    let present: Vec<_> = machine.processors.iter().map(usize::to_string).collect();
    let present = format!("{} ({})", present.len(), present.join(" "));
    let bound = needs.map(|needs| needs.processors.iter()).into_iter().flatten();
    let absent: Vec<_> = bound
        .filter(|(processor, _)| !machine.processors.contains(processor))
        .map(|(processor, process)| format!("`{process}` on {processor}"))
        .collect();
    if absent.is_empty() {
        return Finding::ok(what, present);
    }
    let found = format!("{present}; `cpu_affinity` puts {}, which is not there", absent.join(", "));
    let last = machine.processors.last().copied().unwrap_or_default();
    let help = format!("cpu_affinity = [{last}]   # in the launch file, or leave it out");
    Finding::new(Level::Failure, what, found).mend(help)
}

/// Whether each process that keeps a processor while it waits can have one. Where they cannot, a chain
/// of three took a hundred times as long as one that sleeps (`teseo bench loop` shows it).
pub(super) fn waiting(machine: &Machine, needs: Option<&Needs>) -> Finding {
    let what = "waiting";
    let Some(needs) = needs else { return Finding::ok(what, "no launch file to judge") };
    let (pollers, processors) = (&needs.pollers, machine.processors.len());
    // One is for all that do not poll, the supervisor's own among them.
    if pollers.len() < processors || pollers.is_empty() {
        return Finding::ok(what, format!("{} of {processors} processors are kept", pollers.len()));
    }
    let found = format!(
        "`{}` keep looking, on {processors} processors: they take them from each other",
        pollers.join("`, `")
    );
    let better = match needs.clock {
        Clock::Realtime => "block",
        Clock::Lockstep => "yield",
    };
    Finding::warning(what, found).mend(format!("wait = \"{better}\"   # in the launch file"))
}

/// Whether processors run as fast as they can, and do not have to notice first that they should.
pub(super) fn governor(machine: &Machine) -> Finding {
    let what = "frequency scaling";
    let governors: Vec<_> = machine.governors.iter().map(String::as_str).collect();
    match governors[..] {
        [] => Finding::ok(what, "no frequency scaling to be seen"),
        ["performance"] => Finding::ok(what, "performance"),
        _ => Finding::warning(what, format!("{}: a loop wakes up slowly", governors.join(", ")))
            .mend(as_root(&machine.user, "cpupower frequency-set -g performance")),
    }
}

/// Whether the clock is read without asking the kernel.
pub(super) fn clock_source(machine: &Machine) -> Finding {
    let what = "clock source";
    match machine.clock_source.as_deref() {
        None => Finding::note(what, "none to be seen")
            .mend("cat /sys/devices/system/clocksource/clocksource0/available_clocksource"),
        Some(slow @ ("hpet" | "acpi_pm" | "jiffies" | "refined-jiffies")) => {
            let file = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
            let tee = as_root(&machine.user, &format!("tee {file}"));
            Finding::warning(what, format!("{slow}, which is slow to read"))
                .mend(format!("echo tsc | {tee}"))
        }
        Some(source) => Finding::ok(what, source),
    }
}

/// What generated units can use.
pub(super) fn systemd(machine: &Machine) -> Finding {
    let what = "systemd";
    let Some(version) = machine.systemd else {
        return Finding::note(what, "not there: `teseo up` does without, `teseo units` does not")
            .mend(as_root(&machine.user, "apt-get install systemd"));
    };
    let runs = if machine.is_systemd_running { "" } else { ", but it does not run this machine" };
    let found = format!("version {version}{runs}");
    if version < SYSTEMD_FULL {
        let lacks = "without RestartSteps=, RestartMaxDelaySec= and RestartMode=direct";
        let found = format!("{found}; {lacks} (from {SYSTEMD_FULL} on)");
        return Finding::note(what, found).mend(format!("teseo units --systemd {version}"));
    }
    if !machine.is_systemd_running {
        return Finding::note(what, found).mend("teseo up -d   # instead of units");
    }
    Finding::ok(what, found)
}

/// Whether the robot's shared memory survives the end of an SSH session.
pub(super) fn logout(machine: &Machine) -> Finding {
    let what = "logout";
    let user = &machine.user;
    if !machine.is_systemd_running {
        return Finding::ok(what, "no logind runs that would remove shared memory");
    }
    if !machine.logind_removes {
        return Finding::ok(what, "RemoveIPC=no: shared memory stays");
    }
    if user.id < REGULAR_USER {
        return Finding::ok(what, format!("{} is no regular user: shared memory stays", user.name));
    }
    if user.lingers {
        return Finding::ok(what, format!("{} lingers: shared memory stays", user.name));
    }
    let found = format!(
        "RemoveIPC=yes: a robot that runs on loses its shared memory at {}'s last logout",
        user.name
    );
    let command = format!("loginctl enable-linger {}", user.name);
    Finding::warning(what, found).mend(as_root(user, &command))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn a_processor_that_is_not_there_is_a_failure_which_names_it() {
        let bound = BTreeSet::from([(1, "odometry".to_owned()), (999, "controller".to_owned())]);
        let needs = Needs { processors: bound, ..Needs::usual() };
        let finding = processors(&Machine::good(), Some(&needs));

        assert_eq!(finding.level, Level::Failure);
        assert!(finding.found.contains("`controller` on 999"), "{}", finding.found);
        assert!(!finding.found.contains("odometry"), "{}", finding.found);
        assert_eq!(processors(&Machine::good(), Some(&Needs::usual())).level, Level::Ok);
    }

    #[test]
    fn more_pollers_than_processors_to_spare_are_a_warning() {
        let processors = Machine::good().processors.len();
        for (count, clock, level, better) in [
            (0, Clock::Realtime, Level::Ok, ""),
            (processors - 1, Clock::Realtime, Level::Ok, ""),
            (processors, Clock::Realtime, Level::Warning, "block"),
            (processors + 2, Clock::Lockstep, Level::Warning, "yield"),
        ] {
            let pollers = (0..count).map(|index| format!("p{index}")).collect();
            let finding =
                waiting(&Machine::good(), Some(&Needs { clock, pollers, ..Needs::usual() }));

            assert_eq!(finding.level, level, "{finding:?}");
            assert!(finding.mend.concat().contains(better), "{finding:?}");
        }
    }

    #[test]
    fn any_governor_but_performance_is_a_warning() {
        for (governors, level) in [
            (&[][..], Level::Ok),
            (&["performance"], Level::Ok),
            (&["powersave"], Level::Warning),
            (&["performance", "schedutil"], Level::Warning),
        ] {
            let governors = governors.iter().map(|&name| name.to_owned()).collect();
            let finding = governor(&Machine { governors, ..Machine::good() });

            assert_eq!(finding.level, level, "{finding:?}");
            assert_eq!(finding.mend.is_empty(), level == Level::Ok, "{finding:?}");
        }
    }

    #[test]
    fn a_slow_clock_is_a_warning() {
        for (source, level) in [
            (Some("tsc"), Level::Ok),
            (Some("kvm-clock"), Level::Ok),
            (Some("arch_sys_counter"), Level::Ok),
            (Some("hpet"), Level::Warning),
            (Some("acpi_pm"), Level::Warning),
            (Some("jiffies"), Level::Warning),
            (None, Level::Note),
        ] {
            let clock = source.map(str::to_owned);
            let finding = clock_source(&Machine { clock_source: clock, ..Machine::good() });
            assert_eq!(finding.level, level, "{finding:?}");
        }
    }

    #[test]
    fn an_old_systemd_is_a_note_which_says_what_it_lacks() {
        for (version, runs, level, text) in [
            (Some(257), true, Level::Ok, "257"),
            (Some(254), true, Level::Ok, "254"),
            (Some(253), true, Level::Note, "RestartSteps="),
            (Some(252), false, Level::Note, "does not run this machine"),
            (Some(257), false, Level::Note, "does not run this machine"),
            (None, false, Level::Note, "not there"),
        ] {
            let facts = (version, runs);
            let machine = Machine { systemd: version, is_systemd_running: runs, ..Machine::good() };
            let finding = systemd(&machine);

            assert_eq!(finding.level, level, "{facts:?}");
            assert!(finding.found.contains(text), "{finding:?}");
        }
    }

    #[test]
    fn only_a_regular_user_who_does_not_linger_loses_shared_memory() {
        for (id, lingers, removes, runs, level) in [
            (1000, false, true, true, Level::Warning),
            (1000, true, true, true, Level::Ok),
            (1000, false, false, true, Level::Ok),
            (1000, false, true, false, Level::Ok),
            (999, false, true, true, Level::Ok),
            (0, false, true, true, Level::Ok),
        ] {
            let mut machine = Machine::good();
            machine.user.id = id;
            machine.user.lingers = lingers;
            machine.logind_removes = removes;
            machine.is_systemd_running = runs;
            let finding = logout(&machine);

            assert_eq!(finding.level, level, "{finding:?}");
            assert_eq!(finding.mend.is_empty(), level == Level::Ok, "{finding:?}");
        }
    }
}
