//! Velocity by differencing poses, for robots that report nothing else.

use interfaces::{Odometry, Pose};

use crate::continuity::{Base, Continuity};
use crate::{Config, Rejected, wrapped};

/// [m] No robot goes farther from where it started.
const PLACE_MAX: f64 = 1e6;

/// [rad] Nobody's heading is more than a whole turn.
const YAW_MAX: f64 = 2.0 * std::f64::consts::PI;

/// The pose before, to which the next one is compared.
#[derive(Debug, Clone)]
pub struct PoseOdometry {
    /// [m/s] What both wheels together do.
    speed_max: f64,
    /// [rad/s] What the wheels against each other do.
    angular_max: f64,
    poses: Continuity<Pose>,
}

impl PoseOdometry {
    /// A robot that has reported nothing yet.
    pub fn new(config: &Config) -> Self {
        let poses = Continuity::new(config.stamp_gap_max());
        let mut odometry = Self { speed_max: 0.0, angular_max: 0.0, poses };
        odometry.retune(config);
        odometry
    }

    /// From now on judges by the measures and the greatest speed of `config`.
    pub fn retune(&mut self, config: &Config) {
        self.speed_max = config.wheel_radius_m * config.wheel_speed_max_rad_s;
        self.angular_max = 2.0 * self.speed_max / config.track_m;
    }

    /// Writes the reported pose and the velocity since the one before into `odometry`. False, and
    /// nothing written, for the first pose in a publisher's life, which only sets the reference.
    /// A pose that is rejected writes nothing, and is compared with nothing good. Where the robot
    /// was set to another place, or its clock to another time, the second pose is believed.
    ///
    /// The speed is that along the mean heading: the previous one plus half the wrapped turn, since
    /// the plain mean of two headings is wrong across ±π.
    pub fn update(&mut self, pose: &Pose, odometry: &mut Odometry) -> Result<bool, Rejected> {
        check(pose)?;
        let (speed_max, angular_max) = (self.speed_max, self.angular_max);
        let base = self.poses.judge(&pose.header, *pose, |from, to, dt| {
            let distance = libm::hypot(to.x - from.x, to.y - from.y);
            let turn = wrapped(to.yaw - from.yaw).abs();
            distance <= speed_max * dt && turn <= angular_max * dt
        })?;
        let (before, dt) = match base {
            Base::None => return Ok(false),
            Base::Last { value, dt } | Base::Suspect { value, dt, .. } => (value, dt),
        };
        let turn = wrapped(pose.yaw - before.yaw);
        let heading = before.yaw + 0.5 * turn;
        let (dx, dy) = (pose.x - before.x, pose.y - before.y);
        odometry.header.stamp = pose.header.stamp;
        odometry.x = pose.x;
        odometry.y = pose.y;
        odometry.yaw = pose.yaw;
        odometry.linear = (dx * libm::cos(heading) + dy * libm::sin(heading)) / dt;
        odometry.angular = turn / dt;
        Ok(true)
    }

    /// [-] Times that stamps or poses jumped and those after that were believed.
    pub fn rebases(&self) -> u64 {
        self.poses.rebases()
    }
}

/// Rejects what no robot reports, whatever came before.
fn check(pose: &Pose) -> Result<(), Rejected> {
    if ![pose.x, pose.y, pose.yaw].iter().all(|number| number.is_finite()) {
        return Err(Rejected::NotFinite);
    }
    let is_within =
        pose.x.abs() <= PLACE_MAX && pose.y.abs() <= PLACE_MAX && pose.yaw.abs() <= YAW_MAX;
    if is_within { Ok(()) } else { Err(Rejected::TooGreat) }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;
    use std::time::Duration;

    use interfaces::Stamp;

    use super::*;

    fn pose(time: f64, x: f64, y: f64, yaw: f64) -> Pose {
        let mut pose = Pose { x, y, yaw: wrapped(yaw), ..Pose::default() };
        pose.header.stamp = Stamp::ZERO.after(Duration::from_secs_f64(time));
        pose
    }

    /// The pose at `time` of a robot that started at the origin, heading `start`, on an arc.
    fn on_arc(linear: f64, angular: f64, start: f64, time: f64) -> Pose {
        let yaw = start + angular * time;
        let radius = linear / angular;
        let x = radius * (libm::sin(yaw) - libm::sin(start));
        let y = radius * (libm::cos(start) - libm::cos(yaw));
        pose(time, x, y, yaw)
    }

    #[test]
    fn velocity_is_that_of_the_motion_whatever_the_heading() {
        let dt = 0.05;
        for (linear, angular) in [(0.15, 0.5), (0.2, -1.0), (-0.1, 0.3)] {
            for start in [0.0, 1.0, PI - 0.001, -PI + 0.001, 3.0] {
                let mut core = PoseOdometry::new(&Config::default());
                let mut odometry = Odometry::default();
                let first = on_arc(linear, angular, start, 0.0);
                assert_eq!(core.update(&first, &mut odometry), Ok(false));
                let second = on_arc(linear, angular, start, dt);
                assert_eq!(core.update(&second, &mut odometry), Ok(true));

                // The chord is shorter than the arc by this factor.
                let half = 0.5 * angular * dt;
                let chord = linear * libm::sin(half) / half;
                assert!((odometry.linear - chord).abs() < 1e-9, "start {start}: {odometry:?}");
                assert!((odometry.angular - angular).abs() < 1e-9, "start {start}: {odometry:?}");
            }
        }
    }

    #[test]
    fn pose_and_stamp_stay_as_reported() {
        let mut core = PoseOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        core.update(&pose(1.0, 0.0, 0.0, 0.0), &mut odometry).unwrap();
        core.update(&pose(2.0, 0.3, 0.4, 0.5), &mut odometry).unwrap();

        assert_eq!(odometry.header.stamp, Stamp::from_nanoseconds(2_000_000_000));
        let reported = [odometry.x, odometry.y, odometry.yaw];
        assert_eq!(reported.map(f64::to_bits), [0.3, 0.4, wrapped(0.5)].map(f64::to_bits));
    }

    #[test]
    fn a_pose_that_is_rejected_changes_nothing() {
        let good = pose(1.05, 0.01, 0.0, 0.0);
        let table = [
            (pose(1.0, 1.0, 0.0, 0.0), Rejected::Repeated),
            (pose(0.5, 0.0, 0.0, 0.0), Rejected::Backwards),
            (pose(3601.0, 0.0, 0.0, 0.0), Rejected::Ahead),
            (Pose { x: f64::NAN, ..good }, Rejected::NotFinite),
            (Pose { y: f64::INFINITY, ..good }, Rejected::NotFinite),
            (Pose { yaw: f64::NEG_INFINITY, ..good }, Rejected::NotFinite),
            (Pose { x: 1e300, ..good }, Rejected::TooGreat),
            (Pose { yaw: 1e300, ..good }, Rejected::TooGreat),
            (Pose { y: 3.0, ..good }, Rejected::TooFast),
            (Pose { yaw: 3.0, ..good }, Rejected::TooFast),
        ];
        for (reported, reason) in table {
            let mut core = PoseOdometry::new(&Config::default());
            let mut odometry = Odometry::default();
            assert_eq!(core.update(&pose(1.0, 0.0, 0.0, 0.0), &mut odometry), Ok(false));
            assert_eq!(core.update(&reported, &mut odometry), Err(reason), "{reported:?}");
            assert_eq!(odometry, Odometry::default(), "{reported:?}");
            assert_eq!(core.update(&pose(1.1, 0.02, 0.0, 0.0), &mut odometry), Ok(true));
            assert!((odometry.linear - 0.2).abs() < 1e-9, "{reported:?}: {}", odometry.linear);
        }
    }

    #[test]
    fn a_robot_that_was_carried_away_is_believed_at_the_second_pose() {
        let mut core = PoseOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        core.update(&pose(1.0, 0.0, 0.0, 0.0), &mut odometry).unwrap();
        core.update(&pose(1.05, 5.0, 0.0, 0.0), &mut odometry).unwrap_err();

        assert_eq!(core.update(&pose(1.1, 5.01, 0.0, 0.0), &mut odometry), Ok(true));
        assert!((odometry.linear - 0.2).abs() < 1e-9, "{}", odometry.linear);
        assert_eq!(core.rebases(), 1);

        let mut new_life = pose(0.5, 9.0, 0.0, 0.0);
        new_life.header.epoch = 2;
        assert_eq!(core.update(&new_life, &mut odometry), Ok(false));
    }
}
