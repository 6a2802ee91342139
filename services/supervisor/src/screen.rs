//! What a person sees: one line per transition, what nodes write, and on a terminal a live line.

use std::io::{IsTerminal, Stderr, Stdout};
use std::time::Duration;

use interfaces::Stamp;
use node::log::Format;

use crate::machine::Told;
use crate::member::Member;
use crate::outlet::Outlet;

/// Often enough to look alive, seldom enough to be read.
const LIVE_PERIOD: Duration = Duration::from_millis(100);

/// Standard output, and standard error for what nodes write.
#[derive(Debug)]
pub(crate) struct Screen {
    output: Outlet<Stdout>,
    errors: Outlet<Stderr>,
    /// What nodes write is for machines, one object a line.
    is_plain: bool,
    started: Stamp,
    is_terminal: bool,
    live_due: Stamp,
    steps: (Stamp, f64),
    rate: f64,
}

impl Screen {
    pub(crate) fn new(now: Stamp, format: Format) -> Self {
        Self {
            output: Outlet::new(std::io::stdout()),
            errors: Outlet::new(std::io::stderr()),
            is_plain: format == Format::Json,
            started: now,
            is_terminal: std::io::stdout().is_terminal(),
            live_due: now,
            steps: (now, 0.0),
            rate: 0.0,
        }
    }

    /// One line for what has happened, `text`, where a person wants to know.
    pub(crate) fn tell(&mut self, now: Stamp, told: &Told, name: Option<&str>, text: &str) {
        if !is_worth_a_line(told) {
            return;
        }
        self.tell_line(now, name, text);
    }

    /// One line about the node called `name`, or about the robot.
    pub(crate) fn tell_line(&mut self, now: Stamp, name: Option<&str>, text: &str) {
        let elapsed = now.since(self.started).as_secs_f64();
        let name = name.unwrap_or("robot");
        self.clear();
        self.print(&format!("{elapsed:9.3} s  {name:<12} {text}\n"));
    }

    /// A line that a node has written.
    pub(crate) fn log(&mut self, name: &str, text: &str) {
        self.clear();
        let line = if self.is_plain { format!("{text}\n") } else { format!("{name}: {text}\n") };
        self.errors.print(&line);
    }

    /// The live line: where the robot is, how fast time goes, how often things happen; or why it stands
    /// still, as `hold` says.
    pub(crate) fn live(
        &mut self,
        now: Stamp,
        wall: Duration,
        members: &[Member],
        hold: Option<String>,
    ) {
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
        let rate = self.rate;
        let way = hold.unwrap_or_else(|| format!("{pose}{clearance}  {rate:6.0} Hz"));
        let factor = simulated / wall.as_secs_f64().max(1e-3);
        self.print(&format!("\r\x1b[K{simulated:7.2} s simulated  {factor:6.0} x  {way}"));
    }

    /// Makes room where the live line was.
    pub(crate) fn clear(&mut self) {
        if self.is_terminal {
            self.print("\r\x1b[K");
        }
    }

    pub(crate) fn print(&mut self, text: &str) {
        self.output.print(text);
    }

    /// What could not be written yet.
    pub(crate) fn flush(&mut self) {
        self.output.flush();
        self.errors.flush();
    }

    /// The last chance for it.
    pub(crate) fn finish(&mut self) {
        self.output.finish();
        self.errors.finish();
    }
}

/// The states on the way only where something went wrong; and no start, which its states tell.
fn is_worth_a_line(told: &Told) -> bool {
    match told {
        Told::Changed { goal, reason, .. } => goal.is_primary() || !reason.is_empty(),
        Told::Spawned { .. } | Told::GoingDown { .. } => false,
        Told::Failed { .. }
        | Told::Restarting { .. }
        | Told::TakingDown { .. }
        | Told::Flowing { .. }
        | Told::Stalled { .. }
        | Told::Signalled { .. }
        | Told::Ended { .. }
        | Told::Ready { .. }
        | Told::Refused { .. } => true,
    }
}
