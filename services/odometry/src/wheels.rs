//! Forward kinematics: from what the wheels turned to where the robot is.

use interfaces::{JointState, LEFT, Odometry, RIGHT};
use nalgebra::{Isometry2, UnitComplex, Vector2};

use crate::continuity::{Base, Continuity};
use crate::{Config, Rejected, wrapped};

/// Below this half turn the chord is as long as the arc, to the last bit.
const HALF_TURN_TINY: f64 = 1e-4;

/// [rad] No wheel turns so far in its life; nearer to zero, an angle is exact to a millionth.
const ANGLE_MAX: f64 = 1e9;

/// Pose and velocity of a robot with two driven wheels.
#[derive(Debug, Clone)]
pub struct WheelOdometry {
    wheel_radius: f64,
    track: f64,
    turn_sign: f64,
    /// [rad] What a gyro said beside the last good sample.
    heading: Option<f64>,
    odom_from_base: Isometry2<f64>,
    yaw: f64,
    speed_max: f64,
    /// [s] What the first sample's own increments may cover.
    gap_max: f64,
    angles: Continuity<[f64; 2]>,
}

impl WheelOdometry {
    /// A robot at rest where the configuration says.
    pub fn new(config: &Config) -> Self {
        let yaw = wrapped(config.yaw_rad);
        Self {
            wheel_radius: config.wheel_radius_m,
            track: config.track_m,
            turn_sign: config.faster_right.sign(),
            heading: None,
            odom_from_base: Isometry2::from_parts(
                Vector2::new(config.x_m, config.y_m).into(),
                rotation(yaw),
            ),
            yaw,
            speed_max: config.wheel_speed_max_rad_s,
            gap_max: config.stamp_gap_max_s,
            angles: Continuity::new(config.stamp_gap_max()),
        }
    }

    /// From now on goes by the measures and the greatest speed of `config`; where the robot is by now
    /// stays. What else `config` says changes nothing.
    pub fn retune(&mut self, config: &Config) {
        self.wheel_radius = config.wheel_radius_m;
        self.track = config.track_m;
        self.speed_max = config.wheel_speed_max_rad_s;
    }

    /// Moves on by what the wheels turned since the sample before, on an exact arc, and writes pose
    /// and velocity into `odometry`. A sample that is rejected writes nothing, moves nothing, and
    /// is compared with nothing good.
    ///
    /// With r the wheel's radius and 2b the track: v = r/2 (left + right), w = r/2b (right - left).
    /// The first sample of a publisher's life counts by its own increments and speeds, for its
    /// encoders may count from anywhere; later ones by the difference of angles, so that a lost
    /// sample loses no distance. Where stamps have jumped, the second sample after that is believed;
    /// the way since the last good one counts, unless the angles have jumped too.
    pub fn update(&mut self, wheels: &JointState, odometry: &mut Odometry) -> Result<(), Rejected> {
        self.update_with(wheels, None, odometry)
    }

    /// The same where a gyro tells the heading [rad], whose zero is anywhere, at the sample's stamp:
    /// from one sample that has a heading to the next, it is the gyro that says how far the robot
    /// has turned. What no robot turns it does not say.
    pub fn update_with(
        &mut self,
        wheels: &JointState,
        heading: Option<f64>,
        odometry: &mut Odometry,
    ) -> Result<(), Rejected> {
        self.check(wheels)?;
        let speed_max = self.speed_max;
        let base = self.angles.judge(&wheels.header, wheels.position, |from, to, dt| {
            is_possible(turned(from, to), speed_max * dt)
        })?;
        let now = &wheels.position;
        let (way, speed) = match base {
            Base::None => (wheels.increment, wheels.velocity),
            Base::Last { value, dt } => {
                let way = turned(&value, now);
                (way, way.map(|angle| angle / dt))
            }
            Base::Suspect { value, dt, lost } => {
                let way = turned(&lost.unwrap_or(value), now);
                (way, turned(&value, now).map(|angle| angle / dt))
            }
        };
        let (distance, mut turn) = self.forward(way);
        let (linear, mut angular) = self.forward(speed);
        let before = std::mem::replace(&mut self.heading, heading);
        if let (Base::Last { dt, .. }, Some(before), Some(heading)) = (base, before, heading) {
            let turned = wrapped(heading - before);
            let turn_max = 2.0 * self.wheel_radius * speed_max / self.track * dt;
            if turned.abs() <= turn_max {
                (turn, angular) = (turned, turned / dt);
            }
        }
        self.advance(distance, turn);
        odometry.header.stamp = wheels.header.stamp;
        odometry.x = self.odom_from_base.translation.x;
        odometry.y = self.odom_from_base.translation.y;
        odometry.yaw = self.yaw;
        odometry.linear = linear;
        odometry.angular = angular;
        Ok(())
    }

    /// [-] Times that stamps or angles jumped and the samples after that were believed.
    pub fn rebases(&self) -> u64 {
        self.angles.rebases()
    }

    /// Rejects what no wheel reports, whatever came before.
    fn check(&self, wheels: &JointState) -> Result<(), Rejected> {
        let JointState { position, increment, velocity, .. } = wheels;
        let mut numbers = position.iter().chain(increment).chain(velocity);
        if !numbers.all(|number| number.is_finite()) {
            return Err(Rejected::NotFinite);
        }
        if !is_possible(*position, ANGLE_MAX) {
            return Err(Rejected::TooGreat);
        }
        if !is_possible(*velocity, self.speed_max)
            || !is_possible(*increment, self.speed_max * self.gap_max)
        {
            return Err(Rejected::TooFast);
        }
        Ok(())
    }

    /// Wheel angles to distance and turn, or wheel speeds to speed and turning speed.
    fn forward(&self, wheels: [f64; 2]) -> (f64, f64) {
        let along = self.wheel_radius / 2.0 * (wheels[LEFT] + wheels[RIGHT]);
        let about = self.wheel_radius / self.track * (wheels[RIGHT] - wheels[LEFT]);
        (along, self.turn_sign * about)
    }

    fn advance(&mut self, distance: f64, turn: f64) {
        let half = 0.5 * turn;
        let shortening = if half.abs() < HALF_TURN_TINY {
            1.0 - half * half / 6.0
        } else {
            libm::sin(half) / half
        };
        let chord = distance * shortening;
        let along = Vector2::new(chord * libm::cos(half), chord * libm::sin(half));
        let position = self.odom_from_base * nalgebra::Point2::from(along);
        self.yaw = wrapped(self.yaw + turn);
        self.odom_from_base = Isometry2::from_parts(position.coords.into(), rotation(self.yaw));
    }
}

fn turned(from: &[f64; 2], to: &[f64; 2]) -> [f64; 2] {
    [LEFT, RIGHT].map(|wheel| to[wheel] - from[wheel])
}

fn is_possible(wheels: [f64; 2], limit: f64) -> bool {
    wheels.iter().all(|angle| angle.abs() <= limit)
}

fn rotation(yaw: f64) -> UnitComplex<f64> {
    UnitComplex::from_cos_sin_unchecked(libm::cos(yaw), libm::sin(yaw))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;
    use std::time::Duration;

    use interfaces::Stamp;

    use super::*;

    /// Wheel angles of a Burger that drives `linear` and `angular` for `time`.
    fn wheels(linear: f64, angular: f64, time: f64) -> JointState {
        let mut wheels = JointState::default();
        wheels.header.stamp = Stamp::ZERO.after(Duration::from_secs_f64(time));
        wheels.position =
            [(linear - 0.08 * angular) * time / 0.033, (linear + 0.08 * angular) * time / 0.033];
        wheels
    }

    fn drive(linear: f64, angular: f64, dt: f64, steps: u32) -> Odometry {
        let mut core = WheelOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        for step in 0..=steps {
            core.update(&wheels(linear, angular, f64::from(step) * dt), &mut odometry).unwrap();
        }
        odometry
    }

    #[test]
    fn an_arc_ends_where_geometry_says() {
        for (linear, angular) in [(0.2, 0.0), (0.0, 1.0), (0.15, 0.5), (0.15, -1.3), (-0.1, 0.2)] {
            let time = 4.0;
            let end = drive(linear, angular, 0.05, 80);

            let turn: f64 = angular * time;
            let radius: f64 = if angular == 0.0 { 0.0 } else { linear / angular };
            let (x, y) = if angular == 0.0 {
                (linear * time, 0.0)
            } else {
                (radius * libm::sin(turn), radius * (1.0 - libm::cos(turn)))
            };
            assert!((end.x - x).abs() < 1e-9, "v {linear} w {angular}: x {} not {x}", end.x);
            assert!((end.y - y).abs() < 1e-9, "v {linear} w {angular}: y {} not {y}", end.y);
            assert!((wrapped(end.yaw - turn)).abs() < 1e-9);
            assert!((end.linear - linear).abs() < 1e-9);
            assert!((end.angular - angular).abs() < 1e-9);
        }
    }

    // Broken on purpose: without wrapping, the gyro's turn across PI was 6.2 rad, and refused.
    #[test]
    fn a_gyro_says_how_far_the_robot_has_turned_whatever_the_wheels_do() {
        // The wheels slip: they tell twice the turn.
        for (start, zero) in [(0.0, 0.0), (3.0, 0.0), (0.0, 3.1), (-3.0, -1.0)] {
            let mut core = WheelOdometry::new(&Config { yaw_rad: start, ..Config::default() });
            let mut odometry = Odometry::default();
            for step in 0..=80 {
                let time = f64::from(step) * 0.05;
                let heading = Some(wrapped(zero + 0.25 * time));
                core.update_with(&wheels(0.1, 0.5, time), heading, &mut odometry).unwrap();
            }
            assert!(wrapped(odometry.yaw - start - 1.0).abs() < 1e-9, "{start}: {}", odometry.yaw);
            assert!((odometry.angular - 0.25).abs() < 1e-9, "{start}: {}", odometry.angular);
            assert!((odometry.linear - 0.1).abs() < 1e-9, "{start}: {}", odometry.linear);
        }
    }

    #[test]
    fn where_the_gyro_is_silent_or_mad_the_wheels_say_it() {
        let mut core = WheelOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        for step in 0..=80_u8 {
            let time = f64::from(step) * 0.05;
            let heading = [None, Some(0.5 * time), Some(0.5 * time + 2.0)][usize::from(step % 3)];
            core.update_with(&wheels(0.1, 0.5, time), heading, &mut odometry).unwrap();
        }
        assert!((odometry.yaw - 2.0).abs() < 1e-9, "{}", odometry.yaw);
    }

    #[test]
    fn a_robot_whose_wheels_are_told_in_the_wrong_order_turns_the_other_way() {
        let config = Config { faster_right: crate::Turning::Clockwise, ..Config::default() };
        let mut core = WheelOdometry::new(&config);
        let mut odometry = Odometry::default();
        for time in [0.0, 0.05] {
            core.update(&wheels(0.1, 0.5, time), &mut odometry).unwrap();
        }
        assert!((odometry.angular + 0.5).abs() < 1e-9 && (odometry.linear - 0.1).abs() < 1e-9);
    }

    #[test]
    fn a_lost_sample_loses_no_distance() {
        let mut core = WheelOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        for time in [0.0, 0.05, 0.20] {
            core.update(&wheels(0.2, 0.0, time), &mut odometry).unwrap();
        }

        assert!((odometry.x - 0.04).abs() < 1e-12);
        assert!((odometry.linear - 0.2).abs() < 1e-12);
    }

    /// A robot that drove straight for 1 s, and what it thought then.
    fn driven() -> (WheelOdometry, Odometry) {
        let mut core = WheelOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        for step in 0..=20 {
            core.update(&wheels(0.2, 0.0, f64::from(step) * 0.05), &mut odometry).unwrap();
        }
        (core, odometry)
    }

    /// Drives on, and expects to be where a robot is that never saw anything wrong.
    #[track_caller]
    fn assert_right(core: &mut WheelOdometry, time: f64) {
        let mut odometry = Odometry::default();
        core.update(&wheels(0.2, 0.0, time), &mut odometry).unwrap();
        assert!((odometry.x - 0.2 * time).abs() < 1e-9, "x {} at {time}", odometry.x);
        assert!((odometry.linear - 0.2).abs() < 1e-9, "v {} at {time}", odometry.linear);
    }

    #[test]
    fn a_sample_that_is_rejected_changes_nothing() {
        let good = wheels(0.2, 0.0, 1.05);
        let with = |position| JointState { position, ..good };
        let table = [
            (wheels(0.2, 0.0, 1.0), Rejected::Repeated),
            (wheels(0.2, 0.0, 1.0 - 1e-9), Rejected::Backwards),
            (wheels(0.2, 0.0, 0.0), Rejected::Backwards),
            (wheels(0.2, 0.0, 3601.0), Rejected::Ahead),
            (with([f64::NAN, 6.0]), Rejected::NotFinite),
            (with([6.0, f64::INFINITY]), Rejected::NotFinite),
            (with([1e300, 6.0]), Rejected::TooGreat),
            (with([6.0, -1e300]), Rejected::TooGreat),
            (with([0.0, 0.0]), Rejected::TooFast),
            (with([100.0, 100.0]), Rejected::TooFast),
            (JointState { velocity: [f64::NAN, 0.0], ..good }, Rejected::NotFinite),
            (JointState { velocity: [1e300, 0.0], ..good }, Rejected::TooFast),
            (JointState { increment: [0.0, f64::NEG_INFINITY], ..good }, Rejected::NotFinite),
            (JointState { increment: [0.0, 31.0], ..good }, Rejected::TooFast),
        ];
        for (sample, reason) in table {
            let (mut core, mut odometry) = driven();
            let before = odometry;
            assert_eq!(core.update(&sample, &mut odometry), Err(reason), "{sample:?}");
            assert_eq!(odometry, before, "{sample:?}");
            assert_right(&mut core, 1.1);
            assert_eq!(core.rebases(), 0, "{sample:?}");
        }
    }

    #[test]
    fn a_clock_that_was_set_costs_one_sample_and_no_distance() {
        for jump in [3600.0, -0.5, 5.0] {
            let (mut core, mut odometry) = driven();
            let set = |time: f64| {
                let mut sample = wheels(0.2, 0.0, time);
                sample.header.stamp = Stamp::ZERO.after(Duration::from_secs_f64(time + jump));
                sample
            };
            core.update(&set(1.05), &mut odometry).unwrap_err();
            for time in [1.1, 1.15] {
                core.update(&set(time), &mut odometry).unwrap();
                assert!((odometry.x - 0.2 * time).abs() < 1e-9, "{jump}: x {}", odometry.x);
                assert!((odometry.linear - 0.2).abs() < 1e-6, "{jump}: v {}", odometry.linear);
            }
            assert_eq!(core.rebases(), 1);
        }
    }

    #[test]
    fn encoders_that_jump_move_nothing() {
        let (mut core, mut odometry) = driven();
        let jumped = |time| {
            let mut sample = wheels(0.2, 0.0, time);
            sample.position = sample.position.map(|angle| angle - 1000.0);
            sample
        };
        assert_eq!(core.update(&jumped(1.05), &mut odometry), Err(Rejected::TooFast));
        core.update(&jumped(1.1), &mut odometry).unwrap();
        // What the robot drove until the first sample after the jump cannot be known.
        assert!((odometry.x - 0.21).abs() < 1e-9, "x {}", odometry.x);
        assert!((odometry.linear - 0.2).abs() < 1e-9);
    }

    #[test]
    fn a_publisher_s_new_life_counts_from_anywhere() {
        let (mut core, mut odometry) = driven();
        for (step, time) in [0.0, 0.05, 0.1].into_iter().enumerate() {
            let mut sample = wheels(0.2, 0.0, time);
            sample.header.epoch = 2;
            sample.increment = [0.01 / 0.033; 2];
            core.update(&sample, &mut odometry).unwrap();
            let x = 0.2 + 0.01 * (step + 1) as f64;
            assert!((odometry.x - x).abs() < 1e-9, "x {} not {x}", odometry.x);
        }
        assert_eq!(core.rebases(), 0);
    }

    #[test]
    fn heading_stays_wrapped() {
        let end = drive(0.0, 1.0, 0.05, 80);

        assert!((end.yaw - (4.0 - 2.0 * PI)).abs() < 1e-9);
    }
}
