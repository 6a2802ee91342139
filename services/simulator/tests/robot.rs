//! The robot as its process will use it: commands in, encoders and scans out.

use std::f64::consts::FRAC_PI_2;

use interfaces::{JointState, LEFT, LaserScan, Pose, RIGHT, Stamp};
use simulator::{Config, Error, LidarConfig, Noise, Simulator, WheelLimit, World};

const LAB02: &str = include_str!("../../../config/worlds/lab02.toml");

fn lab02() -> World {
    toml::from_str(LAB02).expect("lab02 is a world")
}

fn simulator(config: &Config) -> Simulator {
    Simulator::new(config, &lab02()).expect("the robot fits lab02")
}

/// Drives to the centre of each of these cells in turn, as somebody could who knows the truth.
fn drive_through(simulator: &mut Simulator, cells: &[[f64; 2]]) {
    for &[x, y] in cells {
        for _ in 0..2000 {
            let world_from_base = simulator.world_from_base();
            let ahead = world_from_base.inverse_transform_point(&[x, y].into());
            let (distance, bearing) = (ahead.coords.norm(), libm::atan2(ahead.y, ahead.x));
            if distance < 1e-3 {
                break;
            }
            if bearing.abs() > 0.01 {
                simulator.step(0.0, (bearing / 0.05).clamp(-2.0, 2.0));
            } else {
                simulator.step((distance / 0.05).min(0.2), 0.0);
            }
        }
    }
}

#[test]
fn out_through_all_cells_and_back_is_a_round_trip_without_a_collision() {
    for start in ["outer", "inner"] {
        let cells = lab02().starts[start].corridor_m.clone();
        let mut simulator = simulator(&Config { start: start.into(), ..Config::default() });

        drive_through(&mut simulator, &cells);
        assert_eq!(simulator.progress().reached(), 16, "{start}");
        assert!(!simulator.progress().is_round_trip(), "{start}");

        let back: Vec<[f64; 2]> = cells.into_iter().rev().collect();
        drive_through(&mut simulator, &back);
        let there_and_back: Vec<usize> = (0..16).chain((0..15).rev()).collect();
        assert!(simulator.progress().is_round_trip(), "{start}");
        assert_eq!(simulator.progress().visited(), there_and_back, "{start}");

        assert_eq!(simulator.collisions(), 0, "{start}");
        let clearance_min = simulator.clearance_min();
        assert!((0.08..0.1).contains(&clearance_min), "{start}: {clearance_min}");
        assert!(
            (12.0 - 0.1..12.0 + 0.1).contains(&simulator.distance()),
            "{}",
            simulator.distance()
        );
    }
}

#[test]
fn constant_wheel_speeds_make_an_exact_circle_whatever_the_step() {
    // A circle of 0.04 m about (0.96, -1.0), three quarters of it.
    for (dt_s, steps) in [(0.001, 10_000), (0.05, 200), (0.5, 20)] {
        let mut simulator = simulator(&Config { dt_s, ..Config::default() });
        let angular = 3.0 * FRAC_PI_2 / 10.0;
        for _ in 0..steps {
            simulator.step(0.04 * angular, angular);
        }
        let world_from_base = simulator.world_from_base();
        let (x, y) = (world_from_base.translation.x, world_from_base.translation.y);
        assert!((x - 0.96).abs() < 1e-12 && (y + 1.04).abs() < 1e-12, "{dt_s}: {x} {y}");
        assert!(world_from_base.rotation.angle().abs() < 1e-12, "{dt_s}");
        assert_eq!(simulator.time(), Stamp::from_nanoseconds(10_000_000_000));
    }
}

#[test]
fn the_robot_stops_at_the_wall_and_its_wheels_slip() {
    let mut simulator = simulator(&Config::default());
    // The wall ahead is 2.2 m from the start, and 0.2 m/s is 0.01 m per step.
    for _ in 0..300 {
        simulator.step(0.2, 0.0);
    }
    let y = simulator.world_from_base().translation.y;
    assert!((y - (1.2 - 0.105)).abs() < 1e-12, "{y}");
    assert!((simulator.distance() - 2.095).abs() < 1e-9, "{}", simulator.distance());
    assert!(simulator.clearance().abs() < 1e-12, "{}", simulator.clearance());
    assert_eq!(simulator.collisions(), 1);

    let mut joint_state = JointState::default();
    simulator.fill_joint_state(&mut joint_state);
    for side in [LEFT, RIGHT] {
        let rolled = joint_state.position[side] * 0.033;
        assert!((rolled - 3.0).abs() < 1e-4, "{rolled}");
    }
}

#[test]
fn the_encoders_tell_the_whole_way() {
    let mut simulator = simulator(&Config::default());
    let (mut turn, mut joint_state) = (0.0, JointState::default());
    for step in 0..2000 {
        simulator.step(0.0, if step % 7 < 5 { 0.37 } else { -0.1 });
        simulator.fill_joint_state(&mut joint_state);
        turn += 0.033 / 0.160 * (joint_state.increment[RIGHT] - joint_state.increment[LEFT]);
        let heading = simulator.world_from_base().rotation.angle();
        let error = libm::remainder(FRAC_PI_2 + turn - heading, 2.0 * std::f64::consts::PI);
        // One tick of one wheel is 0.316 mrad of heading.
        assert!(error.abs() < 0.000_317, "step {step}: {error}");
    }
}

#[test]
fn hold_and_scale_part_where_the_wheels_cannot_follow() {
    let mut ways = [WheelLimit::Hold, WheelLimit::Scale].map(|wheel_limit| {
        let mut simulator = simulator(&Config { wheel_limit, ..Config::default() });
        simulator.step(0.1, 0.0);
        simulator.step(0.2, 1.0);
        simulator
    });
    // Held: 0.1 m/s again. Scaled: 0.2 m/s and 1 rad/s by 0.22 / 0.28.
    assert_eq!(ways.each_mut().map(|simulator| simulator.commands_limited()), [1, 1]);
    let distances = ways.each_ref().map(Simulator::distance);
    assert!((distances[0] - 0.010).abs() < 1e-12, "{distances:?}");
    assert!((distances[1] - (0.005 + 0.010 * 0.22 / 0.28)).abs() < 1e-12, "{distances:?}");
    let headings = ways.map(|simulator| simulator.world_from_base().rotation.angle() - FRAC_PI_2);
    assert!(headings[0].abs() < 1e-12, "{headings:?}");
    assert!((headings[1] - 0.05 * 0.22 / 0.28).abs() < 1e-12, "{headings:?}");
}

/// Everything the robot says in a minute of driving, by its bits.
fn bits(noise: Noise, seed: u64) -> Vec<u64> {
    let lidar = LidarConfig { noise, ..LidarConfig::default() };
    let mut simulator = simulator(&Config { seed, lidar, ..Config::default() });
    let (mut scan, mut joint_state) = (LaserScan::default(), JointState::default());
    let mut bits = Vec::new();
    for step in 0..1200 {
        simulator.step(0.02, 0.3 * libm::sin(f64::from(step) * 0.01));
        simulator.fill_joint_state(&mut joint_state);
        simulator.sense(&mut scan);
        bits.extend(joint_state.position.map(f64::to_bits));
        bits.extend(scan.range.map(|range| u64::from(range.to_bits())));
    }
    bits
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_others() {
    for noise in [Noise::Gazebo, Noise::Lds01] {
        assert!(bits(noise, 42) == bits(noise, 42), "SEED=42 {noise:?}");
        assert!(bits(noise, 42) != bits(noise, 43), "SEED=42 {noise:?}");
    }
    assert!(bits(Noise::Ideal, 42) == bits(Noise::Ideal, 43), "without noise there is no chance");
}

#[test]
fn stamps_count_steps_and_do_not_drift() {
    for (dt_s, expected) in [(0.05, 5_000_000_000_000), (1.0 / 30.0, 3_333_333_333_333)] {
        let mut simulator = simulator(&Config { dt_s, ..Config::default() });
        assert_eq!(simulator.time(), Stamp::ZERO);
        for _ in 0..100_000 {
            simulator.step(0.0, 0.1);
        }
        let (mut scan, mut joint_state) = (LaserScan::default(), JointState::default());
        simulator.sense(&mut scan);
        simulator.fill_joint_state(&mut joint_state);
        let expected = Stamp::from_nanoseconds(expected);
        assert_eq!([simulator.time(), scan.header.stamp, joint_state.header.stamp], [expected; 3]);
    }
}

#[test]
fn sequence_and_epoch_belong_to_the_port() {
    let mut simulator = simulator(&Config::default());
    let (mut scan, mut joint_state) = (LaserScan::default(), JointState::default());
    for header in [&mut scan.header, &mut joint_state.header] {
        (header.sequence, header.epoch) = (7, 3);
    }
    simulator.sense(&mut scan);
    simulator.fill_joint_state(&mut joint_state);
    for header in [scan.header, joint_state.header] {
        assert_eq!((header.sequence, header.epoch), (7, 3));
    }
}

#[test]
fn the_goal_counts_only_for_who_knows_where_it_is() {
    let mut simulator = simulator(&Config { goal_m: Some([1.0, -0.5]), ..Config::default() });
    let estimate =
        |localized| Pose { x: 1.0, y: -0.5, yaw: FRAC_PI_2, localized, ..Pose::default() };
    for _ in 0..42 {
        simulator.check_estimate(&estimate(1));
        assert!(!simulator.is_goal_reached(), "at {}", simulator.world_from_base().translation.y);
        simulator.step(0.2, 0.0);
        if simulator.distance() > 0.4 {
            break;
        }
    }
    assert!(simulator.is_goal_reached());
    assert!(simulator.check_estimate(&estimate(0)).within);
    assert!(!simulator.is_goal_reached());
}

#[test]
fn a_robot_that_does_not_fit_its_world_is_refused() {
    let table = [
        (Config { start: "middle".into(), ..Config::default() }, "it has `inner`, `outer`"),
        (
            Config { robot_radius_m: 0.199, ..Config::default() },
            "0.001 m deep in box `inner_right`",
        ),
        (Config { dt_s: f64::NAN, ..Config::default() }, "`dt_s` is NaN"),
    ];
    for (config, message) in table {
        let error: Error = Simulator::new(&config, &lab02()).err().unwrap();
        assert!(error.to_string().contains(message), "{error}");
    }
}
