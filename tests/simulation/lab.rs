//! The lab's loop, without faults and in lock-step: does the robot come out of the labyrinth?

use controller::{Activity, Controller};
use interfaces::{JointState, LaserScan, Odometry};
use odometry::WheelOdometry;
use simulator::{Noise, Simulator, World};

use super::{CORRIDOR_FOLLOWING, LAB02};

const LAB_SIMULATION: &str = include_str!("../../config/controller/lab_simulation.toml");

/// [s] Simulated; three times what the slowest round trip takes.
const TIME_MAX: f64 = 400.0;

/// One drive, until the robot is back, has touched a wall, or has had enough time.
struct Drive {
    is_round_trip: bool,
    visited: Vec<usize>,
    seconds: f64,
    collisions: u64,
    /// [m] From the robot's edge.
    clearance_min: f64,
    commands_limited: u64,
}

#[test]
fn without_noise_the_lab_s_follower_makes_both_round_trips() {
    // An independent model of the lab: 94.5 s and 0.160 m from the centre, 126 s and 0.140 m.
    for (start, seconds, clearance) in [("outer", 94.5, 0.050), ("inner", 126.0, 0.034)] {
        for seed in 1..=4 {
            let trip = drive(LAB_SIMULATION, start, Noise::Ideal, 240, seed);
            assert_round_trip(&trip, &format!("SEED={seed}, {start}"));
            assert!((trip.seconds - seconds).abs() < 1.0, "SEED={seed}, {start}: {}", trip.seconds);
            assert!(clearance < trip.clearance_min, "SEED={seed}: {} m", trip.clearance_min);
        }
    }
}

#[test]
fn noise_drives_the_lab_s_follower_into_a_wall() {
    for start in ["outer", "inner"] {
        for seed in 1..=4 {
            let trip = drive(LAB_SIMULATION, start, Noise::Gazebo, 240, seed);
            assert!(0 < trip.collisions, "SEED={seed}, {start}: no longer as the lab describes it");
        }
    }
}

#[test]
fn no_noise_makes_the_corridor_follower_touch_a_wall() {
    for start in ["outer", "inner"] {
        for noise in [Noise::Ideal, Noise::Gazebo, Noise::Lds01] {
            for seed in 1..=4 {
                let trip = drive(CORRIDOR_FOLLOWING, start, noise, 240, seed);
                let name = format!("SEED={seed}, {start}, {noise:?}");
                assert_round_trip(&trip, &name);
                // The corridor leaves 0.093 m on each side.
                assert!(0.08 < trip.clearance_min, "{name}: {} m", trip.clearance_min);
                assert_eq!(trip.commands_limited, 0, "{name}: the wheels could not follow");
            }
        }
    }
}

#[test]
fn the_corridor_follower_needs_no_particular_number_of_beams() {
    for beams in [60, 231, 360, 460, 1440] {
        let trip = drive(CORRIDOR_FOLLOWING, "inner", Noise::Lds01, beams, 1);
        assert_round_trip(&trip, &format!("SEED=1, {beams} beams"));
    }
}

#[test]
fn the_same_seed_makes_the_same_trip() {
    let end = |seed| {
        let trip = drive(CORRIDOR_FOLLOWING, "inner", Noise::Gazebo, 240, seed);
        (trip.seconds.to_bits(), trip.clearance_min.to_bits())
    };
    assert_eq!(end(1), end(1));
    assert_ne!(end(1), end(2));
}

#[track_caller]
fn assert_round_trip(trip: &Drive, name: &str) {
    assert_eq!(trip.collisions, 0, "{name}: touched a wall after {} s", trip.seconds);
    assert!(trip.is_round_trip, "{name}: not back, but at {:?}", trip.visited);
    let out_and_back: Vec<usize> = (0..16).chain((0..15).rev()).collect();
    assert_eq!(trip.visited, out_and_back, "{name}");
}

fn drive(profile: &str, start: &str, noise: Noise, beams: usize, seed: u64) -> Drive {
    let world: World = toml::from_str(LAB02).unwrap();
    let mut config = simulator::Config { start: start.into(), seed, ..Default::default() };
    config.lidar.noise = noise;
    config.lidar.beams = beams;
    let dt = config.dt_s;
    let mut simulator = Simulator::new(&config, &world).unwrap();

    let profile: controller::Config = toml::from_str(profile).unwrap();
    let mut controller = Controller::new(&controller::Config { seed, ..profile }).unwrap();

    let mut scan = LaserScan::default();
    let mut joint_state = JointState::default();
    let mut wheels = WheelOdometry::new(&odometry::Config::default());
    let mut odometry = Odometry::default();
    let (mut linear, mut angular) = (0.0, 0.0);
    loop {
        simulator.step(linear, angular);
        simulator.fill_joint_state(&mut joint_state);
        simulator.sense(&mut scan);
        wheels.update(&joint_state, &mut odometry).unwrap();

        let command = controller.update(&scan, &odometry).unwrap();
        (linear, angular) = (command.linear, command.angular);
        assert_ne!(controller.activity(), Activity::Blind, "SEED={seed}");

        let seconds = simulator.steps() as f64 * dt;
        let is_round_trip = simulator.progress().is_round_trip();
        if is_round_trip || 0 < simulator.collisions() || TIME_MAX < seconds {
            return Drive {
                is_round_trip,
                visited: simulator.progress().visited().to_vec(),
                seconds,
                collisions: simulator.collisions(),
                clearance_min: simulator.clearance_min(),
                commands_limited: simulator.commands_limited(),
            };
        }
    }
}
