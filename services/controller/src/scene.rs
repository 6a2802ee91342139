//! What a LiDAR sees between straight walls, for tests.

use interfaces::{LaserScan, Odometry, Stamp};

/// [m] A wall from one point to another, in `base_link`.
pub(crate) type Segment = ([f64; 2], [f64; 2]);

/// [m] Behind the axle, as the default configuration has it.
const SENSOR_X: f64 = -0.032;

/// A scan of 240 beams, taken from a robot that stands among these walls turned by `yaw`, so many
/// milliseconds after the start.
pub(crate) fn scan(walls: &[Segment], yaw: f64, milliseconds: u64) -> LaserScan {
    let mut scan = blank(240, milliseconds);
    let sensor = [SENSOR_X * libm::cos(yaw), SENSOR_X * libm::sin(yaw)];
    for index in 0..scan.len() {
        let angle = yaw + index as f64 * f64::from(scan.angle_increment);
        let range = walls
            .iter()
            .filter_map(|wall| cast(sensor, [libm::cos(angle), libm::sin(angle)], wall))
            .fold(f64::INFINITY, f64::min);
        #[expect(clippy::cast_possible_truncation, reason = "a range in a message is an f32")]
        let range = range as f32;
        scan.range[index] = if range < scan.range_min { f32::NEG_INFINITY } else { range };
    }
    scan
}

/// A scan of so many beams, all free.
#[expect(clippy::cast_possible_truncation, reason = "few beams, and small angles")]
pub(crate) fn blank(beams: usize, milliseconds: u64) -> LaserScan {
    let mut scan = LaserScan {
        angle_increment: (2.0 * std::f64::consts::PI / beams as f64) as f32,
        range_min: 0.12,
        range_max: 8.0,
        length: beams as u32,
        ..LaserScan::default()
    };
    scan.header.stamp = stamp(milliseconds);
    scan.ranges_mut().fill(f32::INFINITY);
    scan
}

/// The odometry of a robot that only turned.
pub(crate) fn turned(yaw: f64, milliseconds: u64) -> Odometry {
    let mut odometry = Odometry { yaw, ..Odometry::default() };
    odometry.header.stamp = stamp(milliseconds);
    odometry
}

pub(crate) fn stamp(milliseconds: u64) -> Stamp {
    Stamp::from_nanoseconds(milliseconds * 1_000_000)
}

/// [m] From `origin` along `direction` to the wall.
fn cast(origin: [f64; 2], direction: [f64; 2], &(from, to): &Segment) -> Option<f64> {
    let along = [to[0] - from[0], to[1] - from[1]];
    let there = [from[0] - origin[0], from[1] - origin[1]];
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let across = cross(direction, along);
    let range = cross(there, along) / across;
    let place = cross(there, direction) / across;
    (0.0 < range && (0.0..=1.0).contains(&place)).then_some(range)
}
