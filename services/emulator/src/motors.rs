//! The two motors, as the firmware commands them and as they turn.

use std::f64::consts::TAU;

use crate::STEP;

/// [m] Radius of a wheel, and half of what is between them.
const WHEEL_RADIUS: f64 = 0.033;
const HALF_TRACK: f64 = 0.08;

/// [1/(m/s)] The motor's unit, 0.229 rpm, per speed of the rim.
const UNITS: f64 = 1_263.632_956_882;

/// [0.229 rpm] The firmware's bound of a goal, and what a motor does at 12 V: 61 rpm.
const GOAL_MAX: i32 = 337;
const TURNING_MAX: i32 = 266;

/// [-] Ticks of an encoder in one turn.
const TICKS: f64 = 4096.0;

/// Both motors, left and right.
#[derive(Debug, Clone, Default)]
pub(crate) struct Motors {
    /// [0.229 rpm] What each was told.
    goal: [i32; 2],
    /// [turns] What each has turned.
    turned: [f64; 2],
}

impl Motors {
    /// The firmware's motor cycle: a speed [m/s] and a turning speed [rad/s] become two goals.
    pub(crate) fn command(&mut self, linear: f64, angular: f64) {
        let rims = [linear - angular * HALF_TRACK, linear + angular * HALF_TRACK];
        self.goal = rims.map(|rim| {
            #[expect(clippy::cast_possible_truncation, reason = "as the firmware does")]
            let goal = (rim * UNITS) as i32;
            goal.clamp(-GOAL_MAX, GOAL_MAX)
        });
    }

    /// Without power the wheels stand.
    pub(crate) fn cut(&mut self) {
        self.goal = [0; 2];
    }

    /// [0.229 rpm] How fast they turn.
    pub(crate) fn speed(&self) -> [i32; 2] {
        self.goal.map(|goal| goal.clamp(-TURNING_MAX, TURNING_MAX))
    }

    /// Turns for one [`STEP`]; returns the robot's speed [m/s] and turning speed [rad/s].
    pub(crate) fn step(&mut self) -> (f64, f64) {
        let turns = self.speed().map(|units| f64::from(units) * 0.229 / 60.0);
        for (turned, turns) in self.turned.iter_mut().zip(turns) {
            *turned += turns * STEP.as_secs_f64();
        }
        let [left, right] = turns.map(|turns| turns * TAU * WHEEL_RADIUS);
        (f64::midpoint(left, right), (right - left) / (2.0 * HALF_TRACK))
    }

    /// [ticks] What the encoders say; wraps at 32 bits.
    pub(crate) fn ticks(&self) -> [i32; 2] {
        self.turned.map(|turned| {
            #[expect(
                clippy::cast_possible_truncation,
                reason = "wraps as the motor's counter does"
            )]
            let ticks = (turned * TICKS).floor() as i64 as i32;
            ticks
        })
    }

    /// The encoders count from elsewhere.
    #[cfg(test)]
    pub(crate) fn set_turned(&mut self, turned: [f64; 2]) {
        self.turned = turned;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_drives_as_it_is_told_as_far_as_its_motors_can() {
        // Told, then what comes of it: 0.22 m/s is more than the motors have.
        let table = [
            ((0.15, 0.0), (0.15, 0.0)),
            ((0.0, -0.37), (0.0, -0.37)),
            ((0.1, 0.5), (0.1, 0.5)),
            ((0.22, 0.0), (0.2105, 0.0)),
        ];
        for ((linear, angular), expected) in table {
            let mut motors = Motors::default();
            motors.command(linear, angular);
            let (linear, angular) = motors.step();
            assert!((linear - expected.0).abs() < 1e-3, "{linear} not {expected:?}");
            assert!((angular - expected.1).abs() < 0.02, "{angular} not {expected:?}");
        }
    }

    #[test]
    fn encoders_count_down_and_wrap() {
        let mut motors = Motors::default();
        motors.set_turned([524_287.999_9, -0.000_1]);
        assert_eq!(motors.ticks(), [i32::MAX, -1]);
        motors.set_turned([524_288.000_1, 0.000_3]);
        assert_eq!(motors.ticks(), [i32::MIN, 1]);
    }
}
