//! What a person asks of a robot that runs: its topics, nodes, parameters, and how they hang together.
//!
//! The words are those of ROS 2's command line. What the supervisor knows is asked of it; samples are
//! read beside the robot, by one who looks on ([`node::observe`]). There is no daemon in between.

#![forbid(unsafe_code)]

mod graph;
mod lifecycle;
mod nodes;
mod parameters;
mod robot;
mod table;
mod topic;

use std::process::ExitCode;

use clap::{Arg, ArgAction, Args, Subcommand};
use node::Namespace;
use node::control::{self, Failure};
use node::say;

pub use parameters::Know;
use robot::Robot;

/// Asks the supervisor for a node to be up (`true`) or down, and returns when it is.
pub type Steer = fn(&Namespace, &str, bool) -> Result<u8, Failure>;

/// A verb about what a robot is made of.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Look at topics, and publish on them
    #[command(after_help = "Example:\n  teseo topic list")]
    Topic(topic::Topic),
    /// Look at nodes
    #[command(after_help = "Example:\n  teseo node list")]
    Node(nodes::Nodes),
    /// Look at where nodes stand, and have the supervisor move them
    #[command(after_help = "Example:\n  teseo lifecycle get controller")]
    Lifecycle(lifecycle::Lifecycle),
    /// Look at what nodes were told, and change it while they run, where that is safe
    #[command(after_help = "Example:\n  teseo param list controller")]
    Param(parameters::Parameters),
    /// Show the running robot's processes, and the topics between them
    Graph(graph::Options),
}

/// Which robot a verb is about.
#[derive(Debug, Args)]
pub(crate) struct Which {
    /// The robot [default: the only one that runs]
    #[arg(long = "robot", value_name = "NAME")]
    name: Option<String>,
}

impl Which {
    /// The robot, as its supervisor knows it.
    fn find(&self) -> Result<Robot, Failure> {
        Robot::ask(control::find(self.name.as_deref())?)
    }
}

impl Verb {
    /// Does it, and says with the exit code how it went, as all verbs about running robots do.
    pub fn run(&self, steer: Steer, know: Know) -> ExitCode {
        let outcome = match self {
            Self::Topic(verb) => verb.carry_out(),
            Self::Node(verb) => verb.carry_out(),
            Self::Lifecycle(verb) => verb.carry_out(steer),
            Self::Param(verb) => verb.carry_out(know),
            Self::Graph(options) => graph::show(options),
        };
        match outcome {
            Ok(code) => ExitCode::from(code),
            Err(failure) => {
                say::complain(&failure);
                ExitCode::from(failure.code())
            }
        }
    }
}

/// An option of ROS 2 that changes nothing here: what it asks for is always so.
fn understood(short: char, long: &'static str) -> Arg {
    Arg::new(long).short(short).long(long).action(ArgAction::SetTrue).hide(true)
}

/// What the transport refuses, as the end of a verb.
fn refused(error: &node::Error) -> Failure {
    Failure::Refused(error.to_string())
}
