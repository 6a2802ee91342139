//! Random kills at random moments, from one seed: nothing survives, nothing is stuck, nothing is left.
//!
//! `SEED` and `KILLS` say which and how many; scripts/chaos has more of them.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

use node::clock;
use rustix::process::Signal;

use crate::random::{Random, number};
use crate::robot::{Process, Robot, Run, wait_until};

/// The robot that restarts what dies.
const LAB_ROBOT: &str = include_str!("../config/lab_robot.toml");

/// [-] Enough to meet each kind of process in each phase a few times.
const KILLS: u64 = 40;

/// A robot is ready again long before this, also on a busy machine.
const PATIENCE: Duration = Duration::from_secs(30);

/// The whole of a start, and some of the time after it.
const PHASE_MAX: Duration = Duration::from_millis(250);

/// What the supervisor says of it, behind the time and the name.
const BY_KILL: &str = "failed: was killed by signal 9";

/// As a shell says it: killed by signal 9.
const KILLED: i32 = 128 + 9;

#[test]
fn whatever_is_killed_whenever_nothing_survives_and_the_robot_comes_up_again() {
    let seed = number("SEED", 1);
    let mut random = Random(seed);
    let mut times = Times::default();
    let mut kills = 0;
    while kills < number("KILLS", KILLS) {
        let robot = Robot::new();
        let launch_file = tireless(&robot);
        // Some lives of the robot end in their first moments, some have nodes killed again and again.
        let mut run = robot.start_up(&[&launch_file]);
        loop {
            run = run.go_on(random.duration(PHASE_MAX));
            let victims = robot.processes();
            let Some(&victim) = victims.get(random.below(victims.len())) else { continue };
            kills += 1;
            let context = format!("SEED={seed}, kill {kills}: {:?}", victim.command());
            if is_guardian_or_supervisor(&run, victim) {
                end_by(&robot, run, victim, &mut times, &context);
                break;
            }
            run = outlive(run, victim, &mut times, &context);
            if random.below(8) == 0 {
                // The one ending that leaves nothing to the guardian.
                let code = run.signal(Signal::INT).wait().code;
                assert!([0, 6].contains(&code), "{context}: ended with {code}");
                break;
            }
        }
        robot.assert_nothing_left();
        times.robots += 1;
    }
    times.print(seed, kills);
}

// Not vacuous: with lab_robot.toml's own start limit a robot that was struck forty times a minute gave
// up, and the verb ended with 1.
#[test]
fn the_verb_tells_what_a_robot_did_after_each_blow_and_that_nothing_is_left() {
    let robot = Robot::new();
    let launch_file = tireless(&robot);
    let rates = ["--kills-per-minute=30", "--stops-per-minute=30", "--for=6", "--seed=3"];
    let sets = ["chaos", &launch_file, "--set=simulator.stop_at_collision=false"];
    // Beside the launch file's own robot.
    let other = robot.start_up(&[&launch_file]).await_count("READY", 1);
    let ended = robot.start(&[sets.as_slice(), &["--robot=waffle"], &rates].concat()).wait();
    other.stop();

    ended.assert_code(0).assert_says(&["seed 3: 6 blows: READY after them, nothing left"]);
    let told = ended.out.lines().filter(|line| line.contains(" s  SIG")).count();
    assert_eq!(told, 6, "{}", ended.story());
    robot.assert_nothing_left();
}

#[test]
fn the_verb_takes_no_robot_whose_nodes_stay_down() {
    let robot = Robot::new();
    let ended = robot.start(&["chaos", "config/simulation.toml"]).wait();

    ended.assert_code(1).assert_says(&["`odometry` would not be started again"]);
    robot.assert_nothing_left();
}

/// Kills the guardian or the supervisor: nothing of the run survives, and the next `up` works.
fn end_by(robot: &Robot, run: Run<'_>, victim: Process, times: &mut Times, context: &str) {
    let is_guardian = run.process() == victim;
    let killed = clock::now();
    victim.signal(Signal::KILL);
    let ended = run.wait();
    assert_eq!(ended.code, KILLED, "{context}\n{}", ended.story());
    let gone = wait_until(PATIENCE, || robot.processes().is_empty());
    assert!(gone, "{context}: {:?} survive", robot.processes());
    let kind = if is_guardian { "guardian: nothing left" } else { "supervisor: nothing left" };
    times.add(kind, clock::now().since(killed));

    let launch_file = tireless(robot);
    let next = robot.start_up(&[&launch_file]).await_count("READY", 1);
    next.stop();
}

/// Kills a node: the robot is ready again without hands.
fn outlive<'a>(run: Run<'a>, victim: Process, times: &mut Times, context: &str) -> Run<'a> {
    let before = run.output();
    let killed = clock::now();
    victim.signal(Signal::KILL);
    // By what the supervisor says: a node that is just being started has not its own words yet.
    let run = run.await_count(BY_KILL, before.matches(BY_KILL).count() + 1);
    let name = last_killed(&run.output());
    let activation = format!("{name:<12} inactive -> active");
    let (was_active, was_ready) =
        (before.matches(&activation).count(), before.matches("READY").count());
    let run = run.await_count(&activation, was_active + 1);
    let active = clock::now().since(killed);
    let run = run.await_count("READY", was_ready + 1);
    if 0 < was_ready {
        times.add(&format!("{name}: active again"), active);
        times.add(&format!("{name}: ready again"), clock::now().since(killed));
    }
    assert!(!run.output().contains("gave up"), "{context}\n{}", run.output());
    run
}

fn last_killed(output: &str) -> String {
    let line = output.lines().rfind(|line| line.contains(BY_KILL)).unwrap_or_default();
    line.split_whitespace().nth(2).unwrap_or_default().to_owned()
}

fn is_guardian_or_supervisor(run: &Run<'_>, victim: Process) -> bool {
    // By descent and not by words: a node that is just being started still has the supervisor's.
    run.process() == victim || run.process().children().contains(&victim)
}

/// A robot that may fail as often as it likes, and does not hesitate.
fn tireless(robot: &Robot) -> String {
    let patient = "restart = \"on-failure\"\nstart_limit_burst = 3600\nrestart_delay_ms = 1\n\
                   restart_delay_max_ms = 1\nstart_timeout_ms = 3000";
    robot.launch_file_from(LAB_ROBOT, &[("restart = \"on-failure\"", patient)])
}

/// How long things took, by what they were.
#[derive(Default)]
struct Times {
    robots: u64,
    by_kind: BTreeMap<String, Vec<Duration>>,
}

impl Times {
    fn add(&mut self, kind: &str, time: Duration) {
        self.by_kind.entry(kind.to_owned()).or_default().push(time);
    }

    fn print(&mut self, seed: u64, kills: u64) {
        let mut table =
            format!("seed {seed}: {kills} kills of {} robots, nothing left\n", self.robots);
        let head = "| killed: until | n | p50 ms | p99 ms | max ms |\n|---|--:|--:|--:|--:|\n";
        table.push_str(head);
        for (kind, times) in &mut self.by_kind {
            times.sort();
            let at = |percent: usize| times[(times.len() - 1) * percent / 100].as_secs_f64() * 1e3;
            let (count, p50, p99, max) = (times.len(), at(50), at(99), at(100));
            let _ = writeln!(table, "| {kind} | {count} | {p50:.1} | {p99:.1} | {max:.1} |");
        }
        println!("{table}");
    }
}
