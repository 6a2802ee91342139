//! The follower in scenes of a few walls.

use super::*;
use crate::scene::{Segment, scan, turned};

const LEFT: Segment = ([-3.0, 0.2], [0.2, 0.2]);
const RIGHT: Segment = ([-3.0, -0.2], [0.2, -0.2]);
const AHEAD: Segment = ([0.2, -3.0], [0.2, 3.0]);
/// The same two, ending where a side corridor begins.
const LEFT_OPEN: Segment = ([-3.0, 0.2], [-0.2, 0.2]);
const RIGHT_OPEN: Segment = ([-3.0, -0.2], [-0.2, -0.2]);
const LEFT_LONG: Segment = ([-3.0, 0.2], [3.0, 0.2]);
const RIGHT_LONG: Segment = ([-3.0, -0.2], [3.0, -0.2]);

fn follower(seed: u64) -> CorridorFollowing {
    CorridorFollowing::new(&CorridorConfig::default(), seed)
}

/// The turning speed and the angle still to turn, for a robot that sees this first.
fn first(walls: &[Segment], seed: u64) -> (f64, f64) {
    let mut follower = follower(seed);
    let motion = follower.update(&scan(walls, 0.0, 50), &turned(0.0, 50));
    (motion.angular, -follower.belief.heading.value)
}

#[test]
fn the_end_of_a_corridor_is_left_to_the_open_side_or_back() {
    let table = [
        ("left", [LEFT_OPEN, AHEAD, RIGHT], 1.5, FRAC_PI_2),
        ("right", [LEFT, AHEAD, RIGHT_OPEN], -1.5, -FRAC_PI_2),
    ];
    for (name, walls, angular, to_turn) in table {
        let (speed, angle) = first(&walls, 1);
        assert!((speed - angular).abs() < 1e-9, "{name}: {speed}");
        assert!((angle - to_turn).abs() < 0.02, "{name}: {angle}");
    }
    let (_, angle) = first(&[LEFT, AHEAD, RIGHT], 1);
    assert!((angle.abs() - PI).abs() < 0.02, "{angle}");
}

#[test]
fn at_a_junction_the_seed_chooses() {
    let choices: Vec<f64> =
        (0..20).map(|seed| first(&[LEFT_OPEN, AHEAD, RIGHT_OPEN], seed).0).collect();
    assert!(choices.contains(&1.5) && choices.contains(&-1.5), "{choices:?}");
}

#[test]
fn a_turn_goes_on_by_odometry_until_the_course_lies_ahead() {
    let mut follower = follower(1);
    let walls = [LEFT_OPEN, AHEAD, RIGHT];
    let mut yaw = 0.0;
    let mut milliseconds = 50;
    loop {
        let motion = follower.update(&scan(&walls, yaw, milliseconds), &turned(yaw, milliseconds));
        if motion.linear > 0.0 {
            break;
        }
        yaw += 0.05 * motion.angular;
        milliseconds += 50;
        assert!(milliseconds < 3000, "still turning at {yaw}");
    }
    assert!((yaw - FRAC_PI_2).abs() < 0.1, "{yaw}");
}

#[test]
fn a_robot_that_a_wall_beside_it_lets_go_neither_way_drives_away_from_the_wall() {
    let walls = [([-3.0, 0.11], [3.0, 0.11]), ([-3.0, -0.29], [3.0, -0.29])];
    for seed in 1..=10 {
        let mut follower = follower(seed);
        let (mut yaw, mut milliseconds) = (0.0, 0);
        loop {
            milliseconds += 50;
            let seen = scan(&walls, yaw, milliseconds);
            let motion = follower.update(&seen, &turned(yaw, milliseconds));
            if motion.linear > 0.0 {
                break;
            }
            yaw += 0.05 * motion.angular;
            assert!(milliseconds < 60_000, "{seed}: still turning at {yaw}");
        }
        assert!(libm::sin(yaw) < -0.9, "{seed}: {yaw}");
    }
}

#[test]
fn the_robot_steers_to_the_middle() {
    for beside in [-0.05, 0.05] {
        let shift = |([x0, y0], [x1, y1]): Segment| ([x0, y0 - beside], [x1, y1 - beside]);
        let walls = [LEFT_LONG, RIGHT_LONG].map(shift);
        let mut follower = follower(1);
        let motion = follower.update(&scan(&walls, 0.0, 50), &turned(0.0, 50));
        assert!((follower.belief.offset.value - beside).abs() < 2e-3, "{:?}", follower.belief);
        assert!(motion.angular * beside < 0.0, "{beside}: {motion:?}");
    }
}

#[test]
fn corridors_of_any_width_are_measured() {
    for width in [0.35, 0.4, 0.5, 0.6] {
        let walls = [
            ([-3.0, 0.5 * width], [3.0, 0.5 * width]),
            ([-3.0, -0.5 * width], [3.0, -0.5 * width]),
        ];
        let mut follower = follower(1);
        follower.update(&scan(&walls, 0.0, 50), &turned(0.0, 50));
        let measured = follower.belief.width.value;
        assert!((measured - width).abs() < 2e-3, "{width}: {measured}");
    }
}

#[test]
fn an_opening_on_one_side_is_not_taken_for_the_corridor() {
    let mut follower = follower(1);
    follower.update(&scan(&[LEFT_LONG, RIGHT_LONG], 0.0, 50), &turned(0.0, 50));

    let beyond = ([-3.0, 0.55], [3.0, 0.55]);
    for milliseconds in (100..1000).step_by(50) {
        let motion = follower
            .update(&scan(&[beyond, RIGHT_LONG], 0.0, milliseconds), &turned(0.0, milliseconds));
        assert!(motion.angular.abs() < 0.02, "{motion:?}");
    }
}

#[test]
fn a_narrower_place_is_believed_at_once() {
    let mut follower = follower(1);
    let wide = [([-3.0, 0.3], [3.0, 0.3]), ([-3.0, -0.3], [3.0, -0.3])];
    for milliseconds in (50..1000).step_by(50) {
        follower.update(&scan(&wide, 0.0, milliseconds), &turned(0.0, milliseconds));
    }
    for milliseconds in (1000..1200).step_by(50) {
        let narrow = scan(&[LEFT_LONG, RIGHT_LONG], 0.0, milliseconds);
        follower.update(&narrow, &turned(0.0, milliseconds));
    }
    assert!((follower.belief.width.value - 0.4).abs() < 0.02, "{:?}", follower.belief);
    assert!(follower.belief.offset.value.abs() < 0.01, "{:?}", follower.belief);
}

#[test]
fn walls_between_which_the_robot_would_not_fit_are_no_corridor() {
    let mut follower = follower(1);
    let near = [([-3.0, 0.1], [3.0, 0.1]), ([-3.0, -0.1], [3.0, -0.1])];
    follower.update(&scan(&near, 0.0, 50), &turned(0.0, 50));
    assert!((follower.belief.width.value - 0.4).abs() < 1e-9, "{:?}", follower.belief);
}

#[test]
fn a_robot_that_steers_hard_drives_slower_so_that_its_wheels_can_follow() {
    let wheel_max = CorridorConfig::default().wheel_speed_max_m_s;
    for yaw in [-0.5, -0.3, 0.0, 0.3, 0.5] {
        let mut follower = follower(1);
        follower.update(&scan(&[LEFT_LONG, RIGHT_LONG], yaw, 50), &turned(0.0, 50));
        if let Some(last) = &mut follower.last {
            last.motion.linear = 0.2;
        }
        let seen = scan(&[LEFT_LONG, RIGHT_LONG], yaw, 100);
        let motion = follower.update(&seen, &turned(0.0, 100));
        assert!(motion.angular.abs() > 2.0 * yaw.abs(), "{yaw}: {motion:?}");
        assert!(motion.linear > 0.09, "{yaw}: {motion:?}");
        assert!(motion.linear + 0.08 * motion.angular.abs() <= wheel_max, "{yaw}: {motion:?}");
    }
}

#[test]
fn a_skewed_start_is_noticed() {
    for yaw in [-0.7, 0.3, 0.7] {
        let mut follower = follower(1);
        follower.update(&scan(&[LEFT_LONG, RIGHT_LONG], yaw, 50), &turned(0.0, 50));
        let heading = follower.belief.heading.value;
        assert!((heading - yaw).abs() < 0.05, "{yaw}: {heading}");
    }
}

#[test]
fn a_wrong_course_is_given_up_for_the_one_that_the_whole_scan_shows() {
    for wrong in [-0.7, -0.5, 0.5, 0.7] {
        let mut follower = follower(1);
        follower.update(&scan(&[LEFT_LONG, RIGHT_LONG], 0.0, 0), &turned(0.0, 0));
        follower.belief.heading.value = wrong;
        for milliseconds in (50..10_000).step_by(50) {
            let seen = scan(&[LEFT_LONG, RIGHT_LONG], 0.0, milliseconds);
            follower.update(&seen, &turned(0.0, milliseconds));
        }
        let heading = follower.belief.heading.value;
        assert!(heading.abs() < 0.02, "{wrong}: {heading}");
    }
}

#[test]
fn odometry_alone_moves_the_belief_and_nonsense_does_not() {
    let corridor = scan(&[LEFT_LONG, RIGHT_LONG], 0.0, 50);
    let mut follower = follower(1);
    follower.update(&corridor, &turned(3.1, 50));
    follower.update(&corridor, &turned(-3.1, 100));
    let turned_by = 2.0 * PI - 6.2;
    assert!((follower.belief.heading.value - turned_by).abs() < 1e-3);

    follower.update(&corridor, &turned(f64::NAN, 150));
    follower.update(&corridor, &turned(-3.0, 200));
    assert!((follower.belief.heading.value - turned_by - 0.1).abs() < 1e-3);

    for (index, x) in [(0, f64::MAX), (1, -f64::MAX), (2, 0.0)] {
        follower.update(&corridor, &Odometry { x, ..turned(-3.0, 250 + 50 * index) });
    }
    assert!(follower.belief.offset.value.abs() < 1e-3);
}

#[test]
fn a_scan_older_than_the_odometry_is_turned_with_it() {
    let mut follower = follower(1);
    let mut odometry = turned(0.0, 50);
    follower.update(&scan(&[LEFT_LONG, RIGHT_LONG], 0.0, 50), &odometry);

    // Turning at 1 rad/s; the scan was taken 0.1 s and 0.1 rad earlier.
    odometry = turned(0.2, 250);
    odometry.angular = 1.0;
    follower.update(&scan(&[LEFT_LONG, RIGHT_LONG], 0.1, 150), &odometry);
    assert!((follower.belief.heading.value - 0.2).abs() < 2e-3, "{:?}", follower.belief);
}

#[test]
fn after_a_long_gap_the_robot_looks_anew() {
    let mut follower = follower(1);
    follower.update(&scan(&[LEFT_OPEN, AHEAD, RIGHT], 0.0, 50), &turned(0.0, 50));
    assert_eq!(follower.state, State::Turn);

    follower.update(&scan(&[LEFT_LONG, RIGHT_LONG], 0.0, 1100), &turned(2.0, 1100));
    assert_eq!(follower.state, State::Follow);
    assert!(follower.belief.heading.value.abs() < 0.01);
}

#[test]
fn the_robot_brakes_before_a_wall_and_starts_gently() {
    let speed = |front: f64, before: f64| {
        let mut follower = follower(1);
        follower.update(&scan(&[LEFT_LONG, RIGHT_LONG], 0.0, 50), &turned(0.0, 50));
        if let Some(last) = &mut follower.last {
            last.motion.linear = before;
        }
        let ahead = ([front, -0.2], [front, 0.2]);
        let seen = scan(&[LEFT_LONG, RIGHT_LONG, ahead], 0.0, 100);
        follower.update(&seen, &turned(0.0, 100)).linear
    };
    assert!((speed(0.7, 0.2) - 0.2).abs() < 0.005);
    assert!((speed(0.7, 0.0) - 0.02).abs() < 1e-9);
    // 0.02 m before the place where it turns: sqrt(2 * 0.4 * 0.02).
    assert!((speed(0.22, 0.2) - 0.126).abs() < 0.01);
}
