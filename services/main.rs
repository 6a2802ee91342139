//! The one executable: which verb runs which service.

#![forbid(unsafe_code)]

mod alone;
mod check;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use node::Arguments;

/// A zero-copy shared-memory robotics runtime for one machine.
///
/// Without a verb: `up config/simulation.toml --until round-trip`.
#[derive(Parser)]
#[command(name = "teseo", version)]
struct Command {
    #[command(subcommand)]
    verb: Option<Verb>,
}

#[derive(Subcommand)]
enum Verb {
    #[command(flatten)]
    Robot(supervisor::Verb),
    /// Measure the runtime on this machine
    Bench(bench::Options),
    /// The world, the drive and the LiDAR
    Simulator(Arguments),
    /// Wheels or poses in, pose and velocity out
    Odometry(Arguments),
    /// Scan and odometry in, tickets for those that belong together out
    Pairing(Arguments),
    /// The wall follower
    Controller(Arguments),
    /// Commands of a person and of the controller in, those of the one that drives out
    Multiplexer(Arguments),
    /// Drive a robot from the keyboard, over its autonomy
    Teleop(teleop::Options),
}

fn main() -> ExitCode {
    let main_job = ["teseo", "up", "config/simulation.toml", "--until", "round-trip"];
    let verb = Command::parse().verb.or_else(|| Command::parse_from(main_job).verb);
    match verb.unwrap_or_else(|| unreachable!("the main job is a verb")) {
        Verb::Robot(verb) => verb.run(check::check),
        Verb::Bench(options) => node::exit_code("teseo bench", bench::run(&options, alone::drive)),
        Verb::Simulator(arguments) => node::start(&arguments, "simulator", simulator::run),
        Verb::Odometry(arguments) => node::start(&arguments, "odometry", odometry::run),
        Verb::Pairing(arguments) => node::start(&arguments, "pairing", supervisor::pairing),
        Verb::Controller(arguments) => node::start(&arguments, "controller", controller::run),
        Verb::Multiplexer(arguments) => node::start(&arguments, "multiplexer", multiplexer::run),
        Verb::Teleop(options) => match supervisor::find(options.robot()) {
            Ok(robot) => node::exit_code("teseo teleop", teleop::run(&robot, &options)),
            Err(code) => code,
        },
    }
}
