//! `teseo up --view`: the supervisor's robot on the screen of `teseo view`. Neither knows the other.

use std::process::ExitCode;

use supervisor::Shown;
use view::Stay;

use crate::map;

/// Brings the robot up, shows it, and takes it down with the screen; the exit code is the run's.
pub(crate) fn up(options: &supervisor::Options) -> ExitCode {
    match run(options) {
        Ok(code) => ExitCode::from(code),
        Err(error) => node::exit_code("teseo", Err(error)),
    }
}

fn run(options: &supervisor::Options) -> node::Result<u8> {
    view::check_terminal()?;
    node::signal::listen();
    let mut shown = Shown::start(options)?;
    let seen = match shown.namespace() {
        Some(robot) => view::run(robot, &view::Options::default(), Stay::UntilTheEnd, map::map),
        None => Ok(()),
    };
    let code = shown.end()?;
    seen.map(|()| code)
}
