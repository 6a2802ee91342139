//! The lab's wall follower, formula by formula: four states and proportional-derivative control.

use std::time::Duration;

use interfaces::{LaserScan, Stamp};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::{Activity, Distances, Motion, WallConfig, is_wall};

/// [-] Beams on each side of a window's middle.
const WINDOW_HALF: usize = 5;

/// A scan that follows so closely is the same one, stamped twice: the rate of an error between the
/// two would be noise, divided by almost nothing.
const PERIOD_MIN: Duration = Duration::from_millis(1);

/// The lab's follower and its memory.
#[derive(Debug, Clone)]
pub(crate) struct WallFollowing {
    config: WallConfig,
    random: ChaCha8Rng,
    state: State,
    errors: Errors,
    last: Option<Last>,
}

/// A wall to follow, by its side of the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wall {
    Left,
    Right,
}

/// What the robot is doing; a turn to one side ends at the wall of the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Along this wall.
    Front { wall: Wall },
    /// In place, clockwise, to follow the left wall.
    TurnRight,
    /// In place, counterclockwise, to follow the right wall.
    TurnLeft,
    /// Straight ahead, whatever is seen, until then.
    FixedFront { wall: Wall, until: Stamp },
}

/// The scan before this one, and what was made of it.
#[derive(Debug, Clone, Copy)]
struct Last {
    stamp: Stamp,
    epoch: u32,
    motion: Motion,
}

/// [m] From the sensor to the nearest wall in three directions.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Seen {
    front: f64,
    left: f64,
    right: f64,
}

/// [m] How far each wall is from where it should be; positive where the robot must turn left.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Errors {
    left: f64,
    right: f64,
}

impl WallFollowing {
    pub(crate) fn new(config: &WallConfig, seed: u64) -> Self {
        Self {
            config: config.clone(),
            random: ChaCha8Rng::seed_from_u64(seed),
            state: State::Front { wall: Wall::Right },
            errors: Errors::default(),
            last: None,
        }
    }

    /// Goes on by other speeds, gains and distances.
    pub(crate) fn retune(&mut self, config: &WallConfig) {
        self.config = config.clone();
    }

    /// The motion for this scan; for one no newer than the last, the last motion, unchanged.
    pub(crate) fn update(&mut self, scan: &LaserScan) -> Motion {
        let (stamp, epoch) = (scan.header.stamp, scan.header.epoch);
        let last = self.last.filter(|last| last.epoch == epoch);
        if let Some(last) = last
            && stamp.since(last.stamp) < PERIOD_MIN
        {
            return last.motion;
        }

        let dt = last.map(|last| stamp.since(last.stamp));
        let motion = self.step(stamp, dt, &look(&self.config, scan));
        self.last = Some(Last { stamp, epoch, motion });
        motion
    }

    /// The next scan is compared with none before it.
    pub(crate) fn forget(&mut self) {
        self.last = None;
    }

    pub(crate) fn activity(&self) -> Activity {
        match self.state {
            State::Front { .. } => Activity::Following,
            State::TurnRight => Activity::TurningRight,
            State::TurnLeft => Activity::TurningLeft,
            State::FixedFront { .. } => Activity::LeavingTurn,
        }
    }

    /// One period of the state machine; a state that is over leaves the period to the next.
    /// `dt` is absent before there is a scan to compare with.
    fn step(&mut self, stamp: Stamp, dt: Option<Duration>, seen: &Seen) -> Motion {
        match self.state {
            State::Front { wall } => {
                let wall = self.nearer(wall, seen);
                if seen.front <= self.config.front_threshold_m {
                    self.state = self.decide(seen);
                    Motion::STOP
                } else {
                    self.state = State::Front { wall };
                    self.follow(wall, dt, seen)
                }
            }
            State::TurnRight => {
                if self.has_turned(seen) {
                    self.state = self.after_turn(Wall::Left, stamp);
                    self.step(stamp, dt, seen)
                } else {
                    Motion { linear: 0.0, angular: -self.config.turn_speed_rad_s }
                }
            }
            State::TurnLeft => {
                if self.has_turned(seen) {
                    self.state = self.after_turn(Wall::Right, stamp);
                    self.step(stamp, dt, seen)
                } else {
                    Motion { linear: 0.0, angular: self.config.turn_speed_rad_s }
                }
            }
            State::FixedFront { wall, until } => {
                if until <= stamp || self.is_of_another_clock(until, stamp) {
                    self.state = State::Front { wall };
                    self.step(stamp, dt, seen)
                } else {
                    Motion { linear: self.config.fixed_front_speed_m_s, angular: 0.0 }
                }
            }
        }
    }

    /// The nearer wall where there is room for a choice, else the one followed so far.
    fn nearer(&self, wall: Wall, seen: &Seen) -> Wall {
        if seen.left + seen.right < self.config.corridor_width_m {
            wall
        } else if seen.right <= seen.left {
            Wall::Right
        } else {
            Wall::Left
        }
    }

    fn decide(&mut self, seen: &Seen) -> State {
        self.errors = Errors::default();
        let difference = seen.right - seen.left;
        if difference.abs() <= self.config.ambiguity_m {
            if self.random.next_u32() & 1 == 0 { State::TurnLeft } else { State::TurnRight }
        } else if difference <= 0.0 {
            State::TurnLeft
        } else {
            State::TurnRight
        }
    }

    fn follow(&mut self, wall: Wall, dt: Option<Duration>, seen: &Seen) -> Motion {
        let target = self.config.target_distance_m;
        let errors = Errors { left: seen.left - target, right: target - seen.right };
        let before = std::mem::replace(&mut self.errors, errors);
        let (error, error_before) = match wall {
            Wall::Left => (errors.left, before.left),
            Wall::Right => (errors.right, before.right),
        };

        let rate = dt.map_or(0.0, |dt| (error - error_before) / dt.as_secs_f64());
        let angular = self.config.gain_proportional_rad_s_m * error
            + self.config.gain_derivative_rad_m * rate;
        let limit = self.config.angular_max_rad_s.unwrap_or(f64::INFINITY);
        Motion { linear: self.config.speed_m_s, angular: angular.clamp(-limit, limit) }
    }

    fn has_turned(&self, seen: &Seen) -> bool {
        let limit = self.config.turn_exit_max_m.unwrap_or(f64::INFINITY);
        self.config.turn_exit_m() <= seen.front && seen.front <= limit
    }

    /// Whether a way ahead that ends at `until` cannot have begun by now: the clock was set back.
    fn is_of_another_clock(&self, until: Stamp, stamp: Stamp) -> bool {
        Duration::from_secs_f64(self.config.fixed_front_s) < until.since(stamp)
    }

    fn after_turn(&self, wall: Wall, stamp: Stamp) -> State {
        if self.config.fixed_front_s > 0.0 {
            let until = stamp.after(Duration::from_secs_f64(self.config.fixed_front_s));
            State::FixedFront { wall, until }
        } else {
            State::Front { wall }
        }
    }
}

fn look(config: &WallConfig, scan: &LaserScan) -> Seen {
    let ranges = scan.ranges();
    let length = ranges.len();
    let (quarter, three_quarters) = (length / 4, 3 * length / 4);
    let nearest = |beams: &mut dyn Iterator<Item = &f32>| {
        beams
            .copied()
            .filter(|&range| is_wall(scan, range))
            .map(f64::from)
            .reduce(f64::min)
            .unwrap_or(config.distance_missing_m)
    };

    match config.distances {
        Distances::Windows => {
            let window = |middle: usize| ranges[middle - WINDOW_HALF..middle + WINDOW_HALF].iter();
            let ahead = ranges[..WINDOW_HALF].iter().chain(&ranges[length - WINDOW_HALF..]);
            Seen {
                front: nearest(&mut { ahead }),
                left: nearest(&mut window(quarter)),
                right: nearest(&mut window(three_quarters)),
            }
        }
        Distances::Beams => {
            let beam = |index: usize| nearest(&mut ranges[index..=index].iter());
            Seen { front: beam(length - 1), left: beam(quarter), right: beam(three_quarters) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{blank, stamp};

    fn seen(front: f64, left: f64, right: f64) -> Seen {
        Seen { front, left, right }
    }

    fn follower(config: &WallConfig) -> WallFollowing {
        WallFollowing::new(config, 1)
    }

    fn step(follower: &mut WallFollowing, milliseconds: u64, seen: &Seen) -> Motion {
        follower.step(stamp(milliseconds), Some(Duration::from_millis(50)), seen)
    }

    #[track_caller]
    fn assert_motion(motion: Motion, linear: f64, angular: f64) {
        let near = |one: f64, other: f64| (one - other).abs() < 1e-6;
        assert!(near(motion.linear, linear) && near(motion.angular, angular), "{motion:?}");
    }

    #[test]
    fn the_nearer_wall_is_followed_where_the_corridor_is_wide_enough() {
        let table = [
            (Wall::Right, seen(1.0, 0.2, 0.25), Wall::Left),
            (Wall::Left, seen(1.0, 0.25, 0.2), Wall::Right),
            (Wall::Left, seen(1.0, 0.25, 0.25), Wall::Right),
            (Wall::Right, seen(1.0, 0.18, 0.2), Wall::Right),
            (Wall::Left, seen(1.0, 0.2, 0.18), Wall::Left),
        ];
        for (before, seen, after) in table {
            let mut follower = follower(&WallConfig::default());
            follower.state = State::Front { wall: before };
            step(&mut follower, 50, &seen);
            assert_eq!(follower.state, State::Front { wall: after }, "{before:?}, {seen:?}");
        }
    }

    #[test]
    fn the_turning_speed_is_proportional_to_the_error_and_to_its_rate() {
        let mut follower = follower(&WallConfig::default());
        // 0.03 m too far from the right wall: 4 * -0.03 + 5 * (-0.03 - 0) / 0.05.
        assert_motion(step(&mut follower, 50, &seen(1.0, 0.3, 0.23)), 0.15, -3.12);
        // 0.02 m too far: 4 * -0.02 + 5 * 0.01 / 0.05.
        assert_motion(step(&mut follower, 100, &seen(1.0, 0.3, 0.22)), 0.15, 0.92);
        // The left wall is 0.02 m too near, and was 0.1 m too far.
        assert_motion(step(&mut follower, 150, &seen(1.0, 0.18, 0.25)), 0.15, -0.08 - 12.0);
    }

    #[test]
    fn the_robot_s_column_limits_the_turning_speed_of_following_only() {
        let config = WallConfig {
            angular_max_rad_s: Some(0.34),
            turn_speed_rad_s: 0.37,
            ..WallConfig::default()
        };
        let mut follower = follower(&config);
        assert_motion(step(&mut follower, 50, &seen(1.0, 0.3, 0.23)), 0.15, -0.34);
        assert_motion(step(&mut follower, 100, &seen(1.0, 0.1, 0.3)), 0.15, -0.34);
        step(&mut follower, 150, &seen(0.2, 0.6, 0.2));
        assert_motion(step(&mut follower, 200, &seen(0.2, 0.6, 0.2)), 0.0, 0.37);
    }

    #[test]
    fn the_first_scan_has_no_rate() {
        let mut follower = follower(&WallConfig::default());
        let mut scan = blank(240, 50);
        scan.ranges_mut().fill(0.3);
        assert_motion(follower.update(&scan), 0.15, -0.4);
    }

    #[test]
    fn a_publisher_s_new_life_starts_time_anew() {
        let mut follower = follower(&WallConfig::default());
        let mut scan = blank(240, 1000);
        scan.ranges_mut().fill(0.3);
        follower.update(&scan);

        let mut scan = blank(240, 50);
        scan.ranges_mut().fill(0.25);
        scan.header.epoch = 2;
        assert_motion(follower.update(&scan), 0.15, -0.2);
    }

    #[test]
    fn a_wall_ahead_is_turned_away_from_to_the_side_with_more_room() {
        let table = [
            (seen(0.23, 0.6, 0.2), State::TurnLeft, 0.5),
            (seen(0.23, 0.2, 0.6), State::TurnRight, -0.5),
            (seen(0.10, 0.26, 0.2), State::TurnLeft, 0.5),
            (seen(0.10, 0.2, 0.26), State::TurnRight, -0.5),
        ];
        for (seen, state, angular) in table {
            let mut follower = follower(&WallConfig::default());
            follower.errors = Errors { left: 0.1, right: 0.1 };
            assert_motion(step(&mut follower, 50, &seen), 0.0, 0.0);
            assert_eq!(follower.state, state, "{seen:?}");
            assert_eq!(follower.errors, Errors::default());
            assert_motion(step(&mut follower, 100, &seen), 0.0, angular);
        }
    }

    #[test]
    fn a_dead_end_is_left_on_a_side_that_the_seed_chooses() {
        let choose = |seed| {
            let mut follower = WallFollowing::new(&WallConfig::default(), seed);
            (0..20)
                .map(|_| follower.decide(&seen(0.2, 0.2, 0.24)))
                .inspect(|state| assert!(matches!(state, State::TurnLeft | State::TurnRight)))
                .collect::<Vec<_>>()
        };
        assert_eq!(choose(1), choose(1));
        assert_ne!(choose(1), choose(2));
        assert!(choose(1).contains(&State::TurnLeft) && choose(1).contains(&State::TurnRight));
    }

    #[test]
    fn a_turn_ends_where_the_front_is_free_but_not_too_free() {
        let exit = WallConfig::default().turn_exit_m();
        let table = [
            (None, exit - 0.001, false),
            (None, exit, true),
            (None, 8.0, true),
            (Some(0.75), exit, true),
            (Some(0.75), 0.75, true),
            (Some(0.75), 0.751, false),
        ];
        for (turn_exit_max_m, front, ends) in table {
            let config = WallConfig { turn_exit_max_m, ..WallConfig::default() };
            for (turn, wall) in [(State::TurnLeft, Wall::Right), (State::TurnRight, Wall::Left)] {
                let mut follower = follower(&config);
                follower.state = turn;
                // Too narrow for another choice of wall.
                step(&mut follower, 50, &seen(front, 0.19, 0.19));
                let after = if ends { State::Front { wall } } else { turn };
                assert_eq!(follower.state, after, "{turn_exit_max_m:?}, {front}");
            }
        }
    }

    #[test]
    fn the_way_ahead_after_a_turn_lasts_by_stamps() {
        let config = WallConfig { fixed_front_s: 0.35, ..WallConfig::default() };
        let mut follower = follower(&config);
        follower.state = State::TurnLeft;

        let free = seen(0.5, 0.19, 0.19);
        for milliseconds in [1000, 1050, 1349] {
            assert_motion(step(&mut follower, milliseconds, &free), 0.1, 0.0);
            assert_eq!(follower.activity(), Activity::LeavingTurn);
        }
        step(&mut follower, 1350, &free);
        assert_eq!(follower.state, State::Front { wall: Wall::Right });
    }

    #[test]
    fn the_way_ahead_after_a_turn_does_not_outlast_its_clock() {
        let config = WallConfig { fixed_front_s: 0.35, ..WallConfig::default() };
        let mut follower = follower(&config);
        follower.state = State::TurnLeft;
        let free = seen(0.5, 0.19, 0.19);
        step(&mut follower, 3_600_000, &free);
        assert_eq!(follower.activity(), Activity::LeavingTurn);

        step(&mut follower, 1000, &free);
        assert_eq!(follower.activity(), Activity::Following);
    }

    #[test]
    fn a_scan_that_follows_within_a_millisecond_is_the_same_one() {
        // The last moment there is, too: none comes after it.
        for at in [stamp(50), Stamp::from_nanoseconds(u64::MAX)] {
            let mut follower = follower(&WallConfig::default());
            let mut scan = blank(240, 0);
            scan.header.stamp = at;
            scan.ranges_mut().fill(0.5);
            let first = follower.update(&scan);

            scan.ranges_mut().fill(0.25);
            for soon in [at, at.after(Duration::from_nanos(1))] {
                scan.header.stamp = soon;
                assert_motion(follower.update(&scan), first.linear, first.angular);
            }
        }
    }

    #[test]
    fn a_window_is_ten_beams_and_a_beam_is_one() {
        let mut scan = blank(240, 50);
        scan.ranges_mut().fill(1.0);
        let edges =
            [(4, 0.11), (5, 0.02), (234, 0.03), (235, 0.12), (55, 0.13), (54, 0.04), (64, 0.14)];
        for (index, range) in edges.into_iter().chain([(65, 0.05), (175, 0.15), (185, 0.06)]) {
            scan.range[index] = range;
        }
        scan.range_min = 0.0;

        let windows = WallConfig { distances: Distances::Windows, ..WallConfig::default() };
        let beams = WallConfig { distances: Distances::Beams, ..WallConfig::default() };
        let near = |one: &Seen, other: &Seen| {
            (one.front - other.front).abs() < 1e-6
                && (one.left - other.left).abs() < 1e-6
                && (one.right - other.right).abs() < 1e-6
        };
        assert!(near(&look(&windows, &scan), &seen(0.11, 0.13, 0.15)));
        assert!(near(&look(&beams, &scan), &seen(1.0, 1.0, 1.0)));

        for (index, range) in [(239, 0.3), (60, 0.4), (180, 0.5)] {
            scan.range[index] = range;
        }
        assert!(near(&look(&beams, &scan), &seen(0.3, 0.4, 0.5)));
    }

    #[test]
    fn directions_are_fractions_of_the_scan_s_own_length() {
        for beams in [40, 230, 231, 360, 1440] {
            let mut scan = blank(beams, 50);
            for (index, range) in [(beams - 1, 0.25), (beams / 4, 0.5), (3 * beams / 4, 0.75)] {
                scan.range[index] = range;
            }
            for distances in [Distances::Windows, Distances::Beams] {
                let config = WallConfig { distances, ..WallConfig::default() };
                assert_eq!(look(&config, &scan), seen(0.25, 0.5, 0.75), "{beams}, {distances:?}");
            }
        }
    }

    #[test]
    fn beams_that_are_no_wall_are_left_out_and_an_empty_direction_is_far() {
        for missing in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.05, 9.0] {
            let mut scan = blank(240, 50);
            scan.ranges_mut().fill(missing);
            scan.range[2] = 0.5;
            for distances in [Distances::Windows, Distances::Beams] {
                let config = WallConfig { distances, ..WallConfig::default() };
                let front = if distances == Distances::Windows { 0.5 } else { 8.0 };
                assert_eq!(look(&config, &scan), seen(front, 8.0, 8.0), "{missing}");
            }
        }
    }
}
