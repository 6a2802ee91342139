//! The OpenCR's control table: what lies at which address, in which unit.
//!
//! Source: ROBOTIS-GIT/OpenCR, turtlebot3 firmware V221004R1. Little endian; addresses in bytes.

use node::deadman::Motion;

/// [-] The board's number on the bus.
pub const ID: u8 = 200;

/// [-] What a TurtleBot3's board answers for its model.
pub const MODEL_NUMBER: u16 = 0x5000;

/// [byte] Model number.
pub const ADDRESS_MODEL_NUMBER: u16 = 0;

/// [byte] Model information (1 is a Burger) and firmware version, five bytes in all.
pub const ADDRESS_MODEL: u16 = 2;

/// [byte] The heartbeat: any value that changes.
pub const ADDRESS_HEARTBEAT: u16 = 19;

/// [byte] Melodies; see [`crate::Sound`].
pub const ADDRESS_SOUND: u16 = 50;

/// [byte] 1: measure the gyro's bias anew, which takes up to 5 s.
pub const ADDRESS_IMU_RECALIBRATION: u16 = 59;

/// [byte] Whether the motors hold the wheels.
pub const ADDRESS_TORQUE: u16 = 149;

/// [byte] The commanded velocity.
pub const ADDRESS_COMMAND: u16 = 150;

/// [byte] Where the block begins that is read again and again.
pub const ADDRESS_BLOCK: u16 = 10;

/// [byte] How long it is.
pub const BLOCK: usize = 172;

/// [m/s] The firmware's own limit: 61 rpm of a wheel of 33 mm.
pub const FIRMWARE_LINEAR_MAX: f64 = 0.2108;

/// [rad/s] The firmware's own limit: both wheels so fast against each other.
pub const FIRMWARE_ANGULAR_MAX: f64 = 2.635;

/// What the board says about itself and its robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// [ms] Since the board started, when it gathered all this; wraps.
    pub millis: u32,
    /// [-] 0 where the board is well, -1 where it finds no motors.
    pub device_status: i8,
    /// [-] The last heartbeat that it was given.
    pub heartbeat: u8,
    /// [-] Whether buttons 1 and 2 are pressed.
    pub buttons: [bool; 2],
    /// [-] Whether bumpers 1 and 2 are pressed.
    pub bumpers: [bool; 2],
    /// [V] Of the battery.
    pub battery_voltage: f64,
    /// [-] Charge of the battery, 0 to 1: what the board makes of its voltage.
    pub battery_charge: f64,
    /// [rad/s] Turning speed about x, y and z of the board.
    pub angular_velocity: [f32; 3],
    /// [m/s^2] Along x, y and z of the board, gravity included.
    pub linear_acceleration: [f32; 3],
    /// [T] Along x, y and z of the board.
    pub magnetic_field: [f32; 3],
    /// [-] The board's own estimate of how it stands: w, x, y, z.
    pub orientation: [f32; 4],
    /// [-] Current of the left and the right motor, in the motor's own unit.
    pub current: [i32; 2],
    /// [0.229 rpm] Of the left and the right wheel.
    pub velocity: [i32; 2],
    /// [ticks] Of the left and the right wheel, 4096 to a turn; wraps.
    pub ticks: [i32; 2],
    /// [-] Whether the board finds its motors.
    pub has_motors: bool,
    /// [-] Whether the motors hold the wheels.
    pub has_torque: bool,
}

impl Reading {
    /// From the block at [`ADDRESS_BLOCK`].
    pub fn parse(block: &[u8; BLOCK]) -> Self {
        let table = Table(block);
        Self {
            millis: table.unsigned(10),
            device_status: i8::from_le_bytes(table.bytes(18)),
            heartbeat: table.byte(19),
            buttons: [26, 27].map(|address| table.flag(address)),
            bumpers: [28, 29].map(|address| table.flag(address)),
            battery_voltage: f64::from(table.unsigned(42)) * 0.01,
            // 0.01 %; the firmware's line goes on beyond its ends.
            battery_charge: (f64::from(table.unsigned(46)) * 1e-4).clamp(0.0, 1.0),
            angular_velocity: [60, 64, 68].map(|address| table.float(address)),
            linear_acceleration: [72, 76, 80].map(|address| table.float(address)),
            magnetic_field: [84, 88, 92].map(|address| table.float(address)),
            orientation: [96, 100, 104, 108].map(|address| table.float(address)),
            current: [120, 124].map(|address| table.signed(address)),
            velocity: [128, 132].map(|address| table.signed(address)),
            ticks: [136, 140].map(|address| table.signed(address)),
            has_motors: table.flag(148),
            has_torque: table.flag(149),
        }
    }
}

/// The block, by the table's own addresses.
struct Table<'a>(&'a [u8; BLOCK]);

impl Table<'_> {
    fn bytes<const N: usize>(&self, address: usize) -> [u8; N] {
        let begin = address - usize::from(ADDRESS_BLOCK);
        let mut bytes = [0; N];
        bytes.copy_from_slice(&self.0[begin..begin + N]);
        bytes
    }

    fn byte(&self, address: usize) -> u8 {
        self.bytes::<1>(address)[0]
    }

    fn flag(&self, address: usize) -> bool {
        self.byte(address) != 0
    }

    fn unsigned(&self, address: usize) -> u32 {
        u32::from_le_bytes(self.bytes(address))
    }

    fn signed(&self, address: usize) -> i32 {
        i32::from_le_bytes(self.bytes(address))
    }

    fn float(&self, address: usize) -> f32 {
        f32::from_le_bytes(self.bytes(address))
    }
}

/// A velocity as the board takes it: hundredths of m/s and of rad/s.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Words {
    /// [0.01 m/s] Along x.
    pub linear: i32,
    /// [0.01 rad/s] About z.
    pub angular: i32,
}

impl Words {
    /// The nearest that the board can be told, halves away from zero.
    ///
    /// `turtlebot3_node` cuts off instead, so that there 0.29 is 28 and a robot is never quite as
    /// fast as it is told; here it is 29.
    pub fn nearest(motion: Motion) -> Self {
        Self { linear: hundredths(motion.linear), angular: hundredths(motion.angular) }
    }

    /// Whether this is no motion at all.
    pub fn is_zero(self) -> bool {
        self == Self::default()
    }

    /// The 24 bytes at [`ADDRESS_COMMAND`]: linear x, y, z, then angular x, y, z.
    pub fn to_bytes(self) -> [u8; 24] {
        let mut bytes = [0; 24];
        bytes[..4].copy_from_slice(&self.linear.to_le_bytes());
        bytes[20..].copy_from_slice(&self.angular.to_le_bytes());
        bytes
    }
}

fn hundredths(value: f64) -> i32 {
    #[expect(clippy::cast_possible_truncation, reason = "whole; beyond an i32 it saturates")]
    let word = (value * 100.0).round() as i32;
    word
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_velocity_is_rounded_to_the_nearest_word() {
        let table = [
            (0.22, 0.0, 22, 0),
            (-0.10, 1.00, -10, 100),
            // What is cut off is 0.28 and 2.83.
            (0.29, -2.84, 29, -284),
            (0.004, -0.004, 0, 0),
            (0.005, -0.005, 1, -1),
            (-0.0, 0.0, 0, 0),
            (f64::MAX, f64::MIN, i32::MAX, i32::MIN),
            (f64::NAN, 0.0, 0, 0),
        ];
        for (linear, angular, expected_linear, expected_angular) in table {
            let words = Words::nearest(Motion { linear, angular });
            let expected = Words { linear: expected_linear, angular: expected_angular };
            assert_eq!(words, expected, "{linear} {angular}");
        }
    }

    #[test]
    fn charge_is_a_share_whatever_the_board_says() {
        for (word, expected) in [(0_u32, 0.0), (7_611, 0.7611), (10_000, 1.0), (11_111, 1.0)] {
            let mut block = [0; BLOCK];
            block[36..40].copy_from_slice(&word.to_le_bytes());
            let charge = Reading::parse(&block).battery_charge;
            assert!((charge - expected).abs() < 1e-12, "{word}: {charge}");
        }
    }
}
