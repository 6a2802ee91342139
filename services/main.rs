//! The one executable: which verb runs which service.

#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use node::{Arguments, Settings};

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
}

fn main() -> ExitCode {
    let main_job = ["teseo", "up", "config/simulation.toml", "--until", "round-trip"];
    let verb = Command::parse().verb.or_else(|| Command::parse_from(main_job).verb);
    match verb.unwrap_or_else(|| unreachable!("the main job is a verb")) {
        Verb::Robot(verb) => verb.run(check),
        Verb::Bench(options) => node::exit_code("teseo bench", bench::run(&options)),
        Verb::Simulator(arguments) => node::start(&arguments, "simulator", simulator::run),
        Verb::Odometry(arguments) => node::start(&arguments, "odometry", odometry::run),
        Verb::Pairing(arguments) => node::start(&arguments, "pairing", supervisor::pairing),
        Verb::Controller(arguments) => node::start(&arguments, "controller", controller::run),
    }
}

/// Checks the parameters of one of our services; `None` where there is no such service.
fn check(settings: &Settings) -> Option<node::Result> {
    match settings.name() {
        "simulator" => Some(simulator::check(settings)),
        "odometry" => Some(odometry::check(settings)),
        "controller" => Some(controller::check(settings)),
        _ => None,
    }
}
