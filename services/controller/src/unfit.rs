//! Samples that say nothing about where to drive, and why.

use std::fmt;
use std::time::Duration;

use interfaces::topics::SENSOR_PAIR;
use interfaces::{BEAMS_MAX, LaserScan, Odometry, SensorPair, Stamp};

use crate::{BEAMS_MIN, is_wall};

/// Why a pair of samples is not driven by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unfit {
    /// The scan has fewer beams than [`BEAMS_MIN`].
    FewBeams,
    /// The scan's size, its directions or its limits are no LiDAR's.
    Geometry,
    /// No beam shows a wall, nor free space.
    Blind,
    /// A number of the odometry is not finite, or beyond any robot's.
    Odometry,
    /// The pair was formed longer ago than its topic's deadline.
    Late,
    /// One of the two samples is older than the greatest age.
    Old,
    /// A stamp lies in the future.
    Future,
}

/// [rad] Two turns: directions are counted from any side, and a LiDAR may see some of them twice.
const ANGLE_MAX: f32 = 4.0 * std::f32::consts::PI;

/// [m] No LiDAR sees farther.
const RANGE_MAX: f32 = 1_000.0;

/// [m] No robot goes farther from where it started.
const PLACE_MAX: f64 = 1e6;

/// [rad] Nobody's heading is more than a whole turn.
const YAW_MAX: f64 = 2.0 * std::f64::consts::PI;

/// [m/s, rad/s] No robot drives or turns faster.
const SPEED_MAX: f64 = 100.0;

/// All processes read one clock, so an honest stamp is never ahead of it. The rest is for a driver
/// that reckons when its sensor measured.
const AHEAD_MAX: Duration = Duration::from_millis(10);

impl Unfit {
    /// All of them, in order.
    pub const ALL: [Self; 7] = [
        Self::FewBeams,
        Self::Geometry,
        Self::Blind,
        Self::Odometry,
        Self::Late,
        Self::Old,
        Self::Future,
    ];

    /// Its name in reports.
    pub const fn label(self) -> &'static str {
        match self {
            Self::FewBeams => "few_beams",
            Self::Geometry => "geometry",
            Self::Blind => "blind",
            Self::Odometry => "odometry",
            Self::Late => "late",
            Self::Old => "old",
            Self::Future => "future",
        }
    }
}

impl fmt::Display for Unfit {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::FewBeams => "the scan has too few beams",
            Self::Geometry => "the scan's size, directions or limits are no LiDAR's",
            Self::Blind => "no beam of the scan shows anything",
            Self::Odometry => "the odometry has numbers that no robot has",
            Self::Late => "the newest pair was formed too long ago",
            Self::Old => "the samples are too old",
            Self::Future => "the samples are stamped in the future",
        })
    }
}

/// Refuses samples by what they hold.
pub(crate) fn check_samples(scan: &LaserScan, odometry: &Odometry) -> Result<(), Unfit> {
    if scan.len() < BEAMS_MIN {
        return Err(Unfit::FewBeams);
    }
    if !has_geometry(scan) {
        return Err(Unfit::Geometry);
    }
    let shows = |&range: &f32| is_wall(scan, range) || range == f32::INFINITY;
    if !scan.ranges().iter().any(shows) {
        return Err(Unfit::Blind);
    }
    let is_within = |value: f64, limit: f64| value.abs() <= limit;
    let is_sound = is_within(odometry.x, PLACE_MAX)
        && is_within(odometry.y, PLACE_MAX)
        && is_within(odometry.yaw, YAW_MAX)
        && is_within(odometry.linear, SPEED_MAX)
        && is_within(odometry.angular, SPEED_MAX);
    if is_sound { Ok(()) } else { Err(Unfit::Odometry) }
}

/// Refuses a pair by its age: it must not be used for longer than its topic's deadline, nor may
/// either of its samples be older than `age_max`, whenever the pair was formed.
pub fn check_age(ticket: &SensorPair, now: Stamp, age_max: Duration) -> Result<(), Unfit> {
    let stamps = [ticket.scan_stamp, ticket.odometry_stamp];
    let latest = stamps.iter().fold(ticket.formed, |latest, &stamp| latest.max(stamp));
    if AHEAD_MAX < latest.since(now) {
        return Err(Unfit::Future);
    }
    if SENSOR_PAIR.deadline < now.since(ticket.formed) {
        return Err(Unfit::Late);
    }
    if stamps.iter().any(|&stamp| age_max < now.since(stamp)) {
        return Err(Unfit::Old);
    }
    Ok(())
}

fn has_geometry(scan: &LaserScan) -> bool {
    // Whatever is not a number fails its comparison.
    scan.length as usize <= BEAMS_MAX
        && scan.angle_min.abs() <= ANGLE_MAX
        && scan.angle_increment.is_normal()
        && scan.angle_increment.abs() * scan.len() as f32 <= ANGLE_MAX
        && scan.range_min.is_normal()
        && 0.0 < scan.range_min
        && scan.range_min <= scan.range_max
        && scan.range_max <= RANGE_MAX
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{blank, stamp, turned};

    fn filled(beams: usize, range: f32) -> LaserScan {
        let mut scan = blank(beams, 50);
        scan.ranges_mut().fill(range);
        scan
    }

    #[test]
    fn reasons_are_listed_in_the_order_of_their_numbers() {
        for (number, unfit) in Unfit::ALL.into_iter().enumerate() {
            assert_eq!(unfit as usize, number);
        }
    }

    #[test]
    fn a_scan_that_shows_nothing_has_a_reason() {
        let seen = filled(240, 1.0);
        let table = vec![
            ("no beams", blank(0, 50), Unfit::FewBeams),
            ("too few beams", filled(BEAMS_MIN - 1, 1.0), Unfit::FewBeams),
            ("more beams than fit", LaserScan { length: u32::MAX, ..seen }, Unfit::Geometry),
            ("no direction", LaserScan { angle_min: f32::NAN, ..seen }, Unfit::Geometry),
            ("far round", LaserScan { angle_min: 1e30, ..seen }, Unfit::Geometry),
            ("no step", LaserScan { angle_increment: f32::INFINITY, ..seen }, Unfit::Geometry),
            ("a step of zero", LaserScan { angle_increment: 0.0, ..seen }, Unfit::Geometry),
            ("a denormal step", LaserScan { angle_increment: 1e-40, ..seen }, Unfit::Geometry),
            ("a huge step", LaserScan { angle_increment: -1.0, ..seen }, Unfit::Geometry),
            ("no least range", LaserScan { range_min: f32::NAN, ..seen }, Unfit::Geometry),
            ("a least range of zero", LaserScan { range_min: 0.0, ..seen }, Unfit::Geometry),
            ("a negative one", LaserScan { range_min: -0.1, ..seen }, Unfit::Geometry),
            ("no greatest range", LaserScan { range_max: f32::INFINITY, ..seen }, Unfit::Geometry),
            ("a huge one", LaserScan { range_max: 1e30, ..seen }, Unfit::Geometry),
            ("limits reversed", LaserScan { range_max: 0.1, ..seen }, Unfit::Geometry),
            ("all invalid", filled(240, f32::NAN), Unfit::Blind),
            ("all too close", filled(240, f32::NEG_INFINITY), Unfit::Blind),
            ("a driver that knows no infinity", filled(240, 0.0), Unfit::Blind),
            ("all negative", filled(240, -1.0), Unfit::Blind),
            ("all denormal", filled(240, 1e-40), Unfit::Blind),
            ("all beyond range_max", filled(240, 8.5), Unfit::Blind),
            ("all huge", filled(240, 1e30), Unfit::Blind),
        ];
        for (name, scan, unfit) in table {
            assert_eq!(check_samples(&scan, &turned(0.0, 50)), Err(unfit), "{name}");
        }
        for range in [1.0, f32::INFINITY] {
            let mut one = filled(BEAMS_MIN, f32::NAN);
            one.range[7] = range;
            assert_eq!(check_samples(&one, &turned(0.0, 50)), Ok(()), "{range}");
        }
    }

    #[test]
    fn odometry_of_no_robot_is_refused_field_by_field() {
        let good = turned(0.5, 50);
        for strange in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300] {
            let table = [
                Odometry { x: strange, ..good },
                Odometry { y: strange, ..good },
                Odometry { yaw: strange, ..good },
                Odometry { linear: strange, ..good },
                Odometry { angular: strange, ..good },
            ];
            for odometry in table {
                let checked = check_samples(&blank(240, 50), &odometry);
                assert_eq!(checked, Err(Unfit::Odometry), "{odometry:?}");
            }
        }
        let tiny = Odometry { x: 1e-310, linear: -1e-310, ..good };
        assert_eq!(check_samples(&blank(240, 50), &tiny), Ok(()));
    }

    #[test]
    fn a_pair_is_judged_by_its_forming_and_by_both_of_its_stamps() {
        const HOUR: u64 = 3_600_000;
        const NOW: u64 = 2 * HOUR;
        let table = [
            (NOW, NOW, NOW, Ok(())),
            (NOW - 150, NOW - 500, NOW - 160, Ok(())),
            (NOW + 10, NOW + 10, NOW + 10, Ok(())),
            (NOW - 151, NOW, NOW, Err(Unfit::Late)),
            (0, NOW, NOW, Err(Unfit::Late)),
            (NOW, NOW - 501, NOW, Err(Unfit::Old)),
            (NOW, NOW, NOW - 501, Err(Unfit::Old)),
            (NOW, 0, 0, Err(Unfit::Old)),
            (NOW, NOW - HOUR, NOW - HOUR, Err(Unfit::Old)),
            (NOW, NOW + 11, NOW, Err(Unfit::Future)),
            (NOW, NOW, NOW + HOUR, Err(Unfit::Future)),
            (NOW + HOUR, NOW, NOW, Err(Unfit::Future)),
        ];
        for (formed, scan, odometry, expected) in table {
            let ticket = SensorPair {
                scan_stamp: stamp(scan),
                odometry_stamp: stamp(odometry),
                formed: stamp(formed),
                ..SensorPair::default()
            };
            let checked = check_age(&ticket, stamp(NOW), Duration::from_millis(500));
            assert_eq!(checked, expected, "{formed}, {scan}, {odometry}");
        }
    }
}
