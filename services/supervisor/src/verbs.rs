//! What is asked of a robot that runs: the other end of the control socket.

mod chaos;
mod down;
mod follow;
mod motion;
mod status;
mod steer;
mod table;
mod why;

use std::process::ExitCode;
use std::time::Duration;

use clap::{Args, Subcommand};
use node::Namespace;
use node::control::{self, Failure, LINES, Request};
use node::say;

use crate::last_words;
use chaos::ChaosOptions;
use follow::Feed;
pub use steer::Goal;

/// [s] A node that has not come up by then has a reason that `teseo why` tells.
const STEER_WAIT_S: u64 = 60;

/// A verb about a running robot.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Take a robot down, in order; return when nothing of it is left
    #[command(after_help = "Example:\n  teseo down --wait 10")]
    Down {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        robot: Which,
        /// Give up after this long; the robot goes down all the same
        #[arg(long, value_name = "SECONDS", default_value_t = 30)]
        wait: u64,
    },
    /// Show the robot's nodes; exits with 0 where it is ready, 1 where not, 3 where none runs
    #[command(after_help = "Example:\n  teseo status --watch")]
    Status {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        robot: Which,
        /// Print everything that is known, as JSON
        #[arg(long)]
        json: bool,
        /// Show it again every second, until Ctrl-C
        #[arg(short, long)]
        watch: bool,
    },
    /// Show what nodes have written, also those that have died
    #[command(after_help = "Example:\n  teseo logs controller --follow")]
    Logs {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        robot: Which,
        /// The node [default: all]
        #[arg(value_parser = control::node_name)]
        node: Option<String>,
        /// Go on with what they will write, until Ctrl-C
        #[arg(short, long)]
        follow: bool,
        /// How many lines
        #[arg(short = 'n', long, value_name = "NUMBER", default_value_t = LINES)]
        lines: usize,
        /// Print one JSON object a line
        #[arg(long)]
        json: bool,
    },
    /// Take a node and whoever requires it down and up again
    #[command(after_help = "Example:\n  teseo restart odometry")]
    Restart {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        node: OneNode,
    },
    /// Take a node and whoever requires it down, until it is started again
    #[command(after_help = "Example:\n  teseo stop controller")]
    Stop {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        node: OneNode,
    },
    /// Bring a node and whoever it requires up again, and say who stays down
    #[command(after_help = "Example:\n  teseo start controller")]
    Start {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        node: OneNode,
    },
    /// Show what has happened
    #[command(after_help = "Example:\n  teseo events --follow")]
    Events {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        robot: Which,
        /// The node [default: all, and the robot]
        #[arg(value_parser = control::node_name)]
        node: Option<String>,
        /// Go on with what will happen, until Ctrl-C
        #[arg(short, long)]
        follow: bool,
        /// Print one JSON object a line
        #[arg(long)]
        json: bool,
    },
    /// Stop the robot at once, or every robot, and hold it until the stop is cleared
    ///
    /// It is held across restarts. Without --robot, every robot is stopped; no supervisor is needed.
    #[command(
        after_help = "Examples:\n  teseo estop --reason \"a hand in the maze\"\n  teseo estop --clear"
    )]
    Estop {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        robot: Which,
        /// Release it: the robot moves again once commands come that begin with zero
        #[arg(long)]
        clear: bool,
        /// Why, for whoever finds the robot stopped
        #[arg(long, value_name = "TEXT", default_value = "teseo estop")]
        reason: String,
    },
    /// Let a robot move again that stopped too often, or that was not armed since its start
    #[command(after_help = "Example:\n  teseo arm")]
    Arm {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        robot: Which,
    },
    /// Bring a robot up, let things go wrong with it from a seed, and say what it did
    Chaos(ChaosOptions),
    /// Say why a node is in the state that it is in
    #[command(after_help = "Example:\n  teseo why controller")]
    Why {
        #[command(flatten)]
        #[allow(missing_docs, reason = "the flattened options document themselves")]
        robot: Which,
        /// The node
        #[arg(value_parser = control::node_name)]
        node: String,
    },
}

/// Which robot a verb is about.
#[derive(Debug, Args)]
pub struct Which {
    /// The robot [default: the only one that runs]
    #[arg(long = "robot", value_name = "NAME")]
    name: Option<String>,
}

/// Which node a verb is about, and for how long.
#[derive(Debug, Args)]
pub struct OneNode {
    #[command(flatten)]
    robot: Which,
    /// The node
    #[arg(value_parser = control::node_name)]
    node: String,
    /// Give up after this long; the node goes on all the same
    #[arg(long, value_name = "SECONDS", default_value_t = STEER_WAIT_S)]
    wait: u64,
}

impl Verb {
    pub(crate) fn run(&self) -> ExitCode {
        match self.carry_out() {
            Ok(code) => ExitCode::from(code),
            Err(failure) => {
                say::complain(&failure);
                ExitCode::from(failure.code())
            }
        }
    }

    fn carry_out(&self) -> Result<u8, Failure> {
        match self {
            Self::Down { robot, wait } => down::down(robot.name(), Duration::from_secs(*wait)),
            Self::Status { robot, json, watch } => {
                let show = if *watch { status::watch } else { status::once };
                robot.find_or_tell(|namespace| show(namespace, *json))
            }
            Self::Logs { robot, node, follow, lines, json } => {
                let (node, follow, lines) = (node.clone(), *follow, *lines);
                let request = Request::Logs { node, follow, lines };
                robot.find_or_point(|robot| Feed::Logs.show(robot, &request, follow, *json))
            }
            Self::Events { robot, node, follow, json } => {
                let (node, follow) = (node.clone(), *follow);
                let request = Request::Events { node, follow };
                robot.find_or_point(|robot| Feed::Events.show(robot, &request, follow, *json))
            }
            Self::Estop { robot, clear: true, .. } => motion::release(robot.name()),
            Self::Estop { robot, clear: false, reason } => motion::stop(robot.name(), reason),
            Self::Arm { robot } => motion::arm(robot.name()),
            Self::Chaos(options) => chaos::chaos(options),
            Self::Restart { node } => node.steer(Goal::Restarted),
            Self::Stop { node } => node.steer(Goal::Stopped),
            Self::Start { node } => node.steer(Goal::Started),
            Self::Why { robot, node } => robot.find_or_tell(|namespace| why::why(namespace, node)),
        }
    }
}

impl Which {
    fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// Does `verb` for the robot; of one that does not run, tells how it ended.
    fn find_or_tell(
        &self,
        verb: impl FnOnce(&Namespace) -> Result<u8, Failure>,
    ) -> Result<u8, Failure> {
        let outcome = control::find(self.name()).and_then(|namespace| verb(&namespace));
        if matches!(outcome, Err(Failure::NotRunning(_))) {
            say::mention(&last_words::read(&Namespace::runtime_directory(), self.name()));
        }
        outcome
    }

    /// Does `verb` for the robot; of one that does not run, says who tells how it ended.
    fn find_or_point(
        &self,
        verb: impl FnOnce(&Namespace) -> Result<u8, Failure>,
    ) -> Result<u8, Failure> {
        let outcome = control::find(self.name()).and_then(|namespace| verb(&namespace));
        outcome.map_err(|failure| match failure {
            Failure::NotRunning(why) if self.has_last_words() => {
                Failure::NotRunning(format!("{why}; `teseo status` tells how it ended"))
            }
            other => other,
        })
    }

    fn has_last_words(&self) -> bool {
        !last_words::read(&Namespace::runtime_directory(), self.name()).is_empty()
    }
}

impl OneNode {
    fn steer(&self, goal: Goal) -> Result<u8, Failure> {
        let wait = Duration::from_secs(self.wait);
        self.robot.find_or_point(|robot| steer::steer(robot, &self.node, goal, wait))
    }
}

/// The running robot that a verb of another service is about: `name`, or the only one that runs.
/// Where there is none, says so; the code is what to exit with.
pub fn find(name: Option<&str>) -> Result<Namespace, ExitCode> {
    let found = control::find(name).and_then(|namespace| {
        let is_running = control::is_running(&namespace);
        if is_running { Ok(namespace) } else { Err(control::not_running(&namespace)) }
    });
    found.map_err(|failure| {
        say::complain(&failure);
        ExitCode::from(failure.code())
    })
}

/// Asks the supervisor for a node to be where `goal` says, tells what happens meanwhile, and returns
/// when it is there: for the verbs of another service.
pub fn steer(namespace: &Namespace, node: &str, goal: Goal) -> Result<u8, Failure> {
    steer::steer(namespace, node, goal, Duration::from_secs(STEER_WAIT_S))
}

/// Whether the robot runs under this guardian, and is ready.
pub(crate) fn is_ready(namespace: &Namespace, guardian: u32) -> bool {
    control::look(namespace)
        .is_some_and(|status| status["state"] == "ready" && status["guardian"] == guardian)
}

#[cfg(test)]
mod tests;
