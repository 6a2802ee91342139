//! An LDS-02: twelve rays a packet, 2300 a second, clockwise, seen from beside the sensor's axis.

use std::time::Duration;

use crate::World;

/// [bit/s] Its line.
pub(crate) const BAUD_RATE: u32 = 115_200;

/// Between two packets.
pub(crate) const PERIOD: Duration = Duration::from_nanos(12_000_000_000 / 2_300);

/// [degree/s] 10 Hz.
const SPEED: u16 = 3_600;

/// [degree] Between two rays.
const STEP: f64 = 3_600.0 / 2_300.0;

/// [m] What it sees.
const RANGES: std::ops::RangeInclusive<f64> = 0.1..=8.2;

/// A packet of its rays, distance [mm] and confidence; angles in hundredths of a degree.
pub(crate) fn packet(
    speed: u16,
    start: u16,
    end: u16,
    time: u16,
    rays: &[(u16, u8); 12],
) -> Vec<u8> {
    let mut bytes = vec![0x54, 0x2c];
    bytes.extend(speed.to_le_bytes());
    bytes.extend(start.to_le_bytes());
    for (distance, confidence) in rays {
        bytes.extend(distance.to_le_bytes());
        bytes.push(*confidence);
    }
    bytes.extend(end.to_le_bytes());
    bytes.extend(time.to_le_bytes());
    bytes.push(remainder(&bytes));
    bytes
}

/// Of the long division by x^8 + x^6 + x^3 + x^2 + 1.
fn remainder(bytes: &[u8]) -> u8 {
    let mut rest = 0_u32;
    for &byte in bytes.iter().chain(&[0]) {
        for bit in (0..8).rev() {
            rest = rest << 1 | u32::from(byte >> bit & 1);
            if 0x100 <= rest {
                rest ^= 0x14d;
            }
        }
    }
    u8::try_from(rest).unwrap_or_default()
}

/// The sensor.
#[derive(Debug, Default)]
pub(crate) struct Lds02 {
    /// [degree] Of the next ray, clockwise.
    angle: f64,
    /// [ms] Its clock.
    time: f64,
}

impl Lds02 {
    /// The next packet, of what is around now.
    pub(crate) fn measure(&mut self, world: &mut dyn World) -> Vec<u8> {
        let hundredths = |degrees: f64| {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small")]
            let hundredths = (degrees * 100.0).floor() as u16 % 36_000;
            hundredths
        };
        let start = self.angle;
        let mut rays = [(0, 0); 12];
        for (index, ray) in rays.iter_mut().enumerate() {
            if let Some(distance) = raw(world, start + index as f64 * STEP) {
                *ray = (distance, 200);
            }
        }
        let end = start + 11.0 * STEP;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small")]
        let time = self.time as u16;
        let packet = packet(SPEED, hundredths(start), hundredths(end), time, &rays);
        self.angle = (start + 12.0 * STEP) % 360.0;
        self.time = (self.time + PERIOD.as_secs_f64() * 1e3) % 30_000.0;
        packet
    }
}

/// [mm] What the receiver measures in this direction, clockwise [degree], if anything. It sits beside
/// the axis and squints, so where its ray ends as seen from the axis depends on how far that is.
fn raw(world: &mut dyn World, clockwise: f64) -> Option<u16> {
    let mut bearing: f64 = -clockwise.to_radians();
    let mut distance = 0.0;
    for _ in 0..4 {
        let range = world.range(bearing);
        if !RANGES.contains(&range) {
            return None;
        }
        distance = distance_of(range * 1e3);
        bearing = libm::atan2(0.119_23 * distance - 20.14, distance + 5.9) - clockwise.to_radians();
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within its range")]
    let distance = distance.round().max(1.0) as u16;
    Some(distance)
}

/// [mm] How far the receiver is from a point that is `range` [mm] from the axis: the positive root of
/// (d + 5.9)^2 + (0.11923 d - 20.14)^2 = range^2.
fn distance_of(range: f64) -> f64 {
    let (a, b, c) = (
        1.0 + 0.119_23 * 0.119_23,
        5.9 - 0.119_23 * 20.14,
        5.9 * 5.9 + 20.14 * 20.14 - range * range,
    );
    (-b + (b * b - a * c).max(0.0).sqrt()) / a
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall straight across, at x = 1 m from the LiDAR, and nothing else.
    struct Wall;

    impl World for Wall {
        fn awaited(&self) -> Option<&'static str> {
            None
        }

        fn step(&mut self, _: f64, _: f64) {}

        fn range(&mut self, angle: f64) -> f64 {
            let cos = libm::cos(angle);
            if cos <= 0.0 { f64::INFINITY } else { 1.0 / cos }
        }

        fn heading(&self) -> f64 {
            0.0
        }

        fn ending(&self) -> Option<Result<String, String>> {
            None
        }

        fn summary(&self) -> String {
            String::new()
        }
    }

    #[test]
    fn a_ray_ends_on_the_wall() {
        for degrees in [0.0, 20.0, 50.0, 310.0, 340.0] {
            let distance = f64::from(raw(&mut Wall, degrees).unwrap());
            // The point in the receiver's own terms, turned into the sensor's frame.
            let (x, y) = (distance + 5.9, 0.119_23 * distance - 20.14);
            let angle = -f64::to_radians(degrees);
            let ahead = x * libm::cos(angle) - y * libm::sin(angle);
            assert!((ahead - 1_000.0).abs() < 1.5, "{degrees}: {ahead}");
        }
        assert_eq!(raw(&mut Wall, 180.0), None);
    }
}
