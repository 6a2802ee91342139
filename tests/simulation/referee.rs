//! Watches a robot by rules of its own: which commands are valid and what the wheels may do then. It
//! knows the promises and none of the code that keeps them.

use std::ops::Add;
use std::time::Duration;

use interfaces::{SensorPair, Stamp, VelocityCommand};
use node::deadman::Motion;

/// Between two drive steps.
pub(super) const STEP: Duration = Duration::from_millis(10);

const TIMEOUT: Duration = Duration::from_millis(200);
const SKEW_MAX: Duration = Duration::from_millis(500);
const HEALTHY_FOR: Duration = Duration::from_millis(500);
const LINEAR_MAX: f64 = 0.22;
const ANGULAR_MAX: f64 = 2.84;

/// [m/s^2], [rad/s^2] Where commands cease, and where somebody pulls the emergency stop.
const BRAKING: [f64; 2] = [1.0, 12.0];
const EMERGENCY_BRAKING: [f64; 2] = [5.0, 60.0];

/// What the emergency stop takes from the latch on, a drive step included.
const EMERGENCY_MAX: Duration = Duration::from_millis(60);

/// [-] So often a robot is armed by itself
const REARMS_MAX: usize = 3;

/// within this.
const REARM_WINDOW: Duration = Duration::from_secs(60);

/// What a command may be computed from: a pair formed not longer ago,
const FORMED_MAX: Duration = Duration::from_millis(150);

/// of samples no older,
const AGE_MAX: Duration = Duration::from_millis(500);

/// nor from farther in the future.
const AHEAD_MAX: Duration = Duration::from_millis(10);

/// A follower that has seen nothing for longer forgets where it was.
const MEMORY: Duration = Duration::from_secs(1);

/// [-] For the last bits.
const TOLERANCE: f64 = 1e-9;

/// [-] For a ramp that takes whole nanoseconds.
const RAMP_TOLERANCE: f64 = 1e-6;

pub(super) struct Referee {
    seed: u64,
    /// Epoch and number of the newest valid command.
    newest: Option<(u32, u64)>,
    heard: Option<Stamp>,
    obeyed: Motion,
    halt: Option<Halt>,
    latched: Option<Stamp>,
    rearms: Vec<Stamp>,
    before: Motion,
    /// What a follower was driven by last: the controller's life, the pair and what it commanded.
    followed: Option<(u32, SensorPair, Motion)>,
    /// Whether a follower had to begin without knowing what was before.
    pub(super) has_begun_anew: bool,
    pub(super) figures: Figures,
}

/// What happened, so that nobody takes an empty run for a passed one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Figures {
    pub(super) valid: u64,
    pub(super) invalid: u64,
    pub(super) of_old_lives: u64,
    pub(super) trips: u64,
    pub(super) rearms: u64,
    pub(super) emergency_stops: u64,
    pub(super) arms: u64,
}

impl Figures {
    pub(super) fn all_happened(&self) -> bool {
        let Self { valid, invalid, of_old_lives, trips, rearms, emergency_stops, arms } = *self;
        [valid, invalid, of_old_lives, trips, rearms, emergency_stops, arms].iter().all(|&n| 0 < n)
    }
}

impl Add for Figures {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            valid: self.valid + other.valid,
            invalid: self.invalid + other.invalid,
            of_old_lives: self.of_old_lives + other.of_old_lives,
            trips: self.trips + other.trips,
            rearms: self.rearms + other.rearms,
            emergency_stops: self.emergency_stops + other.emergency_stops,
            arms: self.arms + other.arms,
        }
    }
}

/// The robot must come to rest, and stay so until it may go on.
#[derive(Debug, Clone, Copy)]
struct Halt {
    is_latch: bool,
    rest_by: Stamp,
    needs_person: bool,
    /// Valid commands without a break, beginning with zero: since when, and until when.
    stream: Option<(Stamp, Stamp)>,
}

impl Referee {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            seed,
            newest: None,
            heard: None,
            obeyed: Motion::ZERO,
            halt: None,
            latched: None,
            rearms: Vec::new(),
            before: Motion::ZERO,
            followed: None,
            has_begun_anew: false,
            figures: Figures::default(),
        }
    }

    /// A drive step begins: what time alone brings about.
    pub(super) fn look(&mut self, now: Stamp) {
        match &mut self.halt {
            None => {
                if self.heard.is_some_and(|heard| TIMEOUT < now.since(heard)) {
                    self.figures.trips += 1;
                    let rearms = self.rearms.iter();
                    let lately = rearms.filter(|&&rearm| now.since(rearm) < REARM_WINDOW).count();
                    self.halt(now, false, REARMS_MAX <= lately);
                }
            }
            Some(Halt { stream, .. }) => {
                if stream.is_some_and(|(_, heard)| TIMEOUT < now.since(heard)) {
                    *stream = None;
                }
            }
        }
    }

    /// The emergency stop was latched or released.
    pub(super) fn sees_latch(&mut self, now: Stamp, is_latched: bool) {
        if is_latched == self.latched.is_some() {
            return;
        }
        self.latched = is_latched.then_some(now);
        if is_latched {
            self.figures.emergency_stops += 1;
            let needs_person = self.halt.is_some_and(|halt| halt.needs_person);
            self.halt(now, true, needs_person);
        } else if let Some(halt) = &mut self.halt {
            halt.stream = None;
        }
    }

    /// A person armed the robot.
    pub(super) fn sees_arm(&mut self, now: Stamp) {
        self.figures.arms += 1;
        self.rearms.clear();
        if let Some(halt) = &mut self.halt {
            halt.needs_person = false;
        }
        self.go_on_if_allowed(now);
    }

    /// A controller sends this command, computed from that pair.
    pub(super) fn sees_sent(&self, now: Stamp, ticket: &SensorPair, command: &VelocityCommand) {
        let stamps = [ticket.scan_stamp, ticket.odometry_stamp];
        let is_fresh = now.since(ticket.formed) <= FORMED_MAX
            && stamps.iter().all(|&stamp| now.since(stamp) <= AGE_MAX)
            && stamps.iter().all(|&stamp| stamp.since(now) <= AHEAD_MAX);
        self.hold(is_fresh, now, "drives by a stale pair", &(ticket, command));
        self.hold(is_within_limits(command), now, "commands what no wheel may do", command);
    }

    /// The follower of this life of the controller drives by that pair.
    pub(super) fn sees_followed(
        &mut self,
        now: Stamp,
        life: u32,
        ticket: &SensorPair,
        command: &VelocityCommand,
    ) {
        let motion = Motion { linear: command.linear, angular: command.angular };
        let followed = self.followed.replace((life, *ticket, motion));
        let follows_on = followed.is_none_or(|(_, before, _)| {
            let lives = |ticket: &SensorPair| (ticket.scan_epoch, ticket.odometry_epoch);
            lives(&before) == lives(ticket)
                && ticket.scan_stamp.since(before.scan_stamp) <= MEMORY
                && ticket.odometry_stamp.since(before.odometry_stamp) <= MEMORY
        });
        self.has_begun_anew |= !follows_on || 1 < life;

        // The samples are those that the numbers name, whatever else a damaged ticket says.
        let numbers = |ticket: &SensorPair| (ticket.scan_sequence, ticket.odometry_sequence);
        let is_repeated = followed.is_some_and(|(life_before, before, _)| {
            follows_on && life_before == life && numbers(&before) == numbers(ticket)
        });
        let is_same = followed.is_some_and(|(_, _, before)| before == motion);
        self.hold(is_same || !is_repeated, now, "learns from a pair twice", &(followed, command));
    }

    /// A command reached the wheels, which were driven like `before` and are driven like `after`.
    pub(super) fn sees_received(
        &mut self,
        now: Stamp,
        command: &VelocityCommand,
        before: Motion,
        after: Motion,
    ) {
        if !self.is_valid(now, command) {
            self.figures.invalid += 1;
            let bits = |motion: Motion| [motion.linear.to_bits(), motion.angular.to_bits()];
            let is_ignored = bits(before) == bits(after);
            self.hold(is_ignored, now, "is driven by an invalid command", &(command, after));
            return;
        }
        self.figures.valid += 1;
        self.newest = Some((command.header.epoch, command.header.sequence));
        self.heard = Some(now);
        self.obeyed = Motion { linear: command.linear, angular: command.angular };
        let Some(halt) = &mut self.halt else { return };
        halt.stream = match halt.stream {
            Some((since, _)) => Some((since, now)),
            None => self.obeyed.is_zero().then_some((now, now)),
        };
        self.go_on_if_allowed(now);
    }

    /// The wheels are told `motion`, and the robot moves by so many metres and radians in a step.
    pub(super) fn judge(&mut self, now: Stamp, motion: Motion, moved: [f64; 2]) {
        let told = [motion.linear.abs(), motion.angular.abs()];
        let before = [self.before.linear.abs(), self.before.angular.abs()];
        let limits = [LINEAR_MAX, ANGULAR_MAX].map(|limit| limit * (1.0 + TOLERANCE) + TOLERANCE);
        let seconds = STEP.as_secs_f64();
        for axis in [0, 1] {
            let is_slow = told[axis] <= limits[axis]
                && moved[axis].abs() <= limits[axis] * seconds + TOLERANCE;
            self.hold(is_slow, now, "is faster than its limits", &(motion, moved));
        }
        if motion.is_zero() {
            let is_still = moved.iter().all(|moved| moved.abs() <= TOLERANCE);
            self.hold(is_still, now, "moves with its wheels at rest", &moved);
        }

        let silent = self.heard.map(|heard| now.since(heard));
        let ramp_max = (LINEAR_MAX / BRAKING[0]).max(ANGULAR_MAX / BRAKING[1]);
        let silent_max = TIMEOUT + STEP + Duration::from_secs_f64(ramp_max) + STEP;
        let is_commanded = silent.is_some_and(|silent| silent <= silent_max);
        self.hold(is_commanded || motion.is_zero(), now, "moves uncommanded", &(motion, silent));
        let is_free = self.latched.is_none_or(|latched| now.since(latched) < EMERGENCY_MAX);
        self.hold(is_free || motion.is_zero(), now, "moves in an emergency stop", &motion);

        match self.halt {
            None => {
                self.hold(motion == self.obeyed, now, "does not obey", &(motion, self.obeyed));
            }
            Some(halt) => {
                let is_at_rest = motion.is_zero() || now < halt.rest_by;
                self.hold(is_at_rest, now, "moves without permission", &(motion, halt));
                let rates = if halt.is_latch { EMERGENCY_BRAKING } else { BRAKING };
                for axis in [0, 1] {
                    let braked = before[axis] - told[axis];
                    let braked_max = rates[axis] * seconds * (1.0 + RAMP_TOLERANCE);
                    let is_ramp = (-TOLERANCE..=braked_max).contains(&braked);
                    self.hold(is_ramp, now, "leaves the ramp", &(self.before, motion, halt));
                }
            }
        }
        self.before = motion;
    }

    #[track_caller]
    pub(super) fn hold(&self, holds: bool, now: Stamp, breach: &str, what: &dyn std::fmt::Debug) {
        let seconds = now.since(super::plan::START).as_secs_f64();
        assert!(holds, "SEED={}: after {seconds:.2} s it {breach}: {what:?}", self.seed);
    }

    fn halt(&mut self, now: Stamp, is_latch: bool, needs_person: bool) {
        let [linear, angular] = if is_latch { EMERGENCY_BRAKING } else { BRAKING };
        let Motion { linear: speed, angular: turning } = self.before;
        let ramp = (speed.abs() / linear).max(turning.abs() / angular);
        let rest_by = now.after(Duration::from_secs_f64(ramp)).after(Duration::from_nanos(1));
        self.halt = Some(Halt { is_latch, rest_by, needs_person, stream: None });
    }

    fn go_on_if_allowed(&mut self, now: Stamp) {
        let Some(halt) = self.halt else { return };
        let is_healthy = halt.stream.is_some_and(|(since, _)| HEALTHY_FOR <= now.since(since));
        let may_go_on = is_healthy && !halt.needs_person && halt.rest_by <= now;
        if may_go_on && self.latched.is_none() {
            if !halt.is_latch {
                self.figures.rearms += 1;
                self.rearms.push(now);
            }
            self.halt = None;
        }
    }

    fn is_valid(&mut self, now: Stamp, command: &VelocityCommand) -> bool {
        let header = &command.header;
        let newest = self.newest.unwrap_or_default();
        if header.epoch < newest.0 {
            self.figures.of_old_lives += 1;
        }
        let is_newer = self.newest.is_none() || newest < (header.epoch, header.sequence);
        let apart = now.nanoseconds.abs_diff(header.stamp.nanoseconds);
        is_newer && is_within_limits(command) && Duration::from_nanos(apart) <= SKEW_MAX
    }
}

/// Whether no number of it is too large, nor none at all.
fn is_within_limits(command: &VelocityCommand) -> bool {
    let is_within = |speed: f64, limit: f64| speed.abs() <= limit * (1.0 + TOLERANCE);
    is_within(command.linear, LINEAR_MAX) && is_within(command.angular, ANGULAR_MAX)
}
