//! The one executable: which verb runs which service.

#![forbid(unsafe_code)]

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
    /// Bring a robot up, run it, and take it down again
    Up(supervisor::Options),
    /// Replay recorded streams through the pairing: why do my topics not pair?
    Pair(supervisor::PairOptions),
    /// Measure the runtime on this machine
    Bench(bench::Options),
    /// The world, the drive and the LiDAR
    Simulator(Arguments),
    /// Wheels or poses in, pose and velocity out
    Odometry(Arguments),
    /// The wall follower
    Controller(Arguments),
}

fn main() -> ExitCode {
    let verb = Command::parse().verb.unwrap_or_else(|| {
        let main_job = ["teseo", "up", "config/simulation.toml", "--until", "round-trip"];
        Command::parse_from(main_job).verb.unwrap_or_else(|| unreachable!("it is a verb"))
    });
    match verb {
        Verb::Up(options) => supervisor::main(&options),
        Verb::Pair(options) => node::exit_code("teseo pair", supervisor::pair(&options)),
        Verb::Bench(options) => node::exit_code("teseo bench", bench::run(&options)),
        Verb::Simulator(arguments) => run(&arguments, "simulator", simulator::run),
        Verb::Odometry(arguments) => run(&arguments, "odometry", odometry::run),
        Verb::Controller(arguments) => run(&arguments, "controller", controller::run),
    }
}

fn run(
    arguments: &Arguments,
    name: &str,
    body: fn(&mut node::Node<'_>) -> node::Result,
) -> ExitCode {
    node::exit_code(name, node::run(arguments, name, body))
}
