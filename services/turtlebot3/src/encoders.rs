//! The wheels' encoders: from the board's ticks to the angles that the wheels have turned.

use std::f64::consts::TAU;

use interfaces::JointState;

/// [rad] One tick of an encoder.
pub const TICK: f64 = TAU / 4096.0;

/// [rad/s] One step of a motor's speed, 0.229 rpm.
pub const SPEED_STEP: f64 = 0.229 * TAU / 60.0;

/// Both wheels' encoders, [`LEFT`](interfaces::LEFT) and [`RIGHT`](interfaces::RIGHT).
#[derive(Debug, Clone, Default)]
pub struct Encoders {
    ticks: [i64; 2],
    last: Option<[i32; 2]>,
}

impl Encoders {
    /// Takes a reading and writes it into `joints`, all but the header: angles with this reading's
    /// own increment, where `turtlebot3_node` tells those of the reading before; speeds in rad/s,
    /// where it tells m/s at the rim.
    ///
    /// The board's counters wrap at 32 bits; the angle goes on. `velocity` in steps of
    /// [`SPEED_STEP`].
    pub fn update(&mut self, ticks: [i32; 2], velocity: [i32; 2], joints: &mut JointState) {
        let last = *self.last.get_or_insert(ticks);
        for wheel in [0, 1] {
            let increment = i64::from(ticks[wheel].wrapping_sub(last[wheel]));
            self.ticks[wheel] += increment;
            joints.position[wheel] = self.ticks[wheel] as f64 * TICK;
            joints.increment[wheel] = increment as f64 * TICK;
            joints.velocity[wheel] = f64::from(velocity[wheel]) * SPEED_STEP;
        }
        self.last = Some(ticks);
    }

    /// The board was started anew, and counts from elsewhere: the angles stay.
    pub fn rebase(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn update(encoders: &mut Encoders, ticks: [i32; 2]) -> JointState {
        let mut joints = JointState::default();
        encoders.update(ticks, [100, -100], &mut joints);
        joints
    }

    fn assert_near(values: [f64; 2], expected: [f64; 2]) {
        for (value, expected) in values.into_iter().zip(expected) {
            assert!((value - expected).abs() < 1e-9, "{value}, expected {expected}");
        }
    }

    #[test]
    fn angles_count_from_the_first_reading_and_have_no_lag() {
        let mut encoders = Encoders::default();
        assert_near(update(&mut encoders, [4096, -2048]).position, [0.0, 0.0]);
        let joints = update(&mut encoders, [4096 + 1024, -2048 - 4096]);
        assert_near(joints.position, [TAU / 4.0, -TAU]);
        assert_near(joints.increment, [TAU / 4.0, -TAU]);
        // 22.9 rpm.
        assert_near(joints.velocity, [2.398_082_392_240_817, -2.398_082_392_240_817]);
    }

    // Broken on purpose: with a plain difference the wheel turned back a million times.
    #[test]
    fn a_counter_that_wraps_goes_on() {
        let mut encoders = Encoders::default();
        update(&mut encoders, [i32::MAX - 5, i32::MIN + 5]);
        let joints = update(&mut encoders, [i32::MIN + 4, i32::MAX - 4]);
        assert_near(joints.increment, [10.0 * TICK, -10.0 * TICK]);
        assert_near(joints.position, [10.0 * TICK, -10.0 * TICK]);
    }

    #[test]
    fn a_board_that_counts_from_elsewhere_has_turned_no_wheel() {
        let mut encoders = Encoders::default();
        update(&mut encoders, [0, 0]);
        update(&mut encoders, [100, 200]);
        encoders.rebase();
        let joints = update(&mut encoders, [0, 0]);
        assert_near(joints.position, [100.0 * TICK, 200.0 * TICK]);
        assert_near(joints.increment, [0.0, 0.0]);
    }
}
