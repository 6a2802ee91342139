//! The verbs of the one executable, and which service does each.

use std::process::ExitCode;

use clap::Subcommand;
use node::control::Failure;
use node::{Arguments, Namespace};
use supervisor::Goal;

use crate::{alone, check, emulate, help, map, page, show};

/// What is to be done.
#[derive(Subcommand)]
pub(crate) enum Verb {
    #[command(flatten)]
    Robot(supervisor::Verb),
    #[command(flatten)]
    Console(console::Verb),
    /// Measure the runtime on this machine
    Bench(bench::Options),
    /// Make the page of a run
    #[command(after_help = "Example:\n  teseo report trip")]
    Report(report::Options),
    /// Play a robot, for a bridge to talk to
    #[command(after_help = "Example:\n  teseo emulate turtlebot3")]
    Emulate {
        #[command(subcommand)]
        robot: emulate::Robot,
    },
    /// The world, the drive and the LiDAR
    #[command(
        after_help = "Example:\n  teseo simulator --config config/lab_robot.toml --autostart"
    )]
    Simulator(Arguments),
    /// Wheels or poses in, pose and velocity out
    #[command(after_help = "Example:\n  teseo odometry --config config/lab_robot.toml --autostart")]
    Odometry(Arguments),
    /// Scan and odometry in, tickets for those that belong together out
    #[command(after_help = "Example:\n  teseo pairing --config config/lab_robot.toml --autostart")]
    Pairing(Arguments),
    /// The wall follower
    #[command(
        after_help = "Example:\n  teseo controller --config config/lab_robot.toml --autostart"
    )]
    Controller(Arguments),
    /// Commands of a person and of the controller in, those of the one that drives out
    #[command(after_help = "Example:\n  teseo multiplexer --config config/teleop.toml --autostart")]
    Multiplexer(Arguments),
    /// The bridge to a real TurtleBot3, in the simulator's place
    #[command(
        after_help = "Example:\n  teseo turtlebot3 --config config/turtlebot3.toml --autostart"
    )]
    Turtlebot3(Arguments),
    /// Drive a robot from the keyboard, over its autonomy
    #[command(after_help = "Example:\n  teseo teleop --linear-max 0.1")]
    Teleop(teleop::Options),
    /// Watch a running robot: map, nodes, topics, events
    #[command(after_help = "Example:\n  teseo view")]
    View(view::Options),
    /// Print what makes a shell complete these words
    Completions(help::Completions),
    /// Print a page of the manual
    Man(help::Man),
}

impl Verb {
    /// Does it, and says with the exit code how it went.
    pub(crate) fn run(self) -> ExitCode {
        match self {
            Self::Robot(supervisor::Verb::Up(options)) if options.view => show::up(&options),
            Self::Robot(verb) => verb.run(check::CHECK, page::write),
            Self::Report(options) => node::exit_code("teseo report", page::make(&options)),
            Self::Console(verb) => verb.run(steer, check::parameters),
            Self::Completions(options) => help::complete(&options),
            Self::Man(options) => help::manual(&options),
            Self::Bench(options) => {
                node::exit_code("teseo bench", bench::run(&options, alone::drive))
            }
            Self::Emulate { robot } => node::exit_code("teseo emulate", robot.run()),
            Self::Simulator(arguments) => node::start(&arguments, "simulator", simulator::run),
            Self::Odometry(arguments) => node::start(&arguments, "odometry", odometry::run),
            Self::Pairing(arguments) => node::start(&arguments, "pairing", supervisor::pairing),
            Self::Controller(arguments) => node::start(&arguments, "controller", controller::run),
            Self::Multiplexer(arguments) => {
                node::start(&arguments, "multiplexer", multiplexer::run)
            }
            Self::Turtlebot3(arguments) => node::start(&arguments, "turtlebot3", turtlebot3::run),
            Self::Teleop(options) => match supervisor::find(options.robot()) {
                Ok(robot) => node::exit_code("teseo teleop", teleop::run(&robot, &options)),
                Err(code) => code,
            },
            Self::View(options) => match supervisor::find(options.robot()) {
                Ok(robot) => {
                    let seen = view::run(&robot, &options, view::Stay::UntilLeft, map::map);
                    node::exit_code("teseo view", seen)
                }
                Err(code) => code,
            },
        }
    }
}

/// Has the supervisor bring a node up or down.
fn steer(robot: &Namespace, node: &str, is_wanted: bool) -> Result<u8, Failure> {
    let goal = if is_wanted { Goal::Started } else { Goal::Stopped };
    supervisor::steer(robot, node, goal)
}
