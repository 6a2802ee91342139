//! Follows the middle of a corridor: walls as lines through many beams, turns by odometry.
//!
//! The robot keeps three numbers, predicted by odometry and corrected by the walls of each scan,
//! each weighed by its variance: its heading against the corridor's course, its offset from the
//! corridor's middle, and the corridor's width. To turn is to choose another course, square to the
//! old one; then the same heading is simply very wrong, and is brought to zero in place.

use std::f64::consts::{FRAC_PI_2, PI};
use std::time::Duration;

use interfaces::{LaserScan, Odometry, Stamp};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::walls::{Points, Side, Wall, Window, shared_slope};
use crate::{Activity, CorridorConfig, Motion};

/// The follower and its memory.
#[derive(Debug, Clone)]
pub(crate) struct CorridorFollowing {
    config: CorridorConfig,
    random: ChaCha8Rng,
    points: Points,
    state: State,
    belief: Belief,
    seen: Surroundings,
    /// [m] Since a course was chosen, if one was.
    driven: Option<f64>,
    last: Option<Last>,
}

/// What the robot is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Along the corridor.
    Follow,
    /// In place, until the course lies ahead.
    Turn,
}

/// Where the robot believes to be in the corridor.
#[derive(Debug, Clone, Copy)]
struct Belief {
    /// [rad] Of the robot against the course; not wrapped, so that a turn knows its side.
    heading: Estimate,
    /// [m] From the middle, positive to the left.
    offset: Estimate,
    /// [m] Between the walls.
    width: Estimate,
}

/// A number and how far it may be trusted.
#[derive(Debug, Clone, Copy)]
struct Estimate {
    value: f64,
    variance: f64,
}

/// The samples before these, and what was made of them.
#[derive(Debug, Clone, Copy)]
struct Last {
    scan: Stamp,
    scan_epoch: u32,
    odometry: Odometry,
    motion: Motion,
}

/// [m] What a scan shows of the corridor.
#[derive(Debug, Clone, Copy)]
struct Surroundings {
    /// To the wall ahead, if there is one near.
    ahead: Option<f64>,
    /// Free ahead, for the width of the robot.
    free_ahead: f64,
    /// Free to the left, for less than the width of the robot.
    free_left: f64,
    /// Free to the right, likewise.
    free_right: f64,
}

/// How long the samples may fail to come before the belief is worthless.
const GAP_MAX: Duration = Duration::from_secs(1);

/// [s] Ranges are moved to the odometry's time, but by no more than the period of a slow LiDAR.
const SKEW_MAX: f64 = 0.2;

/// [m] No wheel goes so far in that time: the odometry was set to another place.
const JUMP_MIN: f64 = 1.0;

/// [rad] Standard deviation of the heading at the start.
const HEADING_UNKNOWN: f64 = 0.3;

/// [m] Standard deviation of offset and width at the start.
const PLACE_UNKNOWN: f64 = 0.1;

/// [m] Standard deviation of the offset after a turn in front of a wall that was measured.
const PLACE_TURNED: f64 = 0.02;

/// [-] Standard deviation of odometry per distance, and per angle.
const DRIFT: f64 = 0.02;

/// [rad] Standard deviation that each period adds: walls are not quite straight or parallel.
const HEADING_UNREST: f64 = 0.002;

/// [m] Likewise of the offset.
const OFFSET_UNREST: f64 = 0.001;

/// [m²/m] Variance of the width that each distance adds: corridors widen. Slow enough that an
/// opening on one side is passed before it is taken for a wider corridor.
const WIDTH_UNREST: f64 = 0.01;

/// [m] A distance is never better than this: range bias, thickness of walls.
const DISTANCE_BIAS: f64 = 0.003;

/// [rad] A slope is never better than this.
const SLOPE_BIAS: f64 = 0.003;

/// [rad] A slope that differs more from the direction of most walls is not theirs.
const SLOPE_MAX: f64 = 0.35;

/// [rad] Standard deviation of a course that is read off the whole scan.
const DIRECTION_NOISE: f64 = 0.1;

/// [m] Beyond three standard deviations, how far a wall may be from where it is expected.
const SURPRISE_MAX: f64 = 0.05;

/// [m] How far along the corridor side walls are looked at, ahead and behind.
const SIDE_REACH: f64 = 0.45;

/// [m] A side wall ends this far before a wall ahead, whose own points would bend it.
const CORNER: f64 = 0.04;

/// [m] Half width of the strip in which a wall ahead or behind is looked for.
const FRONT_HALF: f64 = 0.13;

/// [m] The farthest wall that is measured, rather than just seen to be free.
const WALL_MAX: f64 = 0.8;

/// [m] Half width of the strip in which an opening must be free; narrower than the robot, since it
/// stands before the opening's middle only roughly.
const OPENING_HALF: f64 = 0.08;

/// [m] Behind the corridor's edge, how far an opening must be free to be one.
const OPENING_DEPTH: f64 = 0.15;

/// [m] Added to the robot's radius where the way ahead must be free.
const MARGIN_SIDE: f64 = 0.01;

/// [m] What the robot leaves before anything ahead.
const MARGIN_AHEAD: f64 = 0.035;

/// [m] Who has driven less since a choice has not come away from where it was made,
const DRIVEN_MIN: f64 = 0.02;

/// [rad] and may choose any other course.
const OTHER_COURSES: [f64; 3] = [FRAC_PI_2, PI, -FRAC_PI_2];

/// [m] Near enough to the place where it turns.
const ARRIVED: f64 = 0.01;

/// [rad] Near enough to the course to drive on,
const TURNED: f64 = 0.06;

/// [rad] and too far from it.
const ASTRAY: f64 = 0.6;

/// [rad] The steepest approach to the corridor's middle.
const APPROACH_MAX: f64 = 0.4;

/// [rad/s] In place, no slower: a turn ends.
const TURN_MIN: f64 = 0.1;

/// [-] Of what a wheel can do; the rest is for rounding.
const WHEEL_SHARE: f64 = 0.999;

impl CorridorFollowing {
    pub(crate) fn new(config: &CorridorConfig, seed: u64) -> Self {
        Self {
            config: config.clone(),
            random: ChaCha8Rng::seed_from_u64(seed),
            points: Points::new(),
            state: State::Follow,
            belief: Belief::unknown(config.corridor_width_m),
            seen: Surroundings::NONE,
            driven: None,
            last: None,
        }
    }

    /// Goes on by other speeds and gains.
    pub(crate) fn retune(&mut self, config: &CorridorConfig) {
        self.config = config.clone();
    }

    /// The motion for these samples; where neither is newer than before, the last motion.
    pub(crate) fn update(&mut self, scan: &LaserScan, odometry: &Odometry) -> Motion {
        let news = self.last.as_ref().map_or(News::Start, |last| last.news(scan, odometry));
        let (dt, scan_is_new) = match news {
            News::Start => {
                self.start(scan);
                (0.0, true)
            }
            News::Nothing => return self.last.map_or(Motion::STOP, |last| last.motion),
            News::Samples { dt, scan_is_new } => {
                self.predict(odometry);
                (dt, scan_is_new)
            }
        };
        if scan_is_new {
            self.correct(scan, odometry);
        }

        let before = self.last.map_or(Motion::STOP, |last| last.motion);
        let motion = self.step(before, dt);
        self.last = Some(Last {
            scan: scan.header.stamp,
            scan_epoch: scan.header.epoch,
            odometry: self.last.map_or(*odometry, |last| last.after(odometry)),
            motion,
        });
        motion
    }

    /// The next samples are the first.
    pub(crate) fn forget(&mut self) {
        self.last = None;
    }

    pub(crate) fn activity(&self) -> Activity {
        match self.state {
            State::Follow => Activity::Following,
            State::Turn if self.belief.heading.value > 0.0 => Activity::TurningRight,
            State::Turn => Activity::TurningLeft,
        }
    }

    /// Takes the direction that most walls agree on for the course.
    fn start(&mut self, scan: &LaserScan) {
        self.points.fill(scan, self.config.sensor_x_m, 0.0);
        self.last = None;
        self.driven = None;
        self.state = State::Follow;
        self.belief = Belief::unknown(self.config.corridor_width_m);
        self.belief.heading.value = -self.points.direction().unwrap_or(0.0);
    }

    /// Moves the belief as the wheels did.
    fn predict(&mut self, odometry: &Odometry) {
        let moved = self.last.as_ref().and_then(|last| moved(&last.odometry, odometry));
        let (distance, turned) = moved.unwrap_or((0.0, 0.0));
        let middle = self.belief.heading.value + 0.5 * turned;
        let (sin, cos) = libm::sincos(middle);

        let Belief { heading, offset, width } = &mut self.belief;
        heading.shift(turned, HEADING_UNREST + DRIFT * turned.abs());
        offset.shift(distance * sin, OFFSET_UNREST + DRIFT * distance.abs());
        width.variance += WIDTH_UNREST * distance.abs();
        self.driven = self.driven.map(|driven| driven + distance);
        self.seen.ahead = self.seen.ahead.map(|ahead| ahead - distance * cos);
        self.seen.free_ahead -= distance * cos;
    }

    /// Corrects the belief by the walls of a scan, and looks for a way.
    fn correct(&mut self, scan: &LaserScan, odometry: &Odometry) {
        let heading = self.belief.heading.value + skew(scan, odometry);
        self.points.fill(scan, self.config.sensor_x_m, heading);

        let front = Window { along_min: -FRONT_HALF, along_max: FRONT_HALF, across_max: WALL_MAX };
        let ahead = self.points.wall(Side::Ahead, front);
        let behind = self.points.wall(Side::Behind, front);
        let reach = |wall: Option<Wall>| {
            wall.map_or(SIDE_REACH, |wall| SIDE_REACH.min(wall.distance(0.0) - CORNER))
        };
        let side = |back: f64, fore: f64| Window {
            along_min: -back,
            along_max: fore,
            across_max: WALL_MAX,
        };
        let left = self.points.wall(Side::Left, side(reach(behind), reach(ahead)));
        let right = self.points.wall(Side::Right, side(reach(ahead), reach(behind)));

        let noise = self.config.range_noise_m;
        let direction = self.points.direction();
        let (slope, slope_variance) = shared_slope(&[ahead, left, behind, right], noise)
            // Whatever the course, some points lie in line with it: the whole scan knows better.
            .filter(|(slope, _)| (slope - direction.unwrap_or(0.0)).abs() <= SLOPE_MAX)
            // Every wall is aslant, or far away.
            .or_else(|| Some((direction?, DIRECTION_NOISE * DIRECTION_NOISE)))
            .unwrap_or((0.0, SLOPE_MAX * SLOPE_MAX));
        let heading_measured = self.belief.heading.value - slope;
        self.belief.heading.correct(heading_measured, slope_variance + SLOPE_BIAS * SLOPE_BIAS);

        let measure = |wall: Wall| Estimate {
            value: wall.distance(slope),
            variance: wall.distance_variance(noise, slope_variance) + DISTANCE_BIAS * DISTANCE_BIAS,
        };
        let width_min = 2.0 * self.config.robot_radius_m;
        self.belief.correct_place(left.map(measure), right.map(measure), width_min);

        self.seen = Surroundings {
            ahead: ahead.map(|wall| wall.distance(slope)),
            free_ahead: self.points.free(Side::Ahead, self.config.robot_radius_m + MARGIN_SIDE),
            free_left: self.points.free(Side::Left, OPENING_HALF),
            free_right: self.points.free(Side::Right, OPENING_HALF),
        };
    }

    fn step(&mut self, before: Motion, dt: f64) -> Motion {
        match self.state {
            State::Follow => {
                if self.belief.heading.value.abs() > ASTRAY {
                    self.state = State::Turn;
                    self.turn()
                } else if self.has_arrived() {
                    self.choose_course();
                    self.state = State::Turn;
                    self.turn()
                } else {
                    self.follow(before, dt)
                }
            }
            State::Turn => {
                if self.belief.heading.value.abs() > TURNED {
                    self.turn()
                } else {
                    self.state = State::Follow;
                    self.follow(Motion::STOP, dt)
                }
            }
        }
    }

    /// Whether the corridor ends here: in the middle of the next one, which is as wide, or at
    /// something else that lets nobody pass.
    fn has_arrived(&self) -> bool {
        self.way_ahead() <= ARRIVED
    }

    /// [m] How far the robot may go on.
    fn way_ahead(&self) -> f64 {
        let stop = (0.5 * self.belief.width.value).max(self.stop_min());
        let to_middle = self.seen.ahead.map_or(f64::INFINITY, |ahead| ahead - stop);
        to_middle.min(self.seen.free_ahead - self.stop_min())
    }

    /// [m] From the axle to anything ahead.
    fn stop_min(&self) -> f64 {
        self.config.robot_radius_m + MARGIN_AHEAD
    }

    /// Turns the course to the side that is open, or round.
    fn choose_course(&mut self) {
        let half = 0.5 * self.belief.width.value;
        let is_open = |free: f64| half + OPENING_DEPTH < free;
        let (left, right) = (self.seen.free_left, self.seen.free_right);
        let is_stuck = self.driven.is_some_and(|driven| driven < DRIVEN_MIN);
        let turned = match (is_open(left), is_open(right)) {
            // What was open let nobody in, and would be chosen again and again.
            _ if is_stuck => self.one_of(OTHER_COURSES),
            (true, false) => FRAC_PI_2,
            (false, true) => -FRAC_PI_2,
            (true, true) => self.one_of([FRAC_PI_2, -FRAC_PI_2]),
            (false, false) => PI.copysign(left - right),
        };
        self.driven = Some(0.0);

        // The wall ahead becomes the wall on the far side of the turn.
        let from_middle = self.seen.ahead.map(|ahead| ahead - half);
        let Belief { heading, offset, .. } = &mut self.belief;
        heading.value -= turned;
        if turned.abs() > FRAC_PI_2 {
            offset.value = -offset.value;
        } else if let Some(from_middle) = from_middle {
            let value = from_middle * turned.signum();
            *offset = Estimate { value, variance: PLACE_TURNED * PLACE_TURNED };
        } else {
            *offset = Estimate { value: 0.0, variance: PLACE_UNKNOWN * PLACE_UNKNOWN };
        }
        self.seen = Surroundings::NONE;
    }

    fn one_of<const N: usize>(&mut self, angles: [f64; N]) -> f64 {
        angles[self.random.next_u32() as usize % N]
    }

    fn turn(&self) -> Motion {
        let heading = self.belief.heading.value;
        let speed = (self.config.gain_heading_1_s * heading.abs())
            .clamp(TURN_MIN.min(self.angular_max()), self.angular_max());
        Motion { linear: 0.0, angular: -speed * heading.signum() }
    }

    fn follow(&self, before: Motion, dt: f64) -> Motion {
        let Belief { heading, offset, .. } = &self.belief;
        let approach = -(self.config.gain_offset_rad_m * offset.value);
        let error = approach.clamp(-APPROACH_MAX, APPROACH_MAX) - heading.value;
        let angular =
            (self.config.gain_heading_1_s * error).clamp(-self.angular_max(), self.angular_max());

        let acceleration = self.config.acceleration_m_s2;
        let braking = (2.0 * acceleration * self.way_ahead().max(0.0)).sqrt();
        let linear = self
            .config
            .speed_m_s
            .min(before.linear + acceleration * dt)
            .min(braking)
            .min(self.wheel_max() - 0.5 * self.config.track_m * angular.abs());
        Motion { linear: linear.max(0.0), angular }
    }

    /// [m/s] What a wheel is asked for at most.
    fn wheel_max(&self) -> f64 {
        WHEEL_SHARE * self.config.wheel_speed_max_m_s
    }

    /// [rad/s] What the robot is asked for at most.
    fn angular_max(&self) -> f64 {
        self.config.angular_max_rad_s.min(self.wheel_max() / (0.5 * self.config.track_m))
    }
}

/// What the samples of this update are, against those of the last.
#[derive(Debug, Clone, Copy)]
enum News {
    /// The first, or the first after a gap or of a publisher's new life.
    Start,
    /// No newer than those before.
    Nothing,
    /// So many seconds newer; perhaps only the odometry.
    Samples { dt: f64, scan_is_new: bool },
}

impl Last {
    fn news(&self, scan: &LaserScan, odometry: &Odometry) -> News {
        let scan_dt = scan.header.stamp.since(self.scan);
        let odometry_dt = odometry.header.stamp.since(self.odometry.header.stamp);
        let dt = scan_dt.max(odometry_dt);
        if scan.header.epoch != self.scan_epoch
            || odometry.header.epoch != self.odometry.header.epoch
            || GAP_MAX < dt
        {
            News::Start
        } else if dt.is_zero() {
            News::Nothing
        } else {
            News::Samples { dt: dt.as_secs_f64(), scan_is_new: !scan_dt.is_zero() }
        }
    }

    /// The odometry to compare the next with: the newest that can be computed with.
    fn after(&self, odometry: &Odometry) -> Odometry {
        let is_newer = self.odometry.header.stamp < odometry.header.stamp
            || self.odometry.header.epoch != odometry.header.epoch;
        if is_newer && is_finite(odometry) { *odometry } else { self.odometry }
    }
}

impl Belief {
    fn unknown(width: f64) -> Self {
        let place = |value| Estimate { value, variance: PLACE_UNKNOWN * PLACE_UNKNOWN };
        Self {
            heading: Estimate { value: 0.0, variance: HEADING_UNKNOWN * HEADING_UNKNOWN },
            offset: place(0.0),
            width: place(width),
        }
    }

    /// Corrects offset and width by the distances of the side walls, as far as they are believed.
    fn correct_place(&mut self, left: Option<Estimate>, right: Option<Estimate>, width_min: f64) {
        if let (Some(left), Some(right)) = (left, right) {
            let width = left.value + right.value;
            let variance = left.variance + right.variance;
            let is_expected = self.width.expects(width, variance);
            // A narrower place is narrow, whatever was believed; a wider one may be an opening, and
            // where the robot would not fit, it does not stand.
            if width_min <= width && (is_expected || width < self.width.value) {
                if !is_expected {
                    self.width.variance = PLACE_UNKNOWN * PLACE_UNKNOWN;
                }
                self.width.correct(width, variance);
                self.offset.correct(0.5 * (right.value - left.value), 0.25 * variance);
                return;
            }
        }

        // At most one side has a wall of the corridor; the other is an opening's.
        let half = 0.5 * self.width.value;
        let by_left = left.map(|left| (half - left.value, left.variance));
        let by_right = right.map(|right| (right.value - half, right.variance));
        let believed = [by_left, by_right]
            .into_iter()
            .flatten()
            .filter(|&(offset, variance)| self.offset.expects(offset, variance))
            .min_by(|one, other| {
                let surprise = |measured: f64| (measured - self.offset.value).abs();
                surprise(one.0).total_cmp(&surprise(other.0))
            });
        if let Some((offset, variance)) = believed {
            self.offset.correct(offset, variance);
        }
    }
}

impl Estimate {
    fn shift(&mut self, by: f64, deviation: f64) {
        self.value += by;
        self.variance += deviation * deviation;
    }

    fn expects(&self, measured: f64, variance: f64) -> bool {
        let deviation = (self.variance + variance).sqrt();
        (measured - self.value).abs() <= 3.0 * deviation + SURPRISE_MAX
    }

    fn correct(&mut self, measured: f64, variance: f64) {
        let gain = self.variance / (self.variance + variance);
        self.value += gain * (measured - self.value);
        self.variance *= 1.0 - gain;
    }
}

impl Surroundings {
    const NONE: Self = Self {
        ahead: None,
        free_ahead: f64::INFINITY,
        free_left: f64::INFINITY,
        free_right: f64::INFINITY,
    };
}

/// [m, rad] How far the robot went, forward and round; nothing where that cannot be told.
fn moved(before: &Odometry, after: &Odometry) -> Option<(f64, f64)> {
    if !is_finite(before) || !is_finite(after) {
        return None;
    }
    let turned = libm::remainder(after.yaw - before.yaw, 2.0 * PI);
    let (sin, cos) = libm::sincos(before.yaw + 0.5 * turned);
    let distance = (after.x - before.x) * cos + (after.y - before.y) * sin;
    (distance.abs() <= JUMP_MIN).then_some((distance, turned))
}

fn is_finite(odometry: &Odometry) -> bool {
    odometry.x.is_finite() && odometry.y.is_finite() && odometry.yaw.is_finite()
}

/// [rad] How the robot turned from the odometry's time to the scan's.
fn skew(scan: &LaserScan, odometry: &Odometry) -> f64 {
    let (scan, stamp) = (scan.header.stamp, odometry.header.stamp);
    let time = scan.since(stamp).as_secs_f64() - stamp.since(scan).as_secs_f64();
    let turned = odometry.angular * time.clamp(-SKEW_MAX, SKEW_MAX);
    if turned.is_finite() { turned } else { 0.0 }
}

#[cfg(test)]
mod tests;
