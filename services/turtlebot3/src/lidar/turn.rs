//! One turn of a LiDAR: points as it measured them, and the scan that is made of them.

use std::f64::consts::TAU;
use std::time::Duration;

use interfaces::{BEAMS_MAX, LaserScan, Stamp};

use super::Model;

/// [-] Points of one turn: more come from no LiDAR of ours.
const POINTS_MAX: usize = 2 * BEAMS_MAX;

/// One measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// [rad] Counterclockwise from straight ahead, 0 to 2 PI.
    pub angle: f64,
    /// [m] In `base_scan`; `+inf` where nothing returned.
    pub range: f64,
    /// [-] How strong the return was, in the sensor's own unit.
    pub intensity: u16,
}

/// One turn.
#[derive(Debug, Clone)]
pub struct Turn {
    /// [ns] When the first ray was measured.
    pub begun: Stamp,
    /// How long the whole turn takes.
    pub period: Duration,
    /// In the order in which they were measured, clockwise.
    pub points: Vec<Point>,
}

impl Default for Turn {
    fn default() -> Self {
        let points = Vec::with_capacity(POINTS_MAX);
        Self { begun: Stamp::ZERO, period: Duration::ZERO, points }
    }
}

impl Turn {
    /// Begins a new one.
    pub(super) fn begin(&mut self, begun: Stamp, period: Duration) {
        self.begun = begun;
        self.period = period;
        self.points.clear();
    }

    /// One more; what is too much is left out.
    pub(super) fn push(&mut self, point: Point) {
        if self.points.len() < POINTS_MAX {
            self.points.push(point);
        }
    }

    /// Writes the turn as a scan of `beams` beams, evenly from straight ahead, all but sequence and
    /// epoch. Each point goes to the beam that is nearest to its angle, of two in one beam the
    /// nearer; a beam without a point is NaN. Points below `range_min` are `-inf`, those beyond
    /// `range_max` `+inf` (REP 117).
    ///
    /// The LiDAR turns clockwise and beams are counted counterclockwise, so all but the first were
    /// measured in the opposite order.
    pub fn fill(&self, model: Model, range_min: f32, beams: usize, scan: &mut LaserScan) {
        let beams = beams.clamp(1, BEAMS_MAX);
        let increment = TAU / beams as f64;
        let period = self.period.as_secs_f64();
        scan.header.stamp = self.begun;
        scan.angle_min = 0.0;
        scan.angle_max = single(increment * (beams - 1) as f64);
        scan.angle_increment = single(increment);
        scan.time_increment = single(period / beams as f64);
        scan.scan_time = single(period);
        scan.range_min = range_min;
        scan.range_max = model.range().1;
        scan.length = u32::try_from(beams).unwrap_or_default();
        scan.ranges_mut().fill(f32::NAN);
        scan.intensities_mut().fill(0.0);
        for point in &self.points {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole")]
            let beam = (point.angle / increment).round() as usize % beams;
            let range = report(point.range, range_min, scan.range_max);
            if scan.range[beam].is_nan() || range < scan.range[beam] {
                scan.range[beam] = range;
                scan.intensity[beam] = f32::from(point.intensity);
            }
        }
    }
}

fn report(measured: f64, range_min: f32, range_max: f32) -> f32 {
    let range = single(measured);
    if range < range_min {
        f32::NEG_INFINITY
    } else if range_max < range {
        f32::INFINITY
    } else {
        range
    }
}

fn single(value: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "scans are single precision")]
    let value = value as f32;
    value
}
