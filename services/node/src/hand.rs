//! A person's hand on a keyboard: keys in, speeds out.
//!
//! Pure: time comes in as an argument. Keys and steps are those of ROBOTIS's `turtlebot3_teleop`, but
//! not its memory: there a speed stays until another key is pressed, whoever has left the keyboard.
//! Here it stays only while keys come. A terminal does not tell when a key is released, so what counts
//! is that a held key repeats.

use std::time::Duration;

use interfaces::Stamp;

use crate::deadman::Motion;

/// What a key asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// Faster forwards, or slower backwards.
    Faster,
    /// Slower forwards, or faster backwards.
    Slower,
    /// Turn further to the left.
    Left,
    /// Turn further to the right.
    Right,
    /// Stand still.
    Stop,
    /// No more driving.
    Quit,
    /// Nothing.
    Other,
}

/// [m/s] What one key press adds.
const LINEAR_STEP: f64 = 0.01;

/// [rad/s] What one key press adds.
const ANGULAR_STEP: f64 = 0.1;

/// Without a key for longer than this nobody is at the keyboard: the slowest of the usual delays
/// before a held key repeats is 660 ms, X11's.
pub const PATIENCE: Duration = Duration::from_secs(1);

/// What a person's hand on the keyboard asks of the robot.
#[derive(Debug, Clone)]
pub struct Hand {
    fastest: Motion,
    patience: Option<Duration>,
    linear: Steps,
    angular: Steps,
    /// When the last key was pressed; nothing before the first one.
    touched: Option<Stamp>,
}

/// [-] A speed in key presses, so that as many there and back are none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Steps(i32);

impl Hand {
    /// One that has pressed nothing yet, and asks for no more than `fastest`. Where there is no
    /// `patience`, speeds stay for ever.
    pub fn new(fastest: Motion, patience: Option<Duration>) -> Self {
        let (linear, angular) = (Steps::default(), Steps::default());
        Self { fastest, patience, linear, angular, touched: None }
    }

    /// A key was pressed at `now`.
    pub fn press(&mut self, now: Stamp, key: Key) {
        match key {
            Key::Faster => self.linear.add(1, LINEAR_STEP, self.fastest.linear),
            Key::Slower => self.linear.add(-1, LINEAR_STEP, self.fastest.linear),
            Key::Left => self.angular.add(1, ANGULAR_STEP, self.fastest.angular),
            Key::Right => self.angular.add(-1, ANGULAR_STEP, self.fastest.angular),
            Key::Stop => self.rest(),
            // A key that asks for nothing keeps what is, but begins nothing.
            Key::Other | Key::Quit if self.touched.is_none() => return,
            Key::Other | Key::Quit => {}
        }
        self.touched = Some(now);
    }

    /// How the robot shall move at `now`; nothing before the first key, since until then somebody
    /// else may drive. One that may not move is asked to rest, and what was pressed meanwhile is
    /// forgotten: it must not leap once it may.
    pub fn motion(&mut self, now: Stamp, may_move: bool) -> Option<Motion> {
        let touched = self.touched?;
        let is_left = self.patience.is_some_and(|patience| patience < now.since(touched));
        if is_left || !may_move {
            self.rest();
        }
        Some(Motion {
            linear: self.linear.speed(LINEAR_STEP, self.fastest.linear),
            angular: self.angular.speed(ANGULAR_STEP, self.fastest.angular),
        })
    }

    /// Whether it has taken the robot over.
    pub fn drives(&self) -> bool {
        self.touched.is_some()
    }

    fn rest(&mut self) {
        self.linear = Steps::default();
        self.angular = Steps::default();
    }
}

impl Steps {
    /// Never further beyond the limit than one step takes: as many back would be lost.
    fn add(&mut self, more: i32, step: f64, fastest: f64) {
        let next = self.0 + more;
        let has_room = f64::from(self.0.abs()) * step < fastest;
        if has_room || next.abs() < self.0.abs() {
            self.0 = next;
        }
    }

    fn speed(self, step: f64, fastest: f64) -> f64 {
        (f64::from(self.0) * step).clamp(-fastest, fastest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BURGER: Motion = Motion { linear: 0.22, angular: 2.84 };

    fn ms(milliseconds: u64) -> Stamp {
        Stamp::from_nanoseconds(milliseconds * 1_000_000)
    }

    fn hand() -> Hand {
        Hand::new(BURGER, Some(PATIENCE))
    }

    /// What a hand asks for that has pressed `keys` at once.
    fn pressed(keys: &[Key]) -> Motion {
        let mut hand = hand();
        for key in keys {
            hand.press(ms(0), *key);
        }
        hand.motion(ms(0), true).unwrap()
    }

    #[test]
    fn each_key_adds_its_step() {
        let table = [
            (&[Key::Faster][..], 0.01, 0.0),
            (&[Key::Slower], -0.01, 0.0),
            (&[Key::Left], 0.0, 0.1),
            (&[Key::Right], 0.0, -0.1),
            (&[Key::Faster, Key::Faster, Key::Left], 0.02, 0.1),
            (&[Key::Faster, Key::Left, Key::Stop], 0.0, 0.0),
            (&[Key::Faster, Key::Other], 0.01, 0.0),
        ];
        for (keys, linear, angular) in table {
            assert_eq!(pressed(keys), Motion { linear, angular }, "{keys:?}");
        }
    }

    #[test]
    fn as_many_keys_back_end_at_exactly_zero() {
        let there_and_back = [[Key::Faster; 17], [Key::Slower; 17]].concat();
        assert!(pressed(&there_and_back).is_zero());
    }

    #[test]
    fn no_number_of_keys_asks_for_more_than_the_limit_and_one_leads_back() {
        let fastest = Motion { linear: 0.22, angular: -2.84 };
        let keys = [[Key::Faster; 100], [Key::Right; 100]].concat();
        assert_eq!(pressed(&keys), fastest);

        let back = [&keys[..], &[Key::Slower, Key::Left]].concat();
        let slower = pressed(&back);
        assert!(slower.linear < fastest.linear && fastest.angular < slower.angular, "{slower:?}");
    }

    #[test]
    fn before_the_first_key_nobody_drives() {
        let mut hand = hand();
        hand.press(ms(0), Key::Other);

        assert_eq!(hand.motion(ms(0), true), None);
        assert!(!hand.drives());
        hand.press(ms(1), Key::Stop);
        assert_eq!(hand.motion(ms(1), true), Some(Motion::ZERO), "it was taken over, to stand");
    }

    #[test]
    fn a_hand_that_has_left_the_keyboard_stops_the_robot_and_keeps_it() {
        let mut hand = hand();
        hand.press(ms(0), Key::Faster);

        assert_eq!(hand.motion(ms(1_000), true), Some(Motion { linear: 0.01, angular: 0.0 }));
        assert_eq!(hand.motion(ms(1_001), true), Some(Motion::ZERO));
        hand.press(ms(1_002), Key::Other);
        assert_eq!(hand.motion(ms(1_002), true), Some(Motion::ZERO), "old speeds are forgotten");
    }

    #[test]
    fn any_key_keeps_the_speeds() {
        let mut hand = hand();
        hand.press(ms(0), Key::Faster);
        hand.press(ms(900), Key::Other);

        assert_eq!(hand.motion(ms(1_800), true), Some(Motion { linear: 0.01, angular: 0.0 }));
    }

    #[test]
    fn on_request_speeds_stay_without_a_key() {
        let mut hand = Hand::new(BURGER, None);
        hand.press(ms(0), Key::Left);

        assert_eq!(hand.motion(ms(3_600_000), true), Some(Motion { linear: 0.0, angular: 0.1 }));
    }

    #[test]
    fn a_robot_that_may_not_move_is_asked_to_rest_and_does_not_leap_afterwards() {
        let mut hand = Hand::new(BURGER, None);
        hand.press(ms(0), Key::Faster);
        assert_eq!(hand.motion(ms(0), false), Some(Motion::ZERO));

        assert_eq!(hand.motion(ms(1), true), Some(Motion::ZERO));
        hand.press(ms(2), Key::Faster);
        assert_eq!(hand.motion(ms(2), true), Some(Motion { linear: 0.01, angular: 0.0 }));
    }
}
