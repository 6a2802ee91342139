//! `teseo status`: the robot as it stands.

use std::io::IsTerminal;
use std::time::Duration;

use node::control::{self, Connection, Failure, Request};
use node::{Namespace, clock, signal};
use serde_json::Value;

use super::table;
use node::say::{say, wants_colours};

/// Between two looks.
const PERIOD: Duration = Duration::from_secs(1);

/// Each line is cut to this, so that a log file of tables can be read.
const WIDTH: usize = 100;

/// [character] A terminal that is narrower wraps the lines.
const WIDTH_MIN: usize = 80;

pub(super) fn once(namespace: &Namespace, json: bool) -> Result<u8, Failure> {
    let status = ask(namespace)?;
    if json {
        say(&serde_json::to_string_pretty(&status).unwrap_or_default())?;
    } else {
        say(&table::table(&status, width(), wants_colours()))?;
    }
    Ok(code(&status))
}

/// Once a second, until Ctrl-C or until the robot goes away.
pub(super) fn watch(namespace: &Namespace, json: bool) -> Result<u8, Failure> {
    signal::listen();
    let is_redrawn = std::io::stdout().is_terminal() && !json;
    if is_redrawn {
        say("\x1b[2J\n")?;
    }
    loop {
        let due = clock::now().after(PERIOD);
        let status = ask(namespace)?;
        let text = if json {
            format!("{status}\n")
        } else {
            table::table(&status, width(), wants_colours())
        };
        say(&if is_redrawn { redrawn(&text) } else { text })?;
        while clock::now() < due {
            control::check_stop()?;
            control::wait(None, Some(due.since(clock::now())));
        }
    }
}

fn ask(namespace: &Namespace) -> Result<Value, Failure> {
    Connection::open(namespace, &Request::Status)?.answer()
}

fn code(status: &Value) -> u8 {
    u8::from(status["state"] != "ready")
}

fn width() -> usize {
    let terminal = rustix::termios::tcgetwinsize(std::io::stdout()).ok();
    let columns = terminal.map(|size| usize::from(size.ws_col)).filter(|&columns| 0 < columns);
    columns.unwrap_or(WIDTH).clamp(WIDTH_MIN, WIDTH)
}

/// Over what is on the screen, line by line, so that it does not flicker.
fn redrawn(text: &str) -> String {
    format!("\x1b[H{}\x1b[J", text.replace('\n', "\x1b[K\n"))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn only_a_robot_that_is_ready_ends_with_0() {
        assert_eq!(code(&json!({ "state": "ready" })), 0);
        assert_eq!(code(&json!({ "state": "degraded" })), 1);
        assert_eq!(code(&json!({})), 1);
    }
}
