//! What a person sees: one line per transition, and on a terminal a live line under them.

use std::io::{IsTerminal, Write};
use std::time::Duration;

use interfaces::{Stamp, State};

use crate::member::{Change, Member};

/// Often enough to look alive, seldom enough to be read.
const LIVE_PERIOD: Duration = Duration::from_millis(100);

/// Standard output.
#[derive(Debug)]
pub(crate) struct Screen {
    started: Stamp,
    is_terminal: bool,
    live_due: Stamp,
    steps: (Stamp, f64),
    rate: f64,
}

impl Screen {
    pub(crate) fn new(now: Stamp) -> Self {
        let is_terminal = std::io::stdout().is_terminal();
        Self { started: now, is_terminal, live_due: now, steps: (now, 0.0), rate: 0.0 }
    }

    /// One line for a change of state; the states on the way only where something went wrong.
    pub(crate) fn change(&mut self, now: Stamp, name: &str, change: &Change) {
        let is_rest = matches!(
            change.goal,
            State::Unconfigured | State::Inactive | State::Active | State::Finalized
        );
        if !is_rest && change.reason.is_empty() {
            return;
        }
        let elapsed = now.since(self.started).as_secs_f64();
        let reason = if change.reason.is_empty() { "" } else { ": " };
        self.clear();
        print(&format!(
            "{elapsed:9.3} s  {name:<12} {} -> {}{reason}{}\n",
            change.start, change.goal, change.reason
        ));
    }

    /// The live line: where the robot is, how fast time goes, how often things happen.
    pub(crate) fn live(&mut self, now: Stamp, wall: Duration, members: &[Member]) {
        if !self.is_terminal || now < self.live_due {
            return;
        }
        self.live_due = now.after(LIVE_PERIOD);
        let value = |key: &str| members.iter().rev().find_map(|member| member.status.value(key));
        let steps = value("steps").unwrap_or_default();
        let elapsed = now.since(self.steps.0).as_secs_f64();
        if 0.0 < elapsed {
            self.rate = (steps - self.steps.1) / elapsed;
        }
        self.steps = (now, steps);
        let simulated = value("simulated_s").unwrap_or_default();
        let pose = match (value("x_m"), value("y_m"), value("yaw_rad")) {
            (Some(x), Some(y), Some(yaw)) => {
                format!("x {x:6.3} m  y {y:6.3} m  yaw {:4.0} deg", yaw.to_degrees())
            }
            _ => "no odometry yet".to_owned(),
        };
        let clearance = value("clearance_m")
            .map_or(String::new(), |clearance| format!("  clear {clearance:5.3} m"));
        let factor = simulated / wall.as_secs_f64().max(1e-3);
        print(&format!(
            "\r\x1b[K{simulated:7.2} s simulated  {factor:6.0} x  {pose}{clearance}  {:6.0} Hz",
            self.rate
        ));
    }

    /// Makes room where the live line was.
    pub(crate) fn clear(&mut self) {
        if self.is_terminal {
            print("\r\x1b[K");
        }
    }
}

/// The report at the end.
pub(crate) fn report(text: &str) {
    print(text);
}

/// Whoever closed our standard output does not want to know; the robot goes on.
fn print(text: &str) {
    let mut output = std::io::stdout().lock();
    drop(output.write_all(text.as_bytes()).and_then(|()| output.flush()));
}
