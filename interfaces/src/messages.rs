//! The samples that processes exchange: fixed size, no padding, no pointer.
//!
//! A reader never finds a Rust `enum`, `bool` or `Option` here: another process wrote the bytes.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use crate::Stamp;

/// [-] Beams that fit in a [`LaserScan`]: four for each degree. An LDS-02 at its slowest, 5 Hz, takes
/// 2300 / 5 = 460.
pub const BEAMS_MAX: usize = 1440;

/// [-] Index of the left wheel in a [`JointState`].
pub const LEFT: usize = 0;

/// [-] Index of the right wheel in a [`JointState`].
pub const RIGHT: usize = 1;

/// What every message starts with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("Header/1")]
#[repr(C)]
pub struct Header {
    /// [ns] When the data was true, never when it was sent.
    pub stamp: Stamp,
    /// [-] Counts the samples of one publisher from 0; a gap is a loss.
    pub sequence: u64,
    /// [-] Which life of the publisher wrote it, from 1; older lives are not to be believed.
    pub epoch: u32,
    /// [-] Zero.
    pub reserved: u32,
}

/// One turn of the LiDAR, in `base_scan`, after `sensor_msgs/LaserScan`.
///
/// The stamp is that of the first beam. Beam `i` points `angle_min + i * angle_increment`
/// counterclockwise from straight ahead. What no beam returned follows REP 117: `+inf` nothing in
/// range, `-inf` too close, NaN invalid; only `range_min <= range && range <= range_max` is a wall.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("LaserScan/2")]
#[repr(C)]
pub struct LaserScan {
    /// Stamp of the first beam, sequence, epoch.
    pub header: Header,
    /// [rad] Direction of the first beam.
    pub angle_min: f32,
    /// [rad] Direction of the last beam.
    pub angle_max: f32,
    /// [rad] Between two beams.
    pub angle_increment: f32,
    /// [s] Between two beams.
    pub time_increment: f32,
    /// [s] Between two scans.
    pub scan_time: f32,
    /// [m] Nearer returns are not to be believed.
    pub range_min: f32,
    /// [m] Farther returns are not to be believed.
    pub range_max: f32,
    /// [-] How many beams this scan has, at most [`BEAMS_MAX`]; see [`LaserScan::ranges`].
    pub length: u32,
    /// [m] By beam; zero behind the last one.
    pub range: [f32; BEAMS_MAX],
    /// [-] By beam, in the sensor's own unit; zero behind the last one.
    pub intensity: [f32; BEAMS_MAX],
}

impl LaserScan {
    /// [m] The beams that this scan has.
    pub fn ranges(&self) -> &[f32] {
        &self.range[..self.len()]
    }

    /// [m] The beams that this scan has, to be written.
    pub fn ranges_mut(&mut self) -> &mut [f32] {
        let length = self.len();
        &mut self.range[..length]
    }

    /// [-] The intensities of the beams that this scan has.
    pub fn intensities(&self) -> &[f32] {
        &self.intensity[..self.len()]
    }

    /// [-] The intensities of the beams that this scan has, to be written.
    pub fn intensities_mut(&mut self) -> &mut [f32] {
        let length = self.len();
        &mut self.intensity[..length]
    }

    /// [-] How many beams this scan has; never more than fit, whatever was written.
    pub fn len(&self) -> usize {
        (self.length as usize).min(BEAMS_MAX)
    }

    /// Whether this scan has no beam.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }
}

impl Default for LaserScan {
    fn default() -> Self {
        Self::zeroed()
    }
}

/// The two wheels' encoders, [`LEFT`] and [`RIGHT`], positive forward, after
/// `sensor_msgs/JointState`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("JointState/1")]
#[repr(C)]
pub struct JointState {
    /// Stamp of the encoder reading, sequence, epoch.
    pub header: Header,
    /// [rad] Turned since the encoders were switched on, not wrapped.
    pub position: [f64; 2],
    /// [rad] Turned since the sample before this one.
    pub increment: [f64; 2],
    /// [rad/s] Speed of the wheel.
    pub velocity: [f64; 2],
}

/// Where the robot is in `odom` and how it moves in `base_link`, after `nav_msgs/Odometry`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("Odometry/1")]
#[repr(C)]
pub struct Odometry {
    /// Stamp of the measurement it was computed from, sequence, epoch.
    pub header: Header,
    /// [m] Position in `odom`.
    pub x: f64,
    /// [m] Position in `odom`.
    pub y: f64,
    /// [rad] Heading in `odom`, in `-PI..=PI`.
    pub yaw: f64,
    /// [m/s] Speed along x of `base_link`.
    pub linear: f64,
    /// [rad/s] Turning speed about z.
    pub angular: f64,
}

/// How the robot shall move, in `base_link`, after `geometry_msgs/TwistStamped`.
///
/// The stamp is that of the newest measurement the command was computed from, so that the age of
/// the data at the wheel is one subtraction.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("VelocityCommand/1")]
#[repr(C)]
pub struct VelocityCommand {
    /// Stamp of the newest input, sequence, epoch.
    pub header: Header,
    /// [m/s] Speed along x.
    pub linear: f64,
    /// [rad/s] Turning speed about z.
    pub angular: f64,
}

/// A pose as somebody estimates or reports it, after the lab's `PoseStamped`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("Pose/1")]
#[repr(C)]
pub struct Pose {
    /// Stamp of the measurement it was computed from, sequence, epoch.
    pub header: Header,
    /// [m] Position in the topic's frame.
    pub x: f64,
    /// [m] Position in the topic's frame.
    pub y: f64,
    /// [rad] Heading in the topic's frame, in `-PI..=PI`.
    pub yaw: f64,
    /// [-] 1 where the estimate has found the robot's place, else 0.
    pub localized: u8,
    /// [-] Zero.
    pub reserved: [u8; 7],
}

/// A ticket for one scan and one odometry sample that belong together in time.
///
/// It names the samples, it does not carry them: the reader borrows both from shared memory by
/// sequence number. The stamp is the newer of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("SensorPair/1")]
#[repr(C)]
pub struct SensorPair {
    /// Stamp of the newer of the two samples, sequence, epoch.
    pub header: Header,
    /// [ns] Stamp of the scan.
    pub scan_stamp: Stamp,
    /// [ns] Stamp of the odometry.
    pub odometry_stamp: Stamp,
    /// [-] Sequence number of the scan.
    pub scan_sequence: u64,
    /// [-] Sequence number of the odometry.
    pub odometry_sequence: u64,
    /// [-] Epoch of the scan's publisher.
    pub scan_epoch: u32,
    /// [-] Epoch of the odometry's publisher.
    pub odometry_epoch: u32,
    /// [ns] Between the two stamps.
    pub spread_ns: u64,
    /// [ns] When the pair was formed.
    pub formed: Stamp,
}

/// Sizes are part of the agreement: a change is a new type name and a line in the changelog.
/// (`Pod` refuses padding at compile time.)
const _: () = {
    assert!(size_of::<Header>() == 24);
    assert!(size_of::<LaserScan>() == 56 + 8 * BEAMS_MAX);
    assert!(size_of::<JointState>() == 72);
    assert!(size_of::<Odometry>() == 64);
    assert!(size_of::<VelocityCommand>() == 40);
    assert!(size_of::<Pose>() == 56);
    assert!(size_of::<SensorPair>() == 80);
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_never_reads_beyond_its_beams() {
        let mut scan = LaserScan { length: 3, ..LaserScan::default() };
        scan.ranges_mut().fill(1.0);
        assert_eq!(scan.ranges(), [1.0; 3]);

        scan.length = u32::MAX;
        assert_eq!(scan.ranges().len(), BEAMS_MAX);
    }
}
