//! Forward kinematics: from what the wheels turned to where the robot is.

use interfaces::{JointState, LEFT, Odometry, RIGHT, Stamp};
use nalgebra::{Isometry2, UnitComplex, Vector2};

use crate::{Config, wrapped};

/// Below this half turn the chord is as long as the arc, to the last bit.
const HALF_TURN_TINY: f64 = 1e-4;

/// Pose and velocity of a robot with two driven wheels.
#[derive(Debug, Clone)]
pub struct WheelOdometry {
    wheel_radius: f64,
    track: f64,
    odom_from_base: Isometry2<f64>,
    yaw: f64,
    previous: Option<(Stamp, [f64; 2])>,
}

impl WheelOdometry {
    /// A robot at rest where the configuration says.
    pub fn new(config: &Config) -> Self {
        let yaw = wrapped(config.yaw_rad);
        Self {
            wheel_radius: config.wheel_radius_m,
            track: config.track_m,
            odom_from_base: Isometry2::from_parts(
                Vector2::new(config.x_m, config.y_m).into(),
                rotation(yaw),
            ),
            yaw,
            previous: None,
        }
    }

    /// Moves on by what the wheels turned since the sample before, on an exact arc, and writes pose
    /// and velocity into `odometry`. False, and nothing written, where no time has passed.
    ///
    /// With r the wheel's radius and 2b the track: v = r/2 (left + right), w = r/2b (right - left).
    /// The first sample counts by its own increments and speeds; later ones by the difference of
    /// angles, so that a lost sample loses no distance.
    pub fn update(&mut self, wheels: &JointState, odometry: &mut Odometry) -> bool {
        let stamp = wheels.header.stamp;
        let previous = self.previous.replace((stamp, wheels.position));
        let (turned, speed) = match previous {
            None => (wheels.increment, wheels.velocity),
            Some((earlier, _)) if stamp <= earlier => {
                self.previous = previous;
                return false;
            }
            Some((earlier, angles)) => {
                let dt = stamp.since(earlier).as_secs_f64();
                let turned = [LEFT, RIGHT].map(|wheel| wheels.position[wheel] - angles[wheel]);
                (turned, turned.map(|angle| angle / dt))
            }
        };
        let (distance, turn) = self.forward(turned);
        let (linear, angular) = self.forward(speed);
        self.advance(distance, turn);
        odometry.header.stamp = stamp;
        odometry.x = self.odom_from_base.translation.x;
        odometry.y = self.odom_from_base.translation.y;
        odometry.yaw = self.yaw;
        odometry.linear = linear;
        odometry.angular = angular;
        true
    }

    /// Wheel angles to distance and turn, or wheel speeds to speed and turning speed.
    fn forward(&self, wheels: [f64; 2]) -> (f64, f64) {
        let along = self.wheel_radius / 2.0 * (wheels[LEFT] + wheels[RIGHT]);
        let about = self.wheel_radius / self.track * (wheels[RIGHT] - wheels[LEFT]);
        (along, about)
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

fn rotation(yaw: f64) -> UnitComplex<f64> {
    UnitComplex::from_cos_sin_unchecked(libm::cos(yaw), libm::sin(yaw))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;
    use std::time::Duration;

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
            core.update(&wheels(linear, angular, f64::from(step) * dt), &mut odometry);
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

    #[test]
    fn a_lost_sample_loses_no_distance() {
        let mut core = WheelOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        for time in [0.0, 0.05, 0.20] {
            assert!(core.update(&wheels(0.2, 0.0, time), &mut odometry));
        }

        assert!((odometry.x - 0.04).abs() < 1e-12);
        assert!((odometry.linear - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_sample_that_is_no_newer_changes_nothing() {
        let mut core = WheelOdometry::new(&Config::default());
        let mut odometry = Odometry::default();
        core.update(&wheels(0.2, 0.0, 0.1), &mut odometry);
        let before = odometry;

        assert!(!core.update(&wheels(0.2, 0.0, 0.1), &mut odometry));
        assert!(!core.update(&wheels(0.2, 0.0, 0.05), &mut odometry));
        assert_eq!(odometry, before);
        assert!(core.update(&wheels(0.2, 0.0, 0.15), &mut odometry));
        assert!((odometry.linear - 0.2).abs() < 1e-12);
    }

    #[test]
    fn heading_stays_wrapped() {
        let end = drive(0.0, 1.0, 0.05, 80);

        assert!((end.yaw - (4.0 - 2.0 * PI)).abs() < 1e-9);
    }
}
