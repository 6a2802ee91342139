//! The heading that a gyro tells, found again by the stamp of the wheels that it belongs to.

use interfaces::{Imu, Stamp};

/// [-] Headings that wait for their wheels: as many as a queue holds.
const KEPT: usize = 10;

/// The unit quaternion's length may be off by so much; single precision is, by a millionth.
const LENGTH_TOLERANCE: f64 = 1e-3;

/// The last few headings.
#[derive(Debug, Clone, Default)]
pub struct Headings {
    kept: [Option<(Stamp, f64)>; KEPT],
    next: usize,
}

impl Headings {
    /// Keeps what this sample says; one that says nothing is not kept.
    pub fn keep(&mut self, imu: &Imu) {
        if let Some(yaw) = yaw(imu.orientation) {
            self.kept[self.next] = Some((imu.header.stamp, yaw));
            self.next = (self.next + 1) % KEPT;
        }
    }

    /// [rad] The heading with exactly this stamp.
    pub fn find(&self, stamp: Stamp) -> Option<f64> {
        let found = self.kept.iter().flatten().find(|(kept, _)| *kept == stamp);
        found.map(|(_, yaw)| *yaw)
    }
}

/// [rad] The heading of a unit quaternion x, y, z, w; `None` where it is none.
pub fn yaw([x, y, z, w]: [f64; 4]) -> Option<f64> {
    let length = x * x + y * y + z * z + w * w;
    let is_unit = (length - 1.0).abs() <= LENGTH_TOLERANCE;
    is_unit.then(|| libm::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn imu(stamp: u64, yaw: f64) -> Imu {
        let mut imu = Imu {
            orientation: [0.0, 0.0, libm::sin(yaw / 2.0), libm::cos(yaw / 2.0)],
            ..Imu::default()
        };
        imu.header.stamp = Stamp::from_nanoseconds(stamp);
        imu
    }

    #[test]
    fn a_heading_is_found_by_its_stamp_and_forgotten_in_time() {
        let mut headings = Headings::default();
        for step in 0..25_u32 {
            headings.keep(&imu(u64::from(step), f64::from(step) * 0.1));
        }
        assert!((headings.find(Stamp::from_nanoseconds(20)).unwrap() - 2.0).abs() < 1e-12);
        assert_eq!(headings.find(Stamp::from_nanoseconds(14)), None);
        assert_eq!(headings.find(Stamp::from_nanoseconds(99)), None);
    }

    #[test]
    fn what_is_no_unit_quaternion_says_nothing() {
        for orientation in
            [[0.0; 4], [f64::NAN, 0.0, 0.0, 1.0], [1.0; 4], [0.0, 0.0, f64::INFINITY, 0.0]]
        {
            assert_eq!(yaw(orientation), None, "{orientation:?}");
        }
        // Tilted a little, a heading is still one.
        let tilted = yaw([0.087_155_7, 0.0, 0.0, 0.996_194_7]).unwrap();
        assert!(tilted.abs() < 1e-6, "{tilted}");
    }
}
