//! What became of a robot after each blow, by what its supervisor tells.

use std::fmt::Write;
use std::time::Duration;

use serde_json::Value;

use super::schedule::{Blow, What};

/// The dead-man has tripped by then, and a watchdog has bitten, where they ever will.
const NOTICED_AFTER: Duration = Duration::from_millis(600);

/// A blow and what followed it, until the next.
#[derive(Debug)]
pub(super) struct Struck {
    blow: Blow,
    /// [s] On the clock of what is told.
    at: f64,
    /// [-] Of whom it met; nobody between two lives.
    process: Option<u32>,
    /// Whether a node went down.
    has_failed: bool,
    /// [s] After the blow: the wheels were told to stop.
    brakes: Option<f64>,
    /// [s] After the blow: they stood.
    stands: Option<f64>,
    /// [s] After the blow: all nodes were active again, and data flowed.
    ready: Option<f64>,
    /// [s] After the blow: commands moved the robot again.
    moves: Option<f64>,
}

impl Struck {
    pub(super) const fn new(blow: Blow, at: f64, process: Option<u32>) -> Self {
        Self {
            blow,
            at,
            process,
            has_failed: false,
            brakes: None,
            stands: None,
            ready: None,
            moves: None,
        }
    }

    /// Takes in one event; what was before the blow has nothing to do with it.
    pub(super) fn hear(&mut self, event: &Value) {
        let motion = &event["motion"];
        let told = if motion.is_null() { &event["monotonic_s"] } else { &motion["since_s"] };
        let after = told.as_f64().map(|told| told - self.at).filter(|after| 0.0 <= *after);
        let Some(after) = after else { return };
        match (event["kind"].as_str(), motion["permission"].as_str()) {
            (Some("failed"), _) => self.has_failed = true,
            (Some("ready"), _) if self.has_failed => set(&mut self.ready, after),
            (Some("motion"), Some("braking")) => set(&mut self.brakes, after),
            (Some("motion"), Some("held")) if self.brakes.is_some() => set(&mut self.stands, after),
            (Some("motion"), Some("armed")) => set(&mut self.moves, after),
            _ => {}
        }
    }

    /// One line for a person; `begun` is when the robot was ready first, and `end` when this story
    /// was over, since another began.
    pub(super) fn line(&self, begun: f64, end: f64) -> String {
        let Blow { node, what, .. } = &self.blow;
        let mut line = format!("{:9.3} s  {what} of {node}", self.at - begun);
        let Some(process) = self.process else { return line + ": it was not there\n" };
        let steps = [
            ("brakes", self.brakes),
            ("stands", self.stands),
            ("READY again", self.ready),
            ("may move", self.moves),
        ];
        let steps = steps.iter().filter_map(|(what, after)| Some((what, (*after)?)));
        let told = |(what, after): (_, f64)| format!("{what} after {:.0} ms", after * 1e3);
        let mut steps: Vec<_> = steps.map(told).collect();
        if self.has_failed && self.ready.is_none() {
            steps.push("a node went down".to_owned());
        }
        if self.is_cut_short(end) {
            steps.push(told((&"cut short", end - self.at)));
        }
        let outcome = if steps.is_empty() { "nobody noticed".to_owned() } else { steps.join(", ") };
        let _ = writeln!(line, " ({process}): {outcome}");
        line
    }

    /// Whether more of it was to come after `end`.
    fn is_cut_short(&self, end: f64) -> bool {
        let is_noticed = self.has_failed || self.brakes.is_some();
        let span = match self.blow.what {
            What::Kill => Duration::ZERO,
            What::Stop(duration) => duration,
        };
        let noticed_by = self.at + (span + NOTICED_AFTER).as_secs_f64();
        (self.has_failed && self.ready.is_none())
            || (self.brakes.is_some() && self.moves.is_none())
            || (!is_noticed && end < noticed_by)
    }
}

/// The first time counts.
fn set(moment: &mut Option<f64>, after: f64) {
    moment.get_or_insert(after);
}

/// All blows by kind, as a table.
pub(super) fn table(all: &[Struck]) -> String {
    let mut kinds: Vec<_> = all.iter().map(kind).collect();
    kinds.sort();
    kinds.dedup();
    let mut table = "| fault | n | trips | brakes p50 ms | max | READY p50 ms | max |\n\
                     |---|--:|--:|--:|--:|--:|--:|\n"
        .to_owned();
    for kind_of in kinds {
        let some: Vec<_> = all.iter().filter(|struck| kind(struck) == kind_of).collect();
        let brakes = times(&some, |struck| struck.brakes);
        let ready = times(&some, |struck| struck.ready);
        let (count, trips) = (some.len(), brakes.len());
        let [brakes, ready] = [brakes, ready].map(|times| median_and_max(&times));
        let _ = writeln!(table, "| {kind_of} | {count} | {trips} | {brakes} | {ready} |");
    }
    table
}

fn kind(struck: &Struck) -> String {
    let what = match struck.blow.what {
        What::Kill => "SIGKILL",
        What::Stop(_) => "SIGSTOP",
    };
    format!("{what} {}", struck.blow.node)
}

/// [s] In order.
fn times(some: &[&Struck], moment: fn(&Struck) -> Option<f64>) -> Vec<f64> {
    let mut times: Vec<_> = some.iter().filter_map(|struck| moment(struck)).collect();
    times.sort_by(f64::total_cmp);
    times
}

fn median_and_max(times: &[f64]) -> String {
    let Some(max) = times.last() else { return "- | -".to_owned() };
    let median = times[(times.len() - 1) / 2];
    format!("{:.0} | {:.0}", median * 1e3, max * 1e3)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn struck(what: What) -> Struck {
        let blow = Blow { at: Duration::from_secs(3), node: "odometry".to_owned(), what };
        Struck::new(blow, 103.0, Some(4711))
    }

    fn motion(permission: &str, since: f64) -> Value {
        let motion = json!({ "permission": permission, "since_s": since });
        json!({ "kind": "motion", "monotonic_s": since + 0.001, "motion": motion })
    }

    #[test]
    fn what_follows_a_blow_is_told_in_a_line_and_counted_in_a_table() {
        let mut struck = struck(What::Kill);
        for event in [
            motion("braking", 102.9),
            json!({ "kind": "ready", "monotonic_s": 103.005 }),
            json!({ "kind": "failed", "monotonic_s": 103.01 }),
            json!({ "kind": "ready", "monotonic_s": 103.18 }),
            motion("braking", 103.2),
            motion("held", 103.3),
            motion("armed", 103.9),
            motion("braking", 104.5),
        ] {
            struck.hear(&event);
        }

        let steps = "brakes after 200 ms, stands after 300 ms, READY again after 180 ms, \
                     may move after 900 ms";
        let line = format!("    3.000 s  SIGKILL of odometry (4711): {steps}\n");
        assert_eq!(struck.line(100.0, 110.0), line);
        let table = table(&[struck]);
        let row = "| SIGKILL odometry | 1 | 1 | 200 | 200 | 180 | 180 |\n";
        assert!(table.ends_with(row), "{table}");
    }

    #[test]
    fn who_is_not_missed_or_not_there_is_told_too() {
        let mut short = struck(What::Stop(Duration::from_millis(20)));
        short.hear(&json!({ "kind": "flowing", "monotonic_s": 103.5 }));
        let missed = Struck { process: None, ..struck(What::Kill) };

        let unnoticed = "SIGSTOP for 20 ms of odometry (4711): nobody noticed\n";
        assert!(short.line(100.0, 110.0).ends_with(unnoticed), "{short:?}");
        assert!(missed.line(100.0, 110.0).ends_with("SIGKILL of odometry: it was not there\n"));
        let cut = short.line(100.0, 103.2);
        assert!(cut.ends_with("odometry (4711): cut short after 200 ms\n"), "{cut}");
        assert!(table(&[short]).ends_with("| SIGSTOP odometry | 1 | 0 | - | - | - | - |\n"));
    }

    #[test]
    fn a_story_that_the_next_blow_cuts_short_says_what_it_came_to() {
        let mut struck = struck(What::Stop(Duration::from_millis(1_223)));
        struck.hear(&json!({ "kind": "failed", "monotonic_s": 103.5 }));
        let line = struck.line(100.0, 103.6);
        assert!(line.ends_with("(4711): a node went down, cut short after 600 ms\n"), "{line}");

        struck.hear(&motion("braking", 103.2));
        struck.hear(&json!({ "kind": "ready", "monotonic_s": 103.7 }));
        let line = struck.line(100.0, 103.8);
        let steps = "brakes after 200 ms, READY again after 700 ms, cut short after 800 ms\n";
        assert!(line.ends_with(steps), "{line}");
    }
}
