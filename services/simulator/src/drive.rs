//! Two wheels and their encoders, after `lab.md` §1.

use std::f64::consts::TAU;

use interfaces::{JointState, LEFT, RIGHT};
use serde::{Deserialize, Serialize};

use crate::Config;

/// [-] Of an encoder in one turn of its wheel.
const TICKS_PER_TURN: f64 = 4096.0;

/// What happens to a command that asks more of a wheel than it can do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum WheelLimit {
    /// The whole command is ignored and the last valid one goes on.
    Hold,
    /// Both wheels slow down alike until the faster one can, which keeps the path's shape.
    Scale,
}

/// The two wheels.
pub(crate) struct Drive {
    dt: f64,
    wheel_radius: f64,
    track: f64,
    limit: WheelLimit,
    speed_max: f64,

    speed: [f64; 2],
    angle: [f64; 2],
    ticks: [i64; 2],
    ticks_told: [i64; 2],
    steps: u32,
    limited: u64,
}

impl Drive {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            dt: config.dt_s / f64::from(config.substeps),
            wheel_radius: config.wheel_radius_m,
            track: config.track_m,
            limit: config.wheel_limit,
            speed_max: config.wheel_speed_max_rad_s,
            speed: [0.0; 2],
            angle: [0.0; 2],
            ticks: [0; 2],
            ticks_told: [0; 2],
            steps: 0,
            limited: 0,
        }
    }

    /// Sets the wheels' speeds, as far as the limit lets it.
    pub(crate) fn command(&mut self, linear: f64, angular: f64) {
        let difference = angular * self.track / 2.0;
        let mut speed = [0.0; 2];
        speed[LEFT] = (linear - difference) / self.wheel_radius;
        speed[RIGHT] = (linear + difference) / self.wheel_radius;
        let fastest = speed[LEFT].abs().max(speed[RIGHT].abs());

        if speed.iter().all(|speed| speed.abs() <= self.speed_max) {
            self.speed = speed;
            return;
        }
        self.limited += 1;
        match self.limit {
            // A command that is not a number has no shape to keep either.
            WheelLimit::Scale if speed.iter().all(|speed| speed.is_finite()) => {
                self.speed = speed.map(|speed| speed * (self.speed_max / fastest));
            }
            WheelLimit::Scale | WheelLimit::Hold => {}
        }
    }

    /// Turns the wheels for one step: how far the axle's middle gets [m] and turns [rad], if
    /// nothing is in the way.
    pub(crate) fn advance(&mut self) -> (f64, f64) {
        let turned = self.speed.map(|speed| speed * self.dt);
        self.steps += 1;
        for side in [LEFT, RIGHT] {
            self.angle[side] += turned[side];
            self.ticks[side] = ticks(self.angle[side]);
        }
        let distance = self.wheel_radius * (turned[RIGHT] + turned[LEFT]) / 2.0;
        let turn = self.wheel_radius * (turned[RIGHT] - turned[LEFT]) / self.track;
        (distance, turn)
    }

    /// Reads the encoders: everything is whole ticks, and the speed is what they counted since they
    /// were read before.
    pub(crate) fn fill(&mut self, joint_state: &mut JointState) {
        let time = self.dt * f64::from(self.steps.max(1));
        for side in [LEFT, RIGHT] {
            let increment = radians(self.ticks[side] - self.ticks_told[side]);
            joint_state.position[side] = radians(self.ticks[side]);
            joint_state.increment[side] = increment;
            joint_state.velocity[side] = increment / time;
        }
        self.ticks_told = self.ticks;
        self.steps = 0;
    }

    pub(crate) fn limited(&self) -> u64 {
        self.limited
    }
}

/// [-] Whole ticks that an encoder has counted at this angle. Counted from the angle itself, never
/// summed up, so that what is lost in one period is found in the next.
fn ticks(angle: f64) -> i64 {
    #[expect(clippy::cast_possible_truncation, reason = "whole, and no wheel turns 2^63 ticks")]
    let ticks = (angle * TICKS_PER_TURN / TAU).floor() as i64;
    ticks
}

fn radians(ticks: i64) -> f64 {
    ticks as f64 * (TAU / TICKS_PER_TURN)
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "what must be exact is compared exactly")]
mod tests {
    use super::*;

    /// The wheels' speeds after these commands, one after the other.
    fn speeds(limit: WheelLimit, commands: &[(f64, f64)]) -> [f64; 2] {
        let mut drive = Drive::new(&Config { wheel_limit: limit, ..Config::default() });
        for &(linear, angular) in commands {
            drive.command(linear, angular);
        }
        drive.speed
    }

    #[test]
    fn a_wheel_turns_as_the_lab_says() {
        // linear, angular, left, right: (v - b w) / r and (v + b w) / r.
        let table = [
            (0.15, 0.0, 0.15 / 0.033, 0.15 / 0.033),
            (0.0, 0.5, -0.04 / 0.033, 0.04 / 0.033),
            (0.1, -1.0, 0.18 / 0.033, 0.02 / 0.033),
            (-0.22, 0.0, -0.22 / 0.033, -0.22 / 0.033),
        ];
        for (linear, angular, left, right) in table {
            let speed = speeds(WheelLimit::Hold, &[(linear, angular)]);
            assert!((speed[LEFT] - left).abs() < 1e-12, "{linear} {angular}: {speed:?}");
            assert!((speed[RIGHT] - right).abs() < 1e-12, "{linear} {angular}: {speed:?}");
        }
    }

    #[test]
    fn hold_goes_on_with_the_last_pair_and_scale_keeps_the_shape() {
        let before = speeds(WheelLimit::Hold, &[(0.1, 0.2)]);
        for asked in [(0.15, 2.0), (0.3, 0.0), (-0.15, -2.0), (0.0, 9.0)] {
            let held = speeds(WheelLimit::Hold, &[(0.1, 0.2), asked]);
            assert_eq!(held, before, "{asked:?}");

            let scaled = speeds(WheelLimit::Scale, &[(0.1, 0.2), asked]);
            let fastest = scaled[LEFT].abs().max(scaled[RIGHT].abs());
            assert!((fastest - 0.22 / 0.033).abs() < 1e-12, "{asked:?}: {scaled:?}");
            let [left, right] = [asked.0 - 0.08 * asked.1, asked.0 + 0.08 * asked.1];
            let skew = scaled[LEFT] * right - scaled[RIGHT] * left;
            assert!(skew.abs() < 1e-12, "{asked:?}: {scaled:?}");
        }
    }

    #[test]
    fn a_command_that_is_no_number_changes_nothing() {
        for limit in [WheelLimit::Hold, WheelLimit::Scale] {
            for bad in
                [(f64::NAN, 0.0), (0.1, f64::NAN), (f64::INFINITY, 0.0), (0.0, -f64::INFINITY)]
            {
                let after = speeds(limit, &[(0.1, 0.2), bad]);
                assert_eq!(after, speeds(limit, &[(0.1, 0.2)]), "{limit:?} {bad:?}");
            }
        }
    }

    #[test]
    fn the_fastest_command_is_still_a_command() {
        let mut drive = Drive::new(&Config::default());
        drive.command(0.22, 0.0);
        assert_eq!((drive.limited(), drive.speed), (0, [0.22 / 0.033; 2]));
        drive.command(0.220_001, 0.0);
        assert_eq!((drive.limited(), drive.speed), (1, [0.22 / 0.033; 2]));
    }

    #[test]
    fn what_the_encoders_cut_off_does_not_add_up() {
        let tick = TAU / TICKS_PER_TURN;
        let mut drive = Drive::new(&Config::default());
        let mut joint_state = JointState::default();
        let mut sum = [0.0; 2];
        for step in 0..100_000 {
            let steer = if step % 3 == 0 { 0.31 } else { -0.17 };
            drive.command(0.1, steer);
            drive.advance();
            drive.fill(&mut joint_state);
            for side in [LEFT, RIGHT] {
                sum[side] += joint_state.increment[side];
                let behind = drive.angle[side] - joint_state.position[side];
                assert!((-1e-9..tick + 1e-9).contains(&behind), "step {step}: {behind}");
                assert!((sum[side] - joint_state.position[side]).abs() < 1e-6, "step {step}");
            }
        }
    }

    #[test]
    fn an_encoder_counts_whole_ticks_backwards_too() {
        let tick = TAU / TICKS_PER_TURN;
        let mut drive = Drive::new(&Config::default());
        let mut joint_state = JointState::default();
        drive.command(-0.033 * 2.5 * tick / 0.05, 0.0);
        let positions = [-3.0, -5.0, -8.0];
        let increments = [-3.0, -2.0, -3.0];
        for (position, increment) in positions.into_iter().zip(increments) {
            drive.advance();
            drive.fill(&mut joint_state);
            assert_eq!(joint_state.position, [position * tick; 2]);
            assert_eq!(joint_state.increment, [increment * tick; 2]);
            assert_eq!(joint_state.velocity, [increment * tick / 0.05; 2]);
        }
    }
}
