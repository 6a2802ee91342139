//! What the controller notes of itself, for the report of a run.

use std::f64::consts::{FRAC_PI_2, PI};

use interfaces::{LaserScan, VelocityCommand};
use node::Diary;

use crate::Activity;

/// What is noted of each command, for the report of a run.
pub(crate) const NOTED: [&str; 6] = [
    "left_m",
    "front_m",
    "right_m",
    "linear_m_s",
    "angular_rad_s",
    "activity:follows/turns right/turns left/leaves a turn/blind",
];

/// [rad] To the left, ahead and to the right.
const SIDES: [f64; 3] = [FRAC_PI_2, 0.0, -FRAC_PI_2];

/// [rad] What is at a side is within this of its middle.
const SIDE: f64 = 10.0 * PI / 180.0;

/// Takes down what was seen and decided.
pub(crate) fn note(diary: &Diary, scan: &LaserScan, activity: Activity, command: &VelocityCommand) {
    if !diary.is_kept() {
        return;
    }
    let [left, front, right] = SIDES.map(|side| nearest(scan, side));
    let (linear, angular) = (command.linear, command.angular);
    let row = [left, front, right, linear, angular, f64::from(activity as u8)];
    diary.note(command.header.stamp, row);
}

/// [m] The least range around this direction; infinite where nothing is measured there.
fn nearest(scan: &LaserScan, side: f64) -> f64 {
    let beams = scan.ranges().iter().enumerate();
    let is_there = |beam: usize| {
        let (first, step) = (f64::from(scan.angle_min), f64::from(scan.angle_increment));
        let angle = first + step * beam as f64 - side;
        libm::remainder(angle, 2.0 * PI).abs() <= SIDE
    };
    let ranges = beams.filter(|(beam, _)| is_there(*beam)).map(|(_, range)| f64::from(*range));
    ranges.filter(|range| f64::from(scan.range_min) <= *range).fold(f64::INFINITY, f64::min)
}
