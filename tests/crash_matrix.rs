//! The crash matrix: each process killed or stopped in each phase of a robot's life, in real time. When
//! the wheels stand still, how far they rolled meanwhile, when they move again, and what is left.
//!
//! `SEED` says which cells and moments, `CELLS` which cells by a part of their names, `RUNS` how often
//! each; scripts/crash-matrix runs all of them often, and makes the README's table.

mod cell;
mod table;

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use interfaces::{JointState, MotionState, Permission, Stamp, StopCause};
use node::{Session, clock};
use rustix::process::Signal;

use crate::emulated::{Emulated, FIRMWARE};
use crate::random::Random;
use crate::robot::{Process, Robot, Run, alone_with, wait_until};
use crate::witness::Witness;
use cell::{Body, Cell, Fault, Phase, Victim};
use table::Table;

/// The robot that restarts what dies.
const LAB_ROBOT: &str = include_str!("../config/lab_robot.toml");

/// [-] Of the cells, so many as a test has time for.
const CELLS: usize = 10;

/// [-] Robots at a time. They wait most of the time; three leave two processors quiet enough.
const ROBOTS: usize = 3;

/// The dead-man's time-out, and one that a busy machine keeps as well.
const TIMEOUT: (Duration, Duration) = (Duration::from_millis(200), Duration::from_secs(2));

/// The dead-man's default: for so long commands come before they move a robot that was stopped.
const REARM_AFTER: Duration = Duration::from_millis(500);

/// A hanging guardian or supervisor hangs for so long: longer than anything waits for it.
const HANG: Duration = Duration::from_secs(1);

/// Longer than it takes a measurement of moving wheels to be followed by one of wheels at rest.
const STILL_AFTER: Duration = Duration::from_millis(110);

/// [rad/s] Less than any command asks for.
const SPEED_MIN: f64 = 0.5;

/// A robot is down long before this, also on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);

/// What was measured, by name: times in milliseconds, ways in millimetres, and files.
type Figures = BTreeMap<String, f64>;

#[test]
fn whatever_dies_or_hangs_the_robot_stops_and_drives_on_where_it_may() {
    see_all(
        Body::Simulated,
        "crash_matrix::whatever_dies_or_hangs_the_robot_stops_and_drives_on_where_it_may",
    );
}

#[test]
fn whatever_dies_or_hangs_the_wheels_of_an_emulated_robot_stand_and_drive_on_where_they_may() {
    see_all(
        Body::Emulated,
        "crash_matrix::whatever_dies_or_hangs_the_wheels_of_an_emulated_robot_stand_and_drive_on_where_they_may",
    );
}

/// All that the environment asks for, with one of the robots, by the test of this name.
fn see_all(body: Body, test: &str) {
    let seed = number("SEED").unwrap_or(1);
    let runs = number("RUNS");
    let cells = chosen(body, seed);
    let jobs: Vec<_> = (0..runs.unwrap_or(1))
        .flat_map(|run| cells.iter().map(move |cell| (*cell, seed + run)))
        .collect();
    let Some((table, failures)) = measure(test, &jobs) else { return };
    println!("seed {seed}, {} runs of {} cells\n", jobs.len() / cells.len(), cells.len());
    println!("{}", table.print());
    assert_eq!(failures, [""; 0], "SEED={seed}");
    // A test that others run beside has no time to keep.
    let missed = if runs.is_some() { table.missed() } else { Vec::new() };
    assert_eq!(missed, [""; 0], "SEED={seed}: later than promised");
}

/// The cells that the environment names, or else a few that the seed does.
fn chosen(body: Body, seed: u64) -> Vec<Cell> {
    let mut cells = Cell::all(body);
    if let Ok(part) = std::env::var("CELLS") {
        cells.retain(|cell| cell.to_string().contains(&part));
        return cells;
    }
    let mut random = Random(seed);
    while number("RUNS").is_none() && CELLS < cells.len() {
        cells.swap_remove(random.below(cells.len()));
    }
    cells
}

fn number(name: &str) -> Option<u64> {
    Some(std::env::var(name).ok()?.parse().unwrap())
}

/// Does all `jobs`, a few at a time, each in a process of its own; returns what came of them, and what
/// went wrong. None in such a process.
fn measure(test: &str, jobs: &[(Cell, u64)]) -> Option<(Table, Vec<String>)> {
    let next = AtomicUsize::new(0);
    let table = Mutex::new(Table::default());
    let failures = Mutex::new(Vec::new());
    let is_alone = std::thread::scope(|scope| {
        let work = || {
            while let Some((cell, seed)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
                match catch_unwind(AssertUnwindSafe(|| run_alone(test, *cell, *seed))) {
                    Ok(None) => return true,
                    Ok(Some(figures)) => table.lock().unwrap().add(*cell, figures),
                    Err(_) => failures.lock().unwrap().push(format!("{cell}, SEED={seed}")),
                }
            }
            false
        };
        let others: Vec<_> = (1..ROBOTS).map(|_| scope.spawn(work)).collect();
        let is_alone = work();
        others.into_iter().any(|other| other.join().unwrap()) || is_alone
    });
    (!is_alone).then(|| (table.into_inner().unwrap(), failures.into_inner().unwrap()))
}

/// The same test once more, with one robot and one fault.
fn run_alone(test: &str, cell: Cell, seed: u64) -> Option<Figures> {
    let environment =
        [("SEED", seed.to_string()), ("RUNS", "1".to_owned()), ("CELLS", cell.to_string())];
    let output = alone_with(test, &environment, |robot| {
        let figures = Scene::new(robot, cell, seed).play();
        println!("\nfigures {}", serde_json::to_string(&figures).unwrap());
    })?;
    let figures = output.lines().find_map(|line| line.strip_prefix("figures ")).unwrap();
    Some(serde_json::from_str(figures).unwrap())
}

/// One robot to which one thing happens.
struct Scene<'a> {
    robot: &'a Robot,
    emulated: Option<Emulated<'a>>,
    cell: Cell,
    random: Random,
    launch_file: String,
    figures: Figures,
}

impl<'a> Scene<'a> {
    fn new(robot: &'a Robot, cell: Cell, seed: u64) -> Self {
        let number = Cell::all(cell.body).iter().position(|other| *other == cell).unwrap();
        let random = Random(seed << 8 | number as u64);
        // The first corner of the inner corridor is two seconds away.
        let (emulated, launch_file) = match cell.body {
            Body::Simulated => {
                let inner = ("start = \"outer\"", "start = \"inner\"");
                let impatient = ("watchdog_ms = 500", "watchdog_ms = 500\nstart_timeout_ms = 1000");
                (None, robot.launch_file_from(LAB_ROBOT, &[inner, impatient]))
            }
            Body::Emulated => {
                let emulated = Emulated::start(robot, &["--start", "inner"]);
                let impatient = ("watchdog_ms = 500", "watchdog_ms = 500\nstart_timeout_ms = 3000");
                let launch_file = emulated.launch_file(robot, &[impatient]);
                (Some(emulated), launch_file)
            }
        };
        Self { robot, emulated, cell, random, launch_file, figures: Figures::new() }
    }

    fn play(mut self) -> Figures {
        let run = self.robot.start_up(&[&self.launch_file]);
        if self.cell.is_at_rest() {
            self.play_at_rest(run);
        } else {
            self.play_in_motion(run);
        }
        if let Some(emulated) = self.emulated.take() {
            emulated.stop();
        }
        self.robot.assert_nothing_left();
        self.note("files", self.robot.files().len() as f64);
        self.figures
    }

    fn play_at_rest(&mut self, run: Run<'_>) {
        let cell = self.cell;
        let begun = wait_until(PATIENCE, || cell.has_begun(&run));
        assert!(begun, "{cell}: never came so far\n{}", run.output());
        let run = run.go_on(self.random.duration(cell.phase.length()));
        let was_ready = run.output().matches("READY").count();
        let victims = cell.processes(&run);
        let mut struck = strike(&victims, cell.fault);
        if cell.ends_the_run() {
            return self.see_nothing_left(run, struck);
        }
        let run = if cell.needs_hands() {
            let run = run.go_on(HANG);
            struck = revive(&victims);
            run
        } else {
            run
        };
        let run = run.await_count("READY", was_ready + 1);
        let session = Session::join(&self.robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        self.await_motion(&mut witness, struck);
        drop((witness, session));
        end(run);
    }

    fn play_in_motion(&mut self, run: Run<'_>) {
        let cell = self.cell;
        let run = run.await_count("READY", 1);
        let session = Session::join(&self.robot.namespace(), "witness", 1).unwrap();
        let mut witness = Witness::new(&session);
        let begun = witness.watch_until(|witness| {
            witness.wheels.last().is_some_and(|wheels| cell.phase.is_shown_by(wheels))
        });
        assert!(begun, "{cell}: never came so far\n{}", run.output());
        let victims = cell.processes(&run);
        let told = witness.told.len();
        let was_ready = run.output().matches("READY").count();
        if cell.phase == Phase::Stopping {
            run.process().signal(Signal::INT);
        }
        witness.watch_for(self.random.duration(cell.phase.length()));
        let mut struck = strike(&victims, cell.fault);

        if cell.stops_the_wheels() {
            self.see_stop(&run, &mut witness, told, struck);
        } else if !cell.has_wheels_left() {
            self.see_firmware_stop(struck);
        }
        if cell.needs_hands() {
            witness.watch_for(HANG);
            struck = revive(&victims);
        }
        if cell.ends_the_run() || cell.phase == Phase::Stopping {
            drop((witness, session));
            return self.see_nothing_left(run, struck);
        }
        if cell.victim == Victim::Guardian {
            let stop = witness.told[told..].iter().find(|state| is_stopped(state));
            assert_eq!(stop, None, "{cell}: what have the wheels to do with the guardian?");
        } else {
            if !cell.needs_hands() {
                let is_ready = |_: &Witness| was_ready < run.output().matches("READY").count();
                assert!(witness.watch_until(is_ready), "{cell}: never ready\n{}", run.output());
            }
            self.await_motion(&mut witness, struck);
            assert_still_while_held(&witness);
            assert_latched(&witness);
        }
        drop((witness, session));
        end(run);
    }

    /// The wheels are commanded to stop, and do.
    fn see_stop(&mut self, run: &Run<'_>, witness: &mut Witness, told: usize, struck: Stamp) {
        let is_held = |state: &MotionState| state.permission == Permission::Held as u8;
        let moves_on = |witness: &Witness| {
            // A node that came back before the dead-man's time was over has stopped nobody.
            !witness.told[told..].iter().any(is_stopped) && HANG < clock::now().since(struck)
        };
        let may_move_on = self.cell.may_move_on();
        let seen = witness.watch_until(|witness| {
            witness.told[told..].iter().any(is_held) || (may_move_on && moves_on(witness))
        });
        let newest = (witness.told.last(), witness.wheels.last());
        assert!(seen, "{}: never held, but {newest:?}\n{}", self.cell, run.output());
        let told = &witness.told[told..];
        let Some(stop) = told.iter().find(|state| is_stopped(state)) else { return };
        let held = told.iter().find(|state| is_held(state)).unwrap().header.stamp;

        let is_lost = stop.cause == StopCause::SupervisorLost as u8;
        let since = if is_lost { struck } else { stop.command_received };
        let silent = stop.header.stamp.since(since);
        let least = if stop.cause == StopCause::Silence as u8 { TIMEOUT.0 } else { Duration::ZERO };
        assert!(least <= silent && silent < TIMEOUT.1, "{}: stop after {silent:?}", self.cell);
        self.note(if is_lost { "lost" } else { "silent" }, milliseconds(silent));
        // The bridge says what it commanded, the emulated robot what its wheels did.
        let stood = self.emulated.as_ref().and_then(|emulated| emulated.await_stand(struck));
        self.note("standstill", milliseconds(stood.unwrap_or(held).since(struck)));
        self.note("way", 1e3 * witness.way(struck, held));
    }

    /// Nobody tells the wheels anything: where they are not gone with the simulator, the robot's own
    /// firmware stops them, or the bridge's next life.
    fn see_firmware_stop(&mut self, struck: Stamp) {
        let Some(emulated) = &self.emulated else { return };
        let Some(stood) = emulated.await_stand(struck) else { return };
        let after = stood.since(struck);
        // With what a busy machine adds to the emulator.
        assert!(after < FIRMWARE + Duration::from_secs(1), "{}: stand after {after:?}", self.cell);
        self.note("standstill", milliseconds(after));
    }

    /// The wheels move, as they may.
    fn await_motion(&mut self, witness: &mut Witness, struck: Stamp) {
        let first_motion = |witness: &Witness| {
            let newest = witness.told.last()?;
            let since = newest.header.stamp.max(struck);
            let is_it = |wheels: &&JointState| since <= wheels.header.stamp && is_moving(wheels);
            let is_armed = newest.permission == Permission::Armed as u8;
            witness.wheels.iter().find(is_it).filter(|_| is_armed).map(|wheels| wheels.header.stamp)
        };
        witness.watch_until(|witness| first_motion(witness).is_some());
        let newest = (witness.told.last(), witness.wheels.last());
        let rolling = first_motion(witness);
        let rolling = rolling.unwrap_or_else(|| panic!("never moves, but {newest:?}"));
        // Who came back before the dead-man's time was over has nothing to come back from.
        let never_stopped = self.cell.stops_the_wheels() && !self.figures.contains_key("way");
        if self.cell.is_at_rest() || !never_stopped {
            self.note("back", milliseconds(rolling.since(struck)));
        }
    }

    /// No process of the run lives, and the next run finds nothing that keeps it from coming up.
    fn see_nothing_left(&mut self, run: Run<'_>, struck: Stamp) {
        let ended = run.wait();
        let codes: &[i32] = if self.cell.ends_the_run() { &[128 + 9, 0, 6] } else { &[0, 3, 6] };
        assert!(codes.contains(&ended.code), "{}\n{}", self.cell, ended.story());
        let gone = wait_until(PATIENCE, || self.survivors().is_empty());
        assert!(gone, "{}: {:?} survive", self.cell, self.survivors());
        self.note("back", milliseconds(clock::now().since(struck)));
        self.note("before", self.robot.files().len() as f64);
        self.robot.start_up(&[&self.launch_file]).await_count("READY", 1).stop();
    }

    /// The robot's processes; the emulated body is none of them.
    fn survivors(&self) -> Vec<Process> {
        let mut processes = self.robot.processes();
        processes.retain(|process| !process.command().contains(&"emulate".to_owned()));
        processes
    }

    fn note(&mut self, name: &str, figure: f64) {
        self.figures.insert(name.to_owned(), figure);
    }
}

/// Held wheels do not move.
fn assert_still_while_held(witness: &Witness) {
    for states in
        witness.told.windows(2).filter(|states| states[0].permission == Permission::Held as u8)
    {
        let (held, next) = (states[0].header.stamp.after(STILL_AFTER), states[1].header.stamp);
        let is_meanwhile =
            |wheels: &&JointState| held < wheels.header.stamp && wheels.header.stamp < next;
        let moved = witness.wheels.iter().filter(is_meanwhile).find(|wheels| is_moving(wheels));
        assert_eq!(moved, None, "moved though held");
    }
}

/// Who was stopped moves again only after commands have come for long enough.
fn assert_latched(witness: &Witness) {
    let mut stopped = None;
    for state in &witness.told {
        let moment = state.header.stamp;
        if is_stopped(state) {
            stopped.get_or_insert(moment);
        } else if let Some(stop) = stopped.take() {
            assert!(REARM_AFTER <= moment.since(stop), "armed {:?} after", moment.since(stop));
        }
    }
}

fn is_stopped(state: &MotionState) -> bool {
    state.permission != Permission::Armed as u8
}

fn is_moving(wheels: &JointState) -> bool {
    wheels.velocity.iter().any(|speed| SPEED_MIN < speed.abs())
}

fn strike(victims: &[Process], fault: Fault) -> Stamp {
    let now = clock::now();
    for victim in victims {
        victim.signal(match fault {
            Fault::Kill => Signal::KILL,
            Fault::Stop => Signal::STOP,
        });
    }
    now
}

fn revive(victims: &[Process]) -> Stamp {
    let now = clock::now();
    for victim in victims {
        victim.signal(Signal::CONT);
    }
    now
}

/// Takes the robot down in order.
fn end(run: Run<'_>) {
    let ended = run.signal(Signal::INT).wait();
    ended.assert_code(0);
}

fn milliseconds(duration: Duration) -> f64 {
    1e3 * duration.as_secs_f64()
}
