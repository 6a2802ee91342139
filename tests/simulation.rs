//! The whole robot in one thread under simulated time, with faults drawn from a seed: what must never
//! happen, whatever goes wrong, and what must happen once nothing does any more.
//!
//! `SEED` and `SEEDS` say which and how many; scripts/soak has thousands of them.

mod lab;
mod plan;
mod processes;
mod referee;
mod robot;

use std::time::Duration;

use controller::Pacing;
use node::clock;

use crate::random::number;
use plan::{BEAMS, Plan};
use referee::Figures;
use robot::Robot;

const LAB02: &str = include_str!("../config/worlds/lab02.toml");
const CORRIDOR_FOLLOWING: &str = include_str!("../config/controller/corridor_following.toml");

/// [-] As many as take some twenty seconds of one core.
const SEEDS: u64 = 400;

/// [-] Of so many runs, some meet everything that is drawn.
const SEEDS_TELLING: usize = 100;

/// Five round trips: who was misled, or has been turned round, comes back before it sets out again.
const ROUND_TRIP_MAX: Duration = Duration::from_secs(320);

/// Seeds and beams of robots that turned on the spot, or pushed against a wall, until the end of time:
/// they believed in a corridor that was narrower than they were, or kept a course that no wall had.
const LOST: [(u64, usize); 10] = [
    (126, 60),
    (1364, 60),
    (3279, 60),
    (3896, 60),
    (117, 240),
    (508, 240),
    (541, 240),
    (609, 240),
    (1007, 240),
    (1320, 240),
];

/// How one run ended.
#[derive(Debug, Clone, Copy, PartialEq)]
struct End {
    /// From the first step to the last.
    elapsed: Duration,
    /// From the end of the faults, or the start of a run without any.
    back_after: Duration,
    distance: f64,
    clearance_min: f64,
    /// Where the rules allow them: see [`Robot::step`].
    collisions: u64,
    figures: Figures,
}

/// Safety at every step, and liveness once faults cease.
///
/// Each rule of the referee was seen to fail, with `SEED=…`, for this deliberate bug:
///
/// - moves without permission: a refused command taken for a sign of life; armed again after 100 ms
///   instead of 500; a stream that need not begin with zero; the emergency stop ignored; armed by
///   itself more than three times in a minute;
/// - driven by an invalid command: an old epoch heard; limits not looked at;
/// - leaves the ramp: brakes to zero at once;
/// - drives by a stale pair: the age of the pair, or of its samples, not looked at;
/// - commands what no wheel may do: NaN now and then;
/// - learns from a pair twice: samples no newer than before corrected by; odometry of NaN let through;
/// - is not back: a turn that never ends; a follower that begins anew and stands.
#[test]
fn no_fault_breaks_a_rule_and_once_faults_cease_the_robot_makes_its_round_trip() {
    let begun = clock::now();
    let first = number("SEED", 1);
    let seeds = first..first + number("SEEDS", SEEDS);
    let beams = usize::try_from(number("BEAMS", BEAMS as u64)).unwrap();
    let ends: Vec<End> = seeds.map(|seed| run(&Plan { beams, ..Plan::draw(seed) })).collect();
    let figures = ends.iter().fold(Figures::default(), |sum, end| sum + end.figures);
    if SEEDS_TELLING <= ends.len() {
        assert!(figures.all_happened(), "something is never drawn: {figures:?}");
    }

    let minutes = ends.iter().map(|end| end.elapsed.as_secs_f64() / 60.0).sum::<f64>();
    let taken = clock::now().since(begun).as_secs_f64() / 60.0;
    let touched = ends.iter().filter(|end| 0 < end.collisions).count();
    let slowest = ends.iter().map(|end| end.back_after.as_secs_f64()).fold(0.0, f64::max);
    println!(
        "{} runs from SEED={first}: {minutes:.0} min of driving, {:.0} a minute; back at most \
         {slowest:.0} s after the faults; {touched} touched a wall, misled or begun anew\n{figures:?}",
        ends.len(),
        minutes / taken,
    );
}

#[test]
fn robots_that_once_were_lost_for_ever_come_back() {
    for (seed, beams) in LOST {
        run(&Plan { beams, ..Plan::draw(seed) });
    }
}

#[test]
fn without_faults_every_command_is_obeyed_and_nobody_is_needed() {
    for start in ["outer", "inner"] {
        for pacing in [Pacing::EveryPair, Pacing::Timer] {
            let end = run(&Plan { start, pacing, ..Plan::faultless(1) });
            let undisturbed = Figures { valid: end.figures.valid, ..Figures::default() };
            assert_eq!(end.figures, undisturbed, "SEED=1, {start}, {pacing:?}");
            // The corridor leaves 0.093 m on each side.
            assert!(0.08 < end.clearance_min, "SEED=1, {start}, {pacing:?}: {end:?}");
        }
    }
}

#[test]
fn the_same_seed_is_the_same_run() {
    for seed in 1..=4 {
        assert_eq!(run(&Plan::draw(seed)), run(&Plan::draw(seed)), "SEED={seed}");
        assert_ne!(run(&Plan::draw(seed)), run(&Plan::draw(seed + 4)), "SEED={seed}");
    }
}

/// Runs until the faults are over and the robot has made its round trip.
fn run(plan: &Plan) -> End {
    let mut robot = Robot::new(plan);
    while robot.now < plan.cease || !robot.simulator.progress().is_round_trip() {
        robot.step();
        let is_in_time = robot.now.since(plan.cease) <= ROUND_TRIP_MAX;
        let visited = robot.simulator.progress().visited();
        robot.referee.hold(is_in_time, robot.now, "is not back", &visited);
    }
    End {
        elapsed: robot.elapsed(),
        back_after: robot.now.since(plan.cease),
        distance: robot.simulator.distance(),
        clearance_min: robot.simulator.clearance_min(),
        collisions: robot.simulator.collisions(),
        figures: robot.referee.figures,
    }
}
