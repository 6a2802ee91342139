//! The dead-man at the wheels: which command may move the robot, and what stops it where none may.
//!
//! Pure: time comes in as an argument, commands come in as they were received, and what the wheels
//! shall do now comes out. Whatever drives the wheels, simulator or bridge, asks here and nowhere
//! else. Only a *valid* command counts: of the newest life of its publisher, newer than the one
//! before, finite, within the limits, and with a stamp near now. What is not is refused with a
//! reason, never clamped, and never taken for a sign of life.
//!
//! Without a valid command for the time-out the robot *trips*: it brakes on the path it was on, holds
//! zero, and stays so until commands have come without a break for a while, beginning with zero.
//! That happens by itself a few times; one who trips more often has to be armed by a person.

mod braking;
mod config;
mod rejection;
#[cfg(test)]
mod tests;

use std::time::Duration;

use interfaces::{MotionState, Permission, REJECTIONS_MAX, Stamp, StopCause, VelocityCommand};

pub use config::{Config, REARMS_MAX};
pub use rejection::Rejection;

use braking::Braking;

/// How the wheels shall move the robot, in `base_link`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// [m/s] Speed along x.
    pub linear: f64,
    /// [rad/s] Turning speed about z.
    pub angular: f64,
}

impl Motion {
    /// No motion.
    pub const ZERO: Self = Self { linear: 0.0, angular: 0.0 };

    /// Whether this is no motion at all.
    pub fn is_zero(self) -> bool {
        self == Self::ZERO
    }
}

/// The dead-man of one robot.
#[derive(Debug, Clone)]
pub struct DeadMan {
    config: Config,
    state: State,
    newest: Newest,
    estopped: bool,
    has_drive: bool,
    /// Whether commands have ever moved it.
    has_driven: bool,
    rearms: Rearms,
    report: Report,
}

/// Whether commands are followed.
#[derive(Debug, Clone, Copy, PartialEq)]
enum State {
    /// They are; and none has come yet.
    Waiting,
    /// They are; the last one came at `heard`.
    Driving { heard: Stamp, motion: Motion },
    /// They are not.
    Stopped { braking: Braking, stream: Option<Stream>, needs_person: bool },
}

/// Commands that have come without a break, beginning with zero, while the robot was stopped.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stream {
    since: Stamp,
    heard: Stamp,
    motion: Motion,
}

/// The newest valid command: its publisher's life and its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Newest {
    epoch: u32,
    sequence: u64,
    received: Stamp,
}

/// When the robot was armed again by itself, the last few times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Rearms([Option<Stamp>; REARMS_MAX]);

/// What is told about it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Report {
    cause: StopCause,
    accepted: u64,
    rejected: [u64; REJECTIONS_MAX],
    trips: u64,
    changes: u64,
}

impl DeadMan {
    /// A robot at rest that has heard nothing yet.
    pub fn new(config: &Config) -> Self {
        let mut dead_man = Self {
            config: *config,
            state: State::Waiting,
            newest: Newest::default(),
            estopped: false,
            has_drive: true,
            has_driven: false,
            rearms: Rearms::default(),
            report: Report { changes: 1, ..Report::default() },
        };
        if !config.start_armed {
            let braking = Braking::at_rest();
            dead_man.state = State::Stopped { braking, stream: None, needs_person: true };
            dead_man.report.cause = StopCause::NotArmed;
        }
        dead_man
    }

    /// Takes a command as it was received, at `now`; says why where it may not move the robot.
    ///
    /// A valid command is followed only while the robot is armed.
    pub fn hear(&mut self, now: Stamp, command: &VelocityCommand) -> Result<(), Rejection> {
        self.look(now);
        if let Err(rejection) = self.validate(now, command) {
            self.report.rejected[rejection as usize] += 1;
            return Err(rejection);
        }
        let header = &command.header;
        self.newest = Newest { epoch: header.epoch, sequence: header.sequence, received: now };
        self.report.accepted += 1;
        let motion = Motion { linear: command.linear, angular: command.angular };
        match &mut self.state {
            State::Waiting | State::Driving { .. } => {
                self.state = State::Driving { heard: now, motion };
            }
            State::Stopped { stream: Some(stream), .. } => {
                stream.heard = now;
                stream.motion = motion;
            }
            State::Stopped { stream, .. } => {
                // A stream that does not begin with zero would move the robot with a jerk.
                *stream = motion.is_zero().then_some(Stream { since: now, heard: now, motion });
            }
        }
        self.rearm(now);
        self.has_driven |= matches!(self.state, State::Driving { .. });
        Ok(())
    }

    /// What the wheels shall do at `now`.
    pub fn motion(&mut self, now: Stamp) -> Motion {
        self.look(now);
        match &self.state {
            State::Waiting => Motion::ZERO,
            State::Driving { motion, .. } => *motion,
            State::Stopped { braking, .. } => braking.motion(now),
        }
    }

    /// Says at `now` whether the emergency stop is latched. Latched, it stops the robot at once and
    /// holds it; released, the robot still has to be armed again, by itself where it may.
    pub fn set_emergency_stop(&mut self, now: Stamp, latched: bool) {
        if latched == self.estopped {
            return;
        }
        // Or a trip that is due by now would never have been.
        self.look(now);
        self.estopped = latched;
        if latched {
            self.stop(now, StopCause::EmergencyStop);
            return;
        }
        self.report.changes += 1;
        if let State::Stopped { stream, .. } = &mut self.state {
            // What was sent into the latch has shown nobody's health.
            *stream = None;
        }
    }

    /// Says at `now` whether the wheels can be reached, as they can where nothing was said. While they
    /// cannot the robot is stopped; after that it has to be armed again, by itself where it may.
    pub fn set_drive(&mut self, now: Stamp, is_there: bool) {
        if is_there == self.has_drive {
            return;
        }
        self.look(now);
        self.has_drive = is_there;
        if !is_there {
            self.stop(now, StopCause::DriveLost);
            return;
        }
        if let State::Stopped { stream, .. } = &mut self.state {
            // What was sent to wheels that nobody could reach has shown nobody's health.
            *stream = None;
        }
    }

    /// Whether commands move the robot at `now`, and the last one is not too old.
    pub fn is_fed(&self, now: Stamp) -> bool {
        self.due().is_some_and(|due| now <= due)
    }

    /// Nobody looks after this robot any more: it stops for good.
    pub fn lose_supervisor(&mut self, now: Stamp) {
        if self.report.cause != StopCause::SupervisorLost {
            self.stop(now, StopCause::SupervisorLost);
        }
    }

    /// Whoever drives the wheels is about to let go of them: they come to rest before.
    pub fn pause(&mut self, now: Stamp) {
        self.look(now);
        if matches!(self.state, State::Waiting | State::Driving { .. }) {
            self.stop(now, StopCause::Paused);
        }
    }

    /// A person allows the robot to move again: it does once commands come as they should.
    pub fn arm(&mut self, now: Stamp) {
        self.look(now);
        self.rearms = Rearms::default();
        if let State::Stopped { needs_person, .. } = &mut self.state {
            *needs_person = false;
        }
        // Who asks is answered, whether it made a difference or not.
        self.report.changes += 1;
        self.rearm(now);
    }

    /// Whether the wheels are commanded to zero, and stay so until something changes.
    pub fn is_at_rest(&self, now: Stamp) -> bool {
        match &self.state {
            State::Waiting => true,
            State::Driving { .. } => false,
            State::Stopped { braking, .. } => braking.motion(now).is_zero(),
        }
    }

    /// The moment at which the robot trips unless a valid command comes before.
    pub fn due(&self) -> Option<Stamp> {
        match &self.state {
            State::Driving { heard, .. } => Some(heard.after(self.config.timeout())),
            State::Waiting | State::Stopped { .. } => None,
        }
    }

    /// Grows with everything that [`DeadMan::describe`] tells, but for the counters of commands.
    pub fn changes(&self) -> u64 {
        self.report.changes
    }

    /// Writes what is to be told about the robot's motion, all but the header.
    pub fn describe(&self, now: Stamp, state: &mut MotionState) {
        let report = &self.report;
        let (permission, needs_person) = match &self.state {
            State::Waiting | State::Driving { .. } => (Permission::Armed, false),
            State::Stopped { braking, needs_person, .. } if braking.motion(now).is_zero() => {
                (Permission::Held, *needs_person)
            }
            State::Stopped { needs_person, .. } => (Permission::Braking, *needs_person),
        };
        state.permission = permission as u8;
        state.cause = report.cause as u8;
        state.needs_person = u8::from(needs_person);
        state.emergency_stop = u8::from(self.estopped);
        state.command_epoch = self.newest.epoch;
        state.command_sequence = self.newest.sequence;
        state.command_received = self.newest.received;
        state.accepted = report.accepted;
        state.rejected = report.rejected;
        state.trips = report.trips;
    }

    /// [-] Commands refused so far for this reason.
    pub fn rejected(&self, reason: Rejection) -> u64 {
        self.report.rejected[reason as usize]
    }

    /// [-] Commands taken for valid so far.
    pub fn accepted(&self) -> u64 {
        self.report.accepted
    }

    /// [-] How often the robot was stopped because no valid command came.
    pub fn trips(&self) -> u64 {
        self.report.trips
    }

    /// What time alone changes.
    fn look(&mut self, now: Stamp) {
        match &mut self.state {
            State::Waiting => {}
            State::Driving { heard, .. } => {
                if self.config.timeout() < now.since(*heard) {
                    self.report.trips += 1;
                    self.stop(now, StopCause::Silence);
                }
            }
            State::Stopped { braking, stream, .. } => {
                if stream.is_some_and(|stream| self.config.timeout() < now.since(stream.heard)) {
                    *stream = None;
                }
                if braking.comes_to_rest(now) {
                    self.report.changes += 1;
                }
            }
        }
    }

    /// Brakes from whatever the wheels do now. A later cause does not make an earlier one weaker.
    fn stop(&mut self, now: Stamp, cause: StopCause) {
        let motion = match &self.state {
            State::Waiting => Motion::ZERO,
            State::Driving { motion, .. } => *motion,
            State::Stopped { braking, .. } => braking.motion(now),
        };
        let needs_person = match (&self.state, cause) {
            (State::Stopped { needs_person, .. }, _) => *needs_person,
            (State::Driving { .. }, StopCause::Silence | StopCause::DriveLost) => {
                let window = Duration::from_secs_f64(self.config.rearm_window_s);
                self.rearms.within(now, window) == REARMS_MAX
            }
            (State::Waiting | State::Driving { .. }, _) => false,
        };
        let rate = match cause {
            StopCause::EmergencyStop | StopCause::SupervisorLost => {
                self.config.emergency_deceleration()
            }
            StopCause::None
            | StopCause::NotArmed
            | StopCause::Silence
            | StopCause::Paused
            | StopCause::DriveLost => self.config.deceleration(),
        };
        let braking = Braking::new(now, motion, rate);
        self.state = State::Stopped { braking, stream: None, needs_person };
        if self.report.cause != StopCause::SupervisorLost {
            self.report.cause = cause;
        }
        self.report.changes += 1;
    }

    /// Lets the robot move again where everything speaks for it.
    fn rearm(&mut self, now: Stamp) {
        let State::Stopped { braking, stream: Some(stream), needs_person: false } = self.state
        else {
            return;
        };
        let is_healthy = self.config.rearm_after() <= now.since(stream.since);
        let is_for_good =
            matches!(self.report.cause, StopCause::SupervisorLost | StopCause::Paused);
        let is_over = !self.estopped && self.has_drive && !is_for_good;
        if is_healthy && is_over && braking.motion(now).is_zero() {
            // Who waited for its wheels at the start has not been stopped in motion.
            let was_stopped =
                matches!(self.report.cause, StopCause::Silence | StopCause::DriveLost);
            if self.has_driven && was_stopped {
                self.rearms.note(now);
            }
            self.state = State::Driving { heard: stream.heard, motion: stream.motion };
            self.report.cause = StopCause::None;
            self.report.changes += 1;
        }
    }

    fn validate(&self, now: Stamp, command: &VelocityCommand) -> Result<(), Rejection> {
        let header = &command.header;
        let (linear, angular) = (command.linear, command.angular);
        if header.epoch < self.newest.epoch {
            return Err(Rejection::OldEpoch);
        }
        let has_heard = 0 < self.report.accepted;
        if has_heard && header.epoch == self.newest.epoch && header.sequence <= self.newest.sequence
        {
            return Err(Rejection::NotNewer);
        }
        if !linear.is_finite() || !angular.is_finite() {
            return Err(Rejection::NotFinite);
        }
        if self.config.linear_max() < linear.abs() || self.config.angular_max() < angular.abs() {
            return Err(Rejection::BeyondLimits);
        }
        let skew = self.config.skew_max();
        if skew < now.since(header.stamp) {
            return Err(Rejection::StampTooOld);
        }
        if skew < header.stamp.since(now) {
            return Err(Rejection::StampAhead);
        }
        Ok(())
    }
}

impl Rearms {
    fn note(&mut self, now: Stamp) {
        let oldest = self.0.iter_mut().min_by_key(|moment| **moment);
        if let Some(oldest) = oldest {
            *oldest = Some(now);
        }
    }

    fn within(self, now: Stamp, window: Duration) -> usize {
        self.0.iter().flatten().filter(|moment| now.since(**moment) < window).count()
    }
}
