//! The OpenCR's firmware: its control table, what it does with it, and its watchdog.
//!
//! Source: ROBOTIS-GIT/OpenCR, turtlebot3 firmware V221004R1.

use std::time::Duration;

use interfaces::Stamp;

use crate::STEP;
use crate::bus::{Asked, Receiver, answer};
use crate::motors::Motors;

/// Between two motor cycles, at which the table is gathered anew.
const CYCLE: Duration = Duration::from_millis(20);

/// Without a heartbeat that changes, for so long, the board stops the motors.
const WATCHDOG: Duration = Duration::from_millis(500);

/// [m/s, rad/s] What commands are bound to.
const LINEAR_MAX: f64 = 0.2108;
const ANGULAR_MAX: f64 = 2.635;

/// [byte] The table's size.
const TABLE: usize = 346;

/// The table's items: address and length.
const ITEMS: [(usize, usize); 50] = [
    (0, 2),
    (2, 4),
    (6, 1),
    (7, 1),
    (9, 1),
    (10, 4),
    (14, 1),
    (15, 1),
    (16, 1),
    (18, 1),
    (19, 1),
    (20, 1),
    (21, 1),
    (22, 1),
    (23, 1),
    (26, 1),
    (27, 1),
    (28, 1),
    (29, 1),
    (30, 2),
    (34, 4),
    (38, 4),
    (42, 4),
    (46, 4),
    (50, 1),
    (59, 1),
    (60, 4),
    (64, 4),
    (68, 4),
    (72, 4),
    (76, 4),
    (80, 4),
    (84, 4),
    (88, 4),
    (92, 4),
    (96, 4),
    (100, 4),
    (104, 4),
    (108, 4),
    (120, 4),
    (124, 4),
    (128, 4),
    (132, 4),
    (136, 4),
    (140, 4),
    (148, 1),
    (149, 1),
    (150, 24),
    (174, 4),
    (178, 4),
];

/// What the robot around the board is like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Body {
    /// [rad] Where it heads.
    pub(crate) heading: f64,
    /// [rad/s] How it turns.
    pub(crate) turning: f64,
    /// [V] Of the battery.
    pub(crate) voltage: f64,
    /// Whether button 1 is pressed.
    pub(crate) button: bool,
}

/// The board.
#[derive(Debug)]
pub(crate) struct Firmware {
    table: [u8; TABLE],
    receiver: Receiver,
    motors: Motors,
    began: Stamp,
    cycle_due: Stamp,
    heartbeat: u8,
    beat: Stamp,
    is_alive: bool,
    blocked_until: Option<Stamp>,
    calibration: Duration,
    /// [rad] The heading at which the gyro was calibrated.
    zero: f64,
    hangs: bool,
    sound: Option<u8>,
}

impl Firmware {
    /// A board that is switched on at `now`; its gyro takes `calibration`.
    pub(crate) fn new(now: Stamp, calibration: Duration) -> Self {
        let mut firmware = Self {
            table: [0; TABLE],
            receiver: Receiver::default(),
            motors: Motors::default(),
            began: now,
            cycle_due: now,
            heartbeat: 0,
            beat: Stamp::ZERO,
            is_alive: false,
            blocked_until: None,
            calibration,
            zero: 0.0,
            hangs: false,
            sound: None,
        };
        firmware.put(0, &0x5000_u16.to_le_bytes());
        firmware.put(2, &1_u32.to_le_bytes());
        firmware.put(6, &[5, 200, 0, 2]);
        // It finds its motors and gives them power.
        firmware.put(148, &[1, 1]);
        firmware
    }

    /// Whether it is too busy to listen.
    pub(crate) fn is_blocked(&self) -> bool {
        self.blocked_until.is_some()
    }

    /// From now on it gathers nothing anew, but answers.
    pub(crate) fn hang(&mut self, hangs: bool) {
        self.hangs = hangs;
    }

    /// The motors lose their power, or get it.
    pub(crate) fn power(&mut self, on: bool) {
        self.put(149, &[u8::from(on)]);
    }

    /// Whether the wheels turn.
    pub(crate) fn turns(&self) -> bool {
        self.motors.speed() != [0; 2]
    }

    /// The melody that was asked for since somebody last looked.
    pub(crate) fn take_sound(&mut self) -> Option<u8> {
        self.sound.take()
    }

    /// Whether the heart of whoever drives it beats.
    pub(crate) fn is_alive(&self) -> bool {
        self.is_alive
    }

    /// One step of the motors: the robot's speed [m/s] and turning speed [rad/s].
    pub(crate) fn step(&mut self) -> (f64, f64) {
        self.motors.step()
    }

    /// The main loop, once: hears what has come and says what is to be said.
    pub(crate) fn turn(&mut self, now: Stamp, heard: &[u8], body: &Body) -> Vec<u8> {
        let mut said = Vec::new();
        self.receiver.push(heard);
        if let Some(until) = self.blocked_until {
            if now < until {
                return said;
            }
            self.blocked_until = None;
            self.zero = body.heading;
            self.put(59, &[0]);
            said = answer(0, &[]);
        }
        while let Some(asked) = self.receiver.next() {
            let answer = self.serve(now, &asked);
            if self.is_blocked() {
                break;
            }
            said.extend(answer);
        }
        self.watch(now);
        if self.cycle_due <= now {
            self.cycle_due = self.cycle_due.after(CYCLE).max(now.before(CYCLE));
            if !self.hangs {
                self.gather(now, body);
            }
            self.drive(body);
        }
        said
    }

    fn serve(&mut self, now: Stamp, asked: &Asked) -> Vec<u8> {
        match asked {
            Asked::Ping => answer(0, &[self.table[0], self.table[1], self.table[6]]),
            Asked::Read { address, length } => {
                let mut data = vec![0; *length];
                // Only items that are wholly asked for; nothing is ever refused.
                for (item, size) in ITEMS {
                    if *address <= item && item + size <= address + length {
                        let begin = item - address;
                        data[begin..begin + size].copy_from_slice(&self.table[item..item + size]);
                    }
                }
                answer(0, &data)
            }
            Asked::Write { address, data } => {
                let mut error = 0;
                for (item, size) in ITEMS {
                    if *address <= item && item + size <= address + data.len() {
                        let begin = item - address;
                        self.put(item, &data[begin..begin + size]);
                        error = self.written(now, item).unwrap_or(error);
                    }
                }
                answer(error, &[])
            }
        }
    }

    /// What happens when an item was written; an error where that is not allowed.
    fn written(&mut self, now: Stamp, item: usize) -> Option<u8> {
        match item {
            2 => {
                self.put(2, &1_u32.to_le_bytes());
                return Some(7);
            }
            19 => {
                if self.heartbeat != self.table[19] {
                    self.beat = now;
                }
                self.heartbeat = self.table[19];
            }
            50 => self.sound = Some(self.table[50]),
            59 if self.table[59] == 1 => self.blocked_until = Some(now.after(self.calibration)),
            _ => {}
        }
        None
    }

    fn watch(&mut self, now: Stamp) {
        self.is_alive = self.beat != Stamp::ZERO && now.since(self.beat) < WATCHDOG;
        self.put(15, &[u8::from(self.is_alive)]);
    }

    /// The motors are told what the command says; without a heartbeat that is forgotten first.
    fn drive(&mut self, body: &Body) {
        if !self.is_alive {
            self.put(150, &[0; 24]);
        }
        if self.table[149] == 0 || body.voltage < 11.0 {
            self.power(false);
            self.motors.cut();
            return;
        }
        let linear = f64::from(self.signed(150)) * 0.01;
        let angular = f64::from(self.signed(170)) * 0.01;
        self.motors.command(
            linear.clamp(-LINEAR_MAX, LINEAR_MAX),
            angular.clamp(-ANGULAR_MAX, ANGULAR_MAX),
        );
    }

    fn gather(&mut self, now: Stamp, body: &Body) {
        let millis = now.since(self.began).as_millis() & 0xffff_ffff;
        self.put(10, &u32::try_from(millis).unwrap_or_default().to_le_bytes());
        self.put(26, &[u8::from(body.button)]);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "small, positive"
        )]
        let words = [body.voltage * 100.0, (body.voltage - 10.5) / 1.8 * 10_000.0]
            .map(|value| value.round().max(0.0) as u32);
        self.put(42, &words[0].to_le_bytes());
        if 10.5 <= body.voltage {
            self.put(46, &words[1].to_le_bytes());
        }
        self.put_float(68, body.turning);
        self.put_float(80, 9.806_65);
        let half = (body.heading - self.zero) / 2.0;
        self.put_float(96, libm::cos(half));
        self.put_float(108, libm::sin(half));
        let pairs = [(128, self.motors.speed()), (136, self.motors.ticks())];
        for (address, pair) in pairs {
            self.put(address, &pair[0].to_le_bytes());
            self.put(address + 4, &pair[1].to_le_bytes());
        }
    }

    fn put(&mut self, address: usize, bytes: &[u8]) {
        self.table[address..address + bytes.len()].copy_from_slice(bytes);
    }

    fn put_float(&mut self, address: usize, value: f64) {
        #[expect(clippy::cast_possible_truncation, reason = "the board has single precision")]
        let value = value as f32;
        self.put(address, &value.to_le_bytes());
    }

    fn signed(&self, address: usize) -> i32 {
        let mut bytes = [0; 4];
        bytes.copy_from_slice(&self.table[address..address + 4]);
        i32::from_le_bytes(bytes)
    }
}

/// The motors turn in whole steps between two of the firmware's cycles.
const _: () = assert!(CYCLE.as_millis().is_multiple_of(STEP.as_millis()));

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vectors::bytes;

    const BODY: Body = Body { heading: 0.0, turning: 0.0, voltage: 12.0, button: false };

    fn at(milliseconds: u64) -> Stamp {
        Stamp::ZERO.after(Duration::from_millis(1_000 + milliseconds))
    }

    fn board() -> Firmware {
        Firmware::new(at(0), Duration::from_millis(200))
    }

    fn command(linear: i32) -> Asked {
        let mut data = vec![0; 24];
        data[..4].copy_from_slice(&linear.to_le_bytes());
        Asked::Write { address: 150, data }
    }

    /// Runs the board, with a heartbeat every 100 ms while `beats`.
    fn run(board: &mut Firmware, from: u64, until: u64, beats: bool) {
        for time in from..until {
            if beats && time.is_multiple_of(100) {
                let data = vec![board.heartbeat.wrapping_add(1)];
                board.serve(at(time), &Asked::Write { address: 19, data });
            }
            board.turn(at(time), &[], &BODY);
        }
    }

    // Broken on purpose: with a watchdog that wants any heartbeat instead of a changing one.
    #[test]
    fn without_a_heartbeat_that_changes_the_wheels_stop_and_wait_for_a_new_command() {
        let mut board = board();
        run(&mut board, 0, 100, true);
        board.serve(at(100), &command(15));
        run(&mut board, 100, 1_000, true);
        assert!(board.turns());
        // The same value again and again is no heartbeat.
        let same = Asked::Write { address: 19, data: vec![board.heartbeat] };
        for time in 1_000..1_500 {
            board.serve(at(time), &same);
            board.turn(at(time), &[], &BODY);
        }
        assert!(!board.turns());
        // The heart beats again; the command from before is forgotten.
        run(&mut board, 1_500, 2_000, true);
        assert!(!board.turns());
        board.serve(at(2_000), &command(15));
        run(&mut board, 2_000, 2_040, true);
        assert!(board.turns());
        // There is no time-out of commands.
        run(&mut board, 2_040, 9_000, true);
        assert!(board.turns());
    }

    #[test]
    fn a_command_to_a_board_that_believes_us_dead_is_undone() {
        let mut board = board();
        board.serve(at(0), &command(15));
        run(&mut board, 0, 100, false);
        assert!(!board.turns());
        run(&mut board, 100, 300, true);
        assert!(!board.turns());
    }

    #[test]
    fn only_whole_items_are_read_and_what_is_between_them_is_zero() {
        let mut board = board();
        // Half of the model number, the model information whole, half of the battery's voltage.
        assert_eq!(
            board.serve(at(0), &Asked::Read { address: 1, length: 5 }),
            answer(0, &[0, 1, 0, 0, 0])
        );
        board.gather(at(0), &BODY);
        assert_eq!(board.serve(at(0), &Asked::Read { address: 43, length: 3 }), answer(0, &[0; 3]));
        let far = Asked::Read { address: 9_000, length: 4 };
        assert_eq!(board.serve(at(0), &far), answer(0, &[0; 4]), "nothing is refused");
        let read_only = Asked::Write { address: 2, data: vec![9; 4] };
        assert_eq!(board.serve(at(0), &read_only), answer(7, &[]));
    }

    #[test]
    fn while_it_calibrates_it_hears_nobody_and_answers_after_that() {
        let mut board = board();
        let asked = [bytes("write_imu_recalibration"), bytes("read_model_number")].concat();
        assert_eq!(board.turn(at(0), &asked, &BODY), [0; 0]);
        assert!(board.is_blocked());
        assert_eq!(board.turn(at(199), &[], &BODY), [0; 0]);
        let both = [bytes("write_ok_reply"), bytes("read_model_number_reply")].concat();
        assert_eq!(board.turn(at(200), &[], &BODY), both);
    }

    #[test]
    fn an_empty_battery_cuts_the_motors_power() {
        let mut board = board();
        run(&mut board, 0, 100, true);
        board.serve(at(100), &command(15));
        run(&mut board, 100, 200, true);
        board.turn(at(220), &[], &Body { voltage: 10.9, ..BODY });
        assert!(!board.turns());
        assert_eq!(board.table[149], 0);
    }
}
