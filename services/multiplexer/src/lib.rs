//! Who drives where several could: the source of the highest priority that is heard.
//!
//! Pure, after ROS's `twist_mux`: commands come in as they were received, with the time, and for each
//! comes out whether it is passed on. One of a higher priority takes over with its first command;
//! lower ones are heard again when it has been silent for its time-out, or has left in order.
//!
//! A command is passed on as it is, or not at all. Nothing is blended, ramped or made up here: how
//! fast the robot may change its speed is known to whoever drives the wheels, and a stream that was
//! smoothed would hide from it how old its data is. On a take-over the wheels get the person's next
//! command in place of the controller's. The other way round there is a silence between the two, if
//! the person was lost: the dead-man at the wheels stops the robot in it, and lets it go on only with
//! a stream that begins at rest. Where the person let go of a robot that stands, there is no need for
//! one.

#![forbid(unsafe_code)]

mod config;
mod run;

use interfaces::{Stamp, VelocityCommand};

pub use config::{Config, TUNABLES};
pub use run::{check, run};

/// Who may command the robot; the more important, the earlier.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// A person.
    Teleop,
    /// The controller.
    Autonomy,
}

impl Source {
    /// Every source, the most important first.
    pub const ALL: [Self; 2] = [Self::Teleop, Self::Autonomy];

    /// Its name.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Teleop => "teleop",
            Self::Autonomy => "autonomy",
        }
    }
}

/// What becomes of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It goes to the wheels.
    Passed,
    /// A more important source drives.
    Outranked,
    /// It is no number, and so no sign of life either.
    Invalid,
}

/// [-] What became of a source's commands so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// [-] Passed on.
    pub passed: u64,
    /// [-] Kept back while a more important source drove.
    pub outranked: u64,
    /// [-] Not finite.
    pub invalid: u64,
}

/// Which of several sources drives.
#[derive(Debug, Clone)]
pub struct Multiplexer {
    config: Config,
    lines: [Line; Source::ALL.len()],
    last: Option<Source>,
    take_overs: u64,
}

/// What is known of one source.
#[derive(Debug, Clone, Copy, Default)]
struct Line {
    heard: Option<Heard>,
    counts: Counts,
}

/// A source's newest valid command.
#[derive(Debug, Clone, Copy)]
struct Heard {
    received: Stamp,
    is_zero: bool,
}

impl Multiplexer {
    /// One that has heard nobody yet.
    pub fn new(config: &Config) -> Self {
        Self { config: *config, lines: Default::default(), last: None, take_overs: 0 }
    }

    /// From now on waits for so long.
    pub fn retune(&mut self, config: &Config) {
        self.config = *config;
    }

    /// Takes a command of `source` as it was received, at `now`.
    pub fn hear(&mut self, now: Stamp, source: Source, command: &VelocityCommand) -> Verdict {
        let verdict = self.judge(now, source, command);
        let counts = &mut self.lines[source as usize].counts;
        match verdict {
            Verdict::Passed => counts.passed += 1,
            Verdict::Outranked => counts.outranked += 1,
            Verdict::Invalid => counts.invalid += 1,
        }
        verdict
    }

    /// `source` has ended. If its last word was to stand still, nobody has to wait for another.
    pub fn leave(&mut self, source: Source) {
        let heard = &mut self.lines[source as usize].heard;
        *heard = heard.filter(|heard| !heard.is_zero);
    }

    /// Who drives at `now`.
    pub fn driver(&self, now: Stamp) -> Option<Source> {
        let is_heard = |source: &Source| {
            self.lines[*source as usize]
                .heard
                .is_some_and(|heard| now.since(heard.received) < self.config.timeout(*source))
        };
        Source::ALL.into_iter().find(is_heard)
    }

    /// What became of the commands of `source`.
    pub fn counts(&self, source: Source) -> Counts {
        self.lines[source as usize].counts
    }

    /// [-] How often another source than before was passed on.
    pub fn take_overs(&self) -> u64 {
        self.take_overs
    }

    fn judge(&mut self, now: Stamp, source: Source, command: &VelocityCommand) -> Verdict {
        let (linear, angular) = (command.linear, command.angular);
        if !linear.is_finite() || !angular.is_finite() {
            return Verdict::Invalid;
        }
        let is_zero = linear == 0.0 && angular == 0.0;
        self.lines[source as usize].heard = Some(Heard { received: now, is_zero });
        if self.driver(now) != Some(source) {
            return Verdict::Outranked;
        }
        if self.last.replace(source).is_some_and(|last| last != source) {
            self.take_overs += 1;
        }
        Verdict::Passed
    }
}

#[cfg(test)]
mod tests {
    use super::Source::{Autonomy, Teleop};
    use super::Verdict::{Invalid, Outranked, Passed};
    use super::*;

    /// A multiplexer with the defaults, on a clock that counts milliseconds.
    struct Bench(Multiplexer);

    impl Bench {
        fn new() -> Self {
            Self(Multiplexer::new(&Config::default()))
        }

        fn hear(&mut self, at_ms: u64, source: Source, linear: f64) -> Verdict {
            let command = VelocityCommand { linear, ..VelocityCommand::default() };
            self.0.hear(ms(at_ms), source, &command)
        }
    }

    fn ms(milliseconds: u64) -> Stamp {
        Stamp::from_nanoseconds(milliseconds * 1_000_000)
    }

    #[test]
    fn alone_each_source_is_passed_on() {
        for source in Source::ALL {
            let mut bench = Bench::new();
            assert_eq!(bench.hear(0, source, 0.1), Passed);
            assert_eq!(bench.0.driver(ms(0)), Some(source));
            assert_eq!(bench.0.counts(source).passed, 1);
        }
    }

    #[test]
    fn a_person_takes_over_with_the_first_command() {
        let mut bench = Bench::new();
        bench.hear(0, Autonomy, 0.1);

        assert_eq!(bench.hear(1, Teleop, 0.0), Passed);
        assert_eq!(bench.hear(2, Autonomy, 0.1), Outranked);
        assert_eq!(bench.0.driver(ms(2)), Some(Teleop));
        assert_eq!(bench.0.take_overs(), 1);
    }

    #[test]
    fn autonomy_is_heard_again_after_the_person_s_time_out_and_not_before() {
        let mut bench = Bench::new();
        bench.hear(0, Teleop, 0.1);

        assert_eq!(bench.hear(499, Autonomy, 0.1), Outranked);
        assert_eq!(bench.hear(500, Autonomy, 0.1), Passed);
        assert_eq!(bench.0.driver(ms(500)), Some(Autonomy));
        assert_eq!(bench.0.take_overs(), 1);
        assert_eq!(bench.0.counts(Autonomy), Counts { passed: 1, outranked: 1, invalid: 0 });
    }

    #[test]
    fn nobody_drives_where_everybody_is_silent() {
        let mut bench = Bench::new();
        assert_eq!(bench.0.driver(ms(0)), None);
        bench.hear(0, Autonomy, 0.1);

        assert_eq!(bench.0.driver(ms(199)), Some(Autonomy));
        assert_eq!(bench.0.driver(ms(200)), None);
    }

    #[test]
    fn what_is_no_number_is_counted_and_no_sign_of_life() {
        let mut bench = Bench::new();
        bench.hear(0, Teleop, 0.1);
        for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(bench.hear(400, Teleop, wrong), Invalid);
            let turning = VelocityCommand { angular: wrong, ..VelocityCommand::default() };
            assert_eq!(bench.0.hear(ms(400), Teleop, &turning), Invalid);
        }

        assert_eq!(bench.hear(500, Autonomy, 0.1), Passed);
        assert_eq!(bench.0.counts(Teleop), Counts { passed: 1, outranked: 0, invalid: 6 });
    }

    #[test]
    fn one_who_leaves_a_robot_that_stands_is_not_waited_for() {
        let mut bench = Bench::new();
        bench.hear(0, Teleop, 0.1);
        bench.hear(1, Teleop, 0.0);
        bench.0.leave(Teleop);

        assert_eq!(bench.hear(2, Autonomy, 0.1), Passed);
    }

    #[test]
    fn one_who_leaves_a_robot_that_moves_is_lost_and_waited_for() {
        let mut bench = Bench::new();
        bench.hear(0, Teleop, 0.1);
        bench.0.leave(Teleop);

        assert_eq!(bench.hear(499, Autonomy, 0.1), Outranked);
        assert_eq!(bench.hear(500, Autonomy, 0.1), Passed);
    }

    #[test]
    fn a_clock_that_another_process_reads_ahead_does_no_harm() {
        let mut bench = Bench::new();
        bench.hear(1_000, Teleop, 0.1);

        assert_eq!(bench.0.driver(ms(900)), Some(Teleop));
        assert_eq!(bench.hear(900, Autonomy, 0.1), Outranked);
    }
}
