//! Walls parallel and square to a course, as lines through many beams of a scan.
//!
//! Everything here lies in the course's frame: its origin is the middle of the robot's axle, its x
//! axis the direction of the corridor as believed so far. How far that belief is wrong is the
//! *slope* that all walls share.

use interfaces::{BEAMS_MAX, LaserScan};

use crate::is_wall;

/// A direction of the course's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Ahead,
    Left,
    Behind,
    Right,
}

/// Where the beams of one scan ended.
#[derive(Debug, Clone)]
pub(crate) struct Points {
    /// [m] In the course's frame.
    each: Vec<[f64; 2]>,
    /// [-] Fewer points are no wall.
    votes_min: usize,
}

/// A straight wall: moments of its points, along the wall and across, counterclockwise about us.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wall {
    /// [-] Points on it.
    count: f64,
    /// [m] Mean place along the wall.
    along: f64,
    /// [m] Mean distance from the axle.
    across: f64,
    /// [m²] Sum of squares of the places along the wall, about their mean.
    along_along: f64,
    /// [m²] Sum of products of both, about their means.
    along_across: f64,
}

/// What part of the surroundings may be a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Window {
    /// [m] Along the wall, from here
    pub(crate) along_min: f64,
    /// [m] to here,
    pub(crate) along_max: f64,
    /// [m] and no farther than this.
    pub(crate) across_max: f64,
}

/// [m] Width of a bin when distances are counted.
const BIN: f64 = 0.01;

/// [-] Bins; with their width, the farthest wall that is looked for.
const BINS: usize = 80;

/// [-] Bins on each side that are counted along: noise spreads a wall over about 5 cm.
const BINS_BESIDE: usize = 2;

/// [m] About the line of the last round, what belongs to a wall in the next: three times a noisy
/// LiDAR's standard deviation.
const GATE: f64 = 0.03;

/// [-] Rounds of fitting; the last one changes less than a millimetre.
const ROUNDS: usize = 3;

/// [m] A wall is at least this long, as the standard deviation of its points: else its direction is
/// noise, and what seems a wall is the edge of one that we look along.
const SPREAD_MIN: f64 = 0.025;

/// [-] Chords side by side that reach round: each spans 11 degrees.
const CHORDS: usize = 32;

/// [-] Chords longer than this share of the distance lie along our sight, or join different walls.
const CHORD_MAX: f64 = 0.5;

/// [-] Below this share, chords have no common direction; above, it is seldom wrong by 0.3 rad.
const AGREEMENT_MIN: f64 = 0.4;

impl Points {
    pub(crate) fn new() -> Self {
        Self { each: Vec::with_capacity(BEAMS_MAX), votes_min: 0 }
    }

    /// Takes over the scan, from a sensor at `sensor_x` that points `heading` off the course.
    pub(crate) fn fill(&mut self, scan: &LaserScan, sensor_x: f64, heading: f64) {
        let (sin_heading, cos_heading) = libm::sincos(heading);
        let sensor = [sensor_x * cos_heading, sensor_x * sin_heading];
        let (angle_min, step) = (f64::from(scan.angle_min), f64::from(scan.angle_increment));

        self.each.clear();
        for (index, &range) in scan.ranges().iter().enumerate() {
            let range = if is_wall(scan, range) {
                f64::from(range)
            } else if range == f32::NEG_INFINITY && scan.range_min.is_finite() {
                // It is there, and nearer than can be measured.
                f64::from(scan.range_min)
            } else {
                continue;
            };
            let (sin, cos) = libm::sincos(heading + angle_min + index as f64 * step);
            self.each.push([sensor[0] + range * cos, sensor[1] + range * sin]);
        }
        self.votes_min = (scan.len() / 40).max(4);
    }

    /// [rad] The direction of most walls, or square to it, in `-PI/4..=PI/4`, if they agree.
    pub(crate) fn direction(&self) -> Option<f64> {
        // The fourth power of a chord, as a complex number, is the same for all four directions.
        let (mut real, mut imaginary, mut weight) = (0.0, 0.0, 0.0);
        let beams_apart = (self.each.len() / CHORDS).max(1);
        for (index, &[x0, y0]) in self.each.iter().enumerate() {
            let [x1, y1] = self.each[(index + beams_apart) % self.each.len()];
            let (dx, dy) = (x1 - x0, y1 - y0);
            let square = dx * dx + dy * dy;
            let nearer = (x0 * x0 + y0 * y0).min(x1 * x1 + y1 * y1);
            if square == 0.0 || CHORD_MAX * CHORD_MAX * nearer < square {
                continue;
            }
            let (re, im) = (dx * dx - dy * dy, 2.0 * dx * dy);
            real += (re * re - im * im) / square;
            imaginary += 2.0 * re * im / square;
            weight += square;
        }
        let agreement = libm::hypot(real, imaginary);
        (0.0 < agreement && AGREEMENT_MIN * weight <= agreement)
            .then(|| 0.25 * libm::atan2(imaginary, real))
    }

    /// The nearest wall on that side that has enough points, and is long enough.
    pub(crate) fn wall(&self, side: Side, window: Window) -> Option<Wall> {
        let mut line = Line { across: self.nearest(side, window)?, slope: 0.0, along: 0.0 };
        let mut wall = None;
        for _ in 0..ROUNDS {
            let round = self.fit(side, window, line)?;
            if round.along_along < round.count * SPREAD_MIN * SPREAD_MIN {
                return None;
            }
            line = Line { across: round.across, slope: round.slope(), along: round.along };
            wall = Some(round);
        }
        wall
    }

    /// [m] How far a strip of this half width is free on that side; the nearest two points in it
    /// may be stray. Infinite where there is nothing.
    pub(crate) fn free(&self, side: Side, half_width: f64) -> f64 {
        let mut nearest = [f64::INFINITY; 3];
        for (along, across) in self.seen_from(side) {
            if along.abs() <= half_width && 0.0 < across && across < nearest[2] {
                nearest[2] = across;
                nearest.sort_unstable_by(f64::total_cmp);
            }
        }
        nearest[2]
    }

    /// [m] The least distance at which many points agree.
    fn nearest(&self, side: Side, window: Window) -> Option<f64> {
        let mut votes = [0; BINS];
        for (_, across) in self.seen_from(side).filter(|&point| window.contains(point)) {
            votes[bin(across)] += 1;
        }

        let around = |bin: usize| -> usize {
            votes[bin.saturating_sub(BINS_BESIDE)..BINS.min(bin + BINS_BESIDE + 1)].iter().sum()
        };
        let mut best = (0..BINS).find(|&bin| self.votes_min <= around(bin))?;
        // Its edge; the middle of the wall is where the count is greatest.
        for bin in best + 1..BINS.min(best + 2 * BINS_BESIDE + 1) {
            if around(best) < around(bin) {
                best = bin;
            }
        }
        Some((best as f64 + 0.5) * BIN)
    }

    fn fit(&self, side: Side, window: Window, line: Line) -> Option<Wall> {
        let belongs = |&(along, across): &(f64, f64)| {
            window.contains((along, across)) && (across - line.at(along)).abs() <= GATE
        };
        let on_it = || self.seen_from(side).filter(belongs);

        let (mut count, mut along_sum, mut across_sum) = (0_usize, 0.0, 0.0);
        for (along, across) in on_it() {
            count += 1;
            along_sum += along;
            across_sum += across;
        }
        if count < self.votes_min {
            return None;
        }

        let count = count as f64;
        let (along_mean, across_mean) = (along_sum / count, across_sum / count);
        let (mut along_along, mut along_across) = (0.0, 0.0);
        for (along, across) in on_it() {
            along_along += (along - along_mean) * (along - along_mean);
            along_across += (along - along_mean) * (across - across_mean);
        }
        Some(Wall { count, along: along_mean, across: across_mean, along_along, along_across })
    }

    /// Every point as (along, across) of a wall on that side: the frame turned so that the wall
    /// lies to the left, which keeps slopes comparable.
    fn seen_from(&self, side: Side) -> impl Iterator<Item = (f64, f64)> {
        self.each.iter().map(move |&[x, y]| match side {
            Side::Ahead => (-y, x),
            Side::Left => (x, y),
            Side::Behind => (y, -x),
            Side::Right => (-x, -y),
        })
    }
}

impl Wall {
    /// [rad] By which this wall alone says that the course is wrong (for small angles).
    fn slope(&self) -> f64 {
        self.along_across / self.along_along
    }

    /// [m] From the axle to the wall, if it slopes like this.
    pub(crate) fn distance(&self, slope: f64) -> f64 {
        self.across - slope * self.along
    }

    /// [m²] Variance of that distance, for ranges with this standard deviation.
    pub(crate) fn distance_variance(&self, noise: f64, slope_variance: f64) -> f64 {
        noise * noise / self.count + self.along * self.along * slope_variance
    }
}

/// [rad] The slope that all these walls share, and its variance for ranges with this standard deviation.
pub(crate) fn shared_slope(walls: &[Option<Wall>], noise: f64) -> Option<(f64, f64)> {
    let (mut along_along, mut along_across) = (0.0, 0.0);
    for wall in walls.iter().flatten() {
        along_along += wall.along_along;
        along_across += wall.along_across;
    }
    (0.0 < along_along).then(|| (along_across / along_along, noise * noise / along_along))
}

#[derive(Debug, Clone, Copy)]
struct Line {
    across: f64,
    slope: f64,
    along: f64,
}

impl Line {
    fn at(&self, along: f64) -> f64 {
        self.across + self.slope * (along - self.along)
    }
}

impl Window {
    fn contains(&self, (along, across): (f64, f64)) -> bool {
        self.along_min <= along
            && along <= self.along_max
            && 0.0 < across
            && across < self.across_max.min(BIN * BINS as f64)
    }
}

/// The bin of a distance that a window contains.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a window contains distances above zero and within the bins"
)]
fn bin(across: f64) -> usize {
    ((across / BIN) as usize).min(BINS - 1)
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "what must be exact is compared exactly")]
mod tests {
    use super::*;
    use crate::scene::{Segment, blank, scan};

    const FRONT: Window = Window { along_min: -0.13, along_max: 0.13, across_max: 0.8 };
    const BESIDE: Window = Window { along_min: -0.45, along_max: 0.45, across_max: 0.8 };

    /// A corridor 0.4 m wide along x, with the robot 0.03 m left of its middle, and a wall 0.5 m
    /// ahead.
    const CORRIDOR: [Segment; 3] =
        [([-3.0, 0.17], [0.5, 0.17]), ([-3.0, -0.23], [0.5, -0.23]), ([0.5, 0.17], [0.5, -0.23])];

    fn points(walls: &[Segment], yaw: f64, heading: f64) -> Points {
        let mut points = Points::new();
        points.fill(&scan(walls, yaw, 50), -0.032, heading);
        points
    }

    fn near(one: f64, other: f64) -> bool {
        (one - other).abs() < 1e-3
    }

    #[test]
    fn walls_are_measured_from_the_axle_and_share_the_slope_of_a_wrong_course() {
        for wrong in [-0.15, 0.0, 0.1] {
            // The robot heads 0.3 rad off the corridor, but believes to be `wrong` less.
            let points = points(&CORRIDOR, 0.3, 0.3 + wrong);
            let walls = [(Side::Ahead, FRONT), (Side::Left, BESIDE), (Side::Right, BESIDE)]
                .map(|(side, window)| points.wall(side, window));
            let (slope, variance) = shared_slope(&walls, 0.01).unwrap();
            assert!(near(slope, libm::tan(wrong)), "{wrong}: {slope}");
            assert!(0.0 < variance && variance < 1e-3);

            let distances = walls.map(|wall| wall.unwrap().distance(slope) * libm::cos(wrong));
            for (distance, expected) in distances.into_iter().zip([0.5, 0.17, 0.23]) {
                assert!(near(distance, expected), "{wrong}: {distances:?}");
            }
        }
    }

    #[test]
    fn the_nearest_of_two_walls_counts() {
        let opening = [([-3.0, 0.2], [0.0, 0.2]), ([-3.0, 0.5], [3.0, 0.5])];
        let wall = points(&opening, 0.0, 0.0).wall(Side::Left, BESIDE).unwrap();
        assert!(near(wall.distance(wall.slope()), 0.2), "{wall:?}");
    }

    #[test]
    fn a_wall_that_is_too_close_to_measure_is_still_a_wall() {
        let close = [([-3.0, 0.08], [3.0, 0.08])];
        let points = points(&close, 0.0, 0.0);
        assert!(points.free(Side::Left, 0.08) <= 0.12);
        assert_eq!(points.free(Side::Right, 0.08), f64::INFINITY);
    }

    #[test]
    fn the_end_of_a_wall_that_we_look_along_is_no_wall() {
        let end_on = [([0.3, 0.2], [3.0, 0.2]), ([0.3, 0.2], [0.3, 0.22])];
        let points = points(&end_on, 0.0, 0.0);
        assert_eq!(
            points.wall(Side::Ahead, Window { along_min: -0.3, along_max: 0.3, ..FRONT }),
            None
        );
    }

    #[test]
    fn two_stray_points_do_not_block_the_way() {
        let mut scan = blank(240, 50);
        let mut points = Points::new();
        for (strays, free) in [(1, f64::INFINITY), (2, f64::INFINITY), (3, 0.25)] {
            for index in 0..strays {
                scan.range[index] = 0.282;
            }
            points.fill(&scan, -0.032, 0.0);
            let measured = points.free(Side::Ahead, 0.1);
            assert!(measured == free || near(measured, free), "{strays}: {measured}");
        }
    }

    #[test]
    fn the_direction_of_most_walls_is_found_whatever_the_robot_s() {
        for yaw in [-0.7, -0.4, 0.0, 0.2, 0.6] {
            let direction = points(&CORRIDOR, yaw, 0.0).direction().unwrap();
            assert!((direction + yaw).abs() < 0.05, "{yaw}: {direction}");
        }
        assert_eq!(points(&[], 0.0, 0.0).direction(), None);
    }

    #[test]
    fn no_points_are_no_walls() {
        let points = points(&[], 0.0, 0.0);
        assert_eq!(points.wall(Side::Left, BESIDE), None);
        assert_eq!(shared_slope(&[None, None], 0.01), None);
    }
}
