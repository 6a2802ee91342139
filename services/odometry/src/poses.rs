//! Velocity by differencing poses, for robots that report nothing else.

use interfaces::{Odometry, Pose, Stamp};

use crate::wrapped;

/// The pose before, to which the next one is compared.
#[derive(Debug, Clone, Default)]
pub struct PoseOdometry {
    previous: Option<(Stamp, Pose)>,
}

impl PoseOdometry {
    /// Writes the reported pose and the velocity since the one before into `odometry`. False, and
    /// nothing written, for the first pose, which only sets the reference, and where no time has
    /// passed.
    ///
    /// The speed is that along the mean heading: the previous one plus half the wrapped turn, since
    /// the plain mean of two headings is wrong across ±π.
    pub fn update(&mut self, pose: &Pose, odometry: &mut Odometry) -> bool {
        let stamp = pose.header.stamp;
        let Some((earlier, before)) = self.previous else {
            self.previous = Some((stamp, *pose));
            return false;
        };
        if stamp <= earlier {
            return false;
        }
        self.previous = Some((stamp, *pose));
        let dt = stamp.since(earlier).as_secs_f64();
        let turn = wrapped(pose.yaw - before.yaw);
        let heading = before.yaw + 0.5 * turn;
        let (dx, dy) = (pose.x - before.x, pose.y - before.y);
        odometry.header.stamp = stamp;
        odometry.x = pose.x;
        odometry.y = pose.y;
        odometry.yaw = pose.yaw;
        odometry.linear = (dx * libm::cos(heading) + dy * libm::sin(heading)) / dt;
        odometry.angular = turn / dt;
        true
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;
    use std::time::Duration;

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
                let mut core = PoseOdometry::default();
                let mut odometry = Odometry::default();
                assert!(!core.update(&on_arc(linear, angular, start, 0.0), &mut odometry));
                assert!(core.update(&on_arc(linear, angular, start, dt), &mut odometry));

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
        let mut core = PoseOdometry::default();
        let mut odometry = Odometry::default();
        core.update(&pose(1.0, 0.0, 0.0, 0.0), &mut odometry);
        core.update(&pose(2.0, 3.0, 4.0, 0.5), &mut odometry);

        assert_eq!(odometry.header.stamp, Stamp::from_nanoseconds(2_000_000_000));
        let reported = [odometry.x, odometry.y, odometry.yaw];
        assert_eq!(reported.map(f64::to_bits), [3.0, 4.0, wrapped(0.5)].map(f64::to_bits));
    }

    #[test]
    fn poses_of_one_moment_have_no_velocity() {
        let mut core = PoseOdometry::default();
        let mut odometry = Odometry::default();
        core.update(&pose(1.0, 0.0, 0.0, 0.0), &mut odometry);

        assert!(!core.update(&pose(1.0, 1.0, 0.0, 0.0), &mut odometry));
        assert!(core.update(&pose(2.0, 1.0, 0.0, 0.0), &mut odometry));
        assert!((odometry.linear - 1.0).abs() < 1e-12);
    }
}
