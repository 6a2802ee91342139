//! What a robot says about itself beside its wheels and its LiDAR, and what its board is asked.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use crate::Header;

/// How the robot stands and is moved, in `imu_link`, after `sensor_msgs/Imu` without covariances.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("Imu/1")]
#[repr(C)]
pub struct Imu {
    /// Stamp of the measurement, sequence, epoch.
    pub header: Header,
    /// [-] Quaternion x, y, z, w; the heading is the sensor's own estimate, and drifts.
    pub orientation: [f64; 4],
    /// [rad/s] About x, y, z.
    pub angular_velocity: [f64; 3],
    /// [m/s^2] Along x, y, z, gravity included.
    pub linear_acceleration: [f64; 3],
}

/// The robot's battery, after `sensor_msgs/BatteryState`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("BatteryState/1")]
#[repr(C)]
pub struct BatteryState {
    /// Stamp of the measurement, sequence, epoch.
    pub header: Header,
    /// [V] Of the whole battery.
    pub voltage: f64,
    /// [-] Charge, 0 to 1.
    pub percentage: f64,
}

/// The robot's buttons and motors, after `turtlebot3_msgs/SensorState`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("SensorState/1")]
#[repr(C)]
pub struct SensorState {
    /// Stamp of the measurement, sequence, epoch.
    pub header: Header,
    /// [ticks] Of the left and the right encoder, 4096 to a turn; wraps.
    pub encoder_ticks: [i32; 2],
    /// [-] Current of the left and the right motor, in the motor's own unit.
    pub motor_current: [i32; 2],
    /// [-] 1 for each bumper that is pressed, else 0.
    pub bumper: [u8; 2],
    /// [-] 1 for each button that is pressed, else 0.
    pub button: [u8; 2],
    /// [-] 1 while the motors hold the wheels, else 0.
    pub torque: u8,
    /// [-] 1 where the board is well, 0 where it finds no motors.
    pub motors: u8,
    /// [-] Version of the board's firmware.
    pub firmware: u8,
    /// [-] Zero.
    pub reserved: u8,
}

/// What a robot's board is asked by anybody, after TurtleBot3's services `sound` and `motor_power`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("BoardRequest/1")]
#[repr(C)]
pub struct BoardRequest {
    /// Stamp of the request, sequence, epoch.
    pub header: Header,
    /// [-] 1: play `sound`; else 0.
    pub asks_sound: u8,
    /// [-] 0 off, 1 on, 2 low battery, 3 error, 4 button 1, 5 button 2.
    pub sound: u8,
    /// [-] 1: switch the motors as `torque` says; else 0.
    pub asks_torque: u8,
    /// [-] 1: the motors hold the wheels; 0: they let go.
    pub torque: u8,
    /// [-] Zero.
    pub reserved: [u8; 4],
}

/// Sizes are part of the agreement: a change is a new type name and a line in the changelog.
const _: () = {
    assert!(size_of::<Imu>() == 104);
    assert!(size_of::<BatteryState>() == 40);
    assert!(size_of::<SensorState>() == 48);
    assert!(size_of::<BoardRequest>() == 32);
};
