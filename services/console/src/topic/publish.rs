//! `teseo topic pub`: samples of a person's own, where nobody else publishes.

use std::time::Duration;

use clap::Args;
use interfaces::topics::{self, Visitor};
use interfaces::{Described, Field, SetError, Topic};
use node::config::suggestion;
use node::control::Failure;
use node::observe::Row;
use node::say::say;
use node::{Publisher, Session, clock, signal};

use super::{check_presence, open, row};
use crate::robot::Robot;
use crate::{Which, refused};

/// What was sent is lost if its publisher is gone before a reader looks: no node takes longer.
const LINGER: Duration = Duration::from_millis(200);

/// What to publish, and how often.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  teseo topic pub board_request asks_sound=1 sound=1\n  \
                        teseo topic pub /teleop_cmd_vel linear=0.1 -r 20 --for 3\n  \
                        teseo topic info board_request    # its fields and units")]
pub(crate) struct Options {
    #[command(flatten)]
    robot: Which,
    /// The topic
    topic: String,
    /// The fields, in the units of `teseo topic info`; those that are left out are zero
    #[arg(value_name = "FIELD=VALUE")]
    fields: Vec<String>,
    /// Publish so often in a second, until Ctrl-C [default: once]
    #[arg(short, long, value_name = "HZ", value_parser = rate)]
    rate: Option<f64>,
    /// Publish so many times, once a second where no rate is given
    #[arg(short, long, value_name = "NUMBER", value_parser = clap::value_parser!(u64).range(1..))]
    times: Option<u64>,
    /// Publish once, whatever the rate
    #[arg(short = '1', long, conflicts_with = "times")]
    once: bool,
    /// End after so many seconds
    #[arg(long = "for", value_name = "SECONDS", requires = "rate", value_parser = seconds)]
    for_s: Option<f64>,
}

fn rate(text: &str) -> Result<f64, String> {
    in_range(text, 0.01, 1_000.0)
}

fn seconds(text: &str) -> Result<f64, String> {
    in_range(text, 0.0, 1e6)
}

fn in_range(text: &str, min: f64, max: f64) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "is no number".to_owned())?;
    if (min..=max).contains(&value) { Ok(value) } else { Err(format!("give {min} to {max}")) }
}

/// Publishes what `options` say, once or at a rate.
pub(super) fn publish(options: &Options) -> Result<u8, Failure> {
    let robot = options.robot.find()?;
    let row = row(&robot, &options.topic)?;
    signal::listen();
    let session = Session::guest(&robot.namespace, "pub").map_err(|error| refused(&error))?;
    let session = session.with_clock(robot.clock);
    check_place(&session, &robot, &row)?;
    let send = Send { options, session: &session, robot: &robot, row: &row };
    topics::find(&row.name, send).unwrap_or_else(|| unreachable!("the topic has a row"))
}

/// Whether there is a place for one more publisher, and somebody to hear it.
fn check_place(session: &Session, robot: &Robot, row: &Row) -> Result<(), Failure> {
    let topic = &row.name;
    if topic.contains('/') {
        let why =
            format!("`{topic}` is for a node and its supervisor to speak on, and nobody else");
        return Err(Failure::Refused(why));
    }
    // A node that is down comes back with a lower epoch than ours, and nobody would believe it.
    if let Some(node) = robot.publisher(topic) {
        let (name, state) = (&node.name, &node.state);
        return Err(Failure::Refused(format!(
            "`{topic}` has one publisher, and on this robot that is {name} ({state})"
        )));
    }
    let observer = open(session, robot, row)?;
    if let Some(name) = observer.publishers().first() {
        return Err(Failure::Refused(format!(
            "`{topic}` has one publisher, and {name} is that already; stop it first"
        )));
    }
    if observer.readers().iter().all(|reader| reader == "supervisor") {
        return Err(Failure::Refused(format!(
            "nobody on this robot reads `{topic}`; `teseo topic list` shows what is read"
        )));
    }
    Ok(())
}

/// The sample, and where it goes.
struct Send<'a> {
    options: &'a Options,
    session: &'a Session,
    robot: &'a Robot,
    row: &'a Row,
}

impl Visitor for Send<'_> {
    type Output = Result<u8, Failure>;

    fn visit<T: Described>(self, topic: &'static Topic<T>, _owner: &str) -> Self::Output {
        let message: T = filled(&self.options.fields, &self.row.name)?;
        let publisher = self.session.publisher(topic).map_err(|error| refused(&error))?;
        self.send(publisher, message)
    }
}

impl Send<'_> {
    fn send<T: Described>(&self, mut publisher: Publisher<T>, message: T) -> Result<u8, Failure> {
        let begun = clock::now();
        let end = self.options.for_s.map(|seconds| begun.after(Duration::from_secs_f64(seconds)));
        let rate = self.options.rate.unwrap_or(1.0);
        let period = Duration::from_secs_f64(1.0 / rate);
        let times = match self.options {
            Options { once: true, .. } | Options { times: None, rate: None, .. } => Some(1),
            Options { times, .. } => *times,
        };
        let mut due = begun;
        let mut sent = 0_u64;
        let outcome = loop {
            let now = clock::now();
            let mut message = message;
            message.header_mut().stamp = now;
            publisher.send(message).map_err(|error| refused(&error))?;
            sent += 1;
            due = due.after(period);
            if times.is_some_and(|times| times <= sent) || end.is_some_and(|end| end <= due) {
                break Ok(());
            }
            if let Err(failure) = self.wait(due) {
                break Err(failure);
            }
        };
        match outcome {
            // Ctrl-C: what was sent last is still to be heard.
            Ok(()) | Err(Failure::Unwanted) => clock::nap(LINGER),
            Err(failure) => return Err(failure),
        }
        say(&format!("sent {sent} on {}", self.row.name))?;
        Ok(0)
    }

    /// Sleeps until then, unless there is a reason to end.
    fn wait(&self, due: interfaces::Stamp) -> Result<(), Failure> {
        const NAP_MAX: Duration = Duration::from_millis(50);
        loop {
            check_presence(self.robot)?;
            let left = due.since(clock::now());
            if left.is_zero() {
                return Ok(());
            }
            clock::nap(left.min(NAP_MAX));
        }
    }
}

/// A message with these fields, and zeros.
fn filled<T: Described>(settings: &[String], topic: &str) -> Result<T, Failure> {
    let mut message = T::default();
    let fields = message.fields();
    for setting in settings {
        let Some((name, text)) = setting.split_once('=') else {
            let example = fields.first().map_or("linear", |field| field.name);
            return Err(Failure::Refused(format!(
                "`{setting}` is no field; write FIELD=VALUE, such as {example}=1"
            )));
        };
        let unit = unit(&fields, name);
        message.set(name, text.trim()).map_err(|error| match error {
            SetError::NoField => {
                let names: Vec<_> = fields.iter().map(|field| field.name).collect();
                let help = suggestion(name, &names);
                Failure::Refused(format!("{topic} has no field `{name}`; {help}"))
            }
            SetError::NoValue => {
                Failure::Refused(format!("`{text}` is nothing that `{name}`{unit} can hold"))
            }
        })?;
    }
    Ok(message)
}

fn unit(fields: &[Field], name: &str) -> String {
    let field = fields.iter().find(|field| field.name == name && field.unit != "-");
    field.map_or(String::new(), |field| format!(" [{}]", field.unit))
}

#[cfg(test)]
mod tests {
    use interfaces::VelocityCommand;

    use super::*;

    fn refusal(settings: &[&str]) -> String {
        let settings: Vec<_> = settings.iter().map(|&setting| setting.to_owned()).collect();
        match filled::<VelocityCommand>(&settings, "cmd_vel") {
            Err(Failure::Refused(why)) => why,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_is_no_field_or_no_value_is_told_with_what_would_be() {
        assert!(refusal(&["linaer=1"]).ends_with("did you mean `linear`?"));
        assert!(refusal(&["linear"]).contains("write FIELD=VALUE"));
        assert_eq!(refusal(&["linear=fast"]), "`fast` is nothing that `linear` [m/s] can hold");
    }
}
