//! The one executable.

#![forbid(unsafe_code)]

mod alone;
mod check;
mod emulate;
mod help;
mod map;
mod page;
mod show;
mod typed;
mod verb;

use std::process::ExitCode;

use clap::Parser;
use node::say;
use verb::Verb;

/// What somebody types first.
const EXAMPLES: &str = "Examples:
  teseo up config/lab_robot.toml --detach
  teseo status
  teseo topic list
  teseo down";

/// A zero-copy shared-memory robotics runtime for one machine.
///
/// Without a verb: `up config/simulation.toml --until round-trip`; on a terminal in real time, with
/// the live screen.
#[derive(Parser)]
#[command(name = "teseo", version, after_help = EXAMPLES, max_term_width = say::WIDTH)]
struct Command {
    #[command(subcommand)]
    verb: Option<Verb>,
}

fn main() -> ExitCode {
    let verb = typed::command().verb.or_else(|| Command::parse_from(main_job()).verb);
    verb.unwrap_or_else(|| unreachable!("the main job is a verb")).run()
}

/// What somebody wants who says nothing: to see it.
fn main_job() -> Vec<&'static str> {
    let mut words = vec!["teseo", "up", "config/simulation.toml", "--until", "round-trip"];
    if view::check_terminal().is_ok() {
        words.extend(["--clock", "realtime", "--view"]);
    }
    words
}
