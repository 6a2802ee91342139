//! `teseo topic`: what flows between processes.

mod echo;
mod meter;
mod publish;
mod show;

use clap::{Args, Subcommand};
use interfaces::{Loss, topics};
use node::config::suggestion_or;
use node::control::Failure;
use node::observe::{self, Observer, Row};
use node::say::say;
use node::{Clock, Session};
use serde_json::{Value, json};

use crate::robot::Robot;
use crate::table::{listed, rate, table};
use crate::{Which, refused, understood};
use meter::Figure;

/// A verb about topics.
#[derive(Debug, Args)]
pub struct Topic {
    #[command(subcommand)]
    verb: Verb,
}

/// What there is to be asked.
#[derive(Debug, Subcommand)]
enum Verb {
    /// List the topics in use: type, rate, who publishes, who reads
    #[command(
        after_help = "Example:\n  teseo topic list --all",
        arg = understood('t', "show-types"),
        arg = understood('v', "verbose")
    )]
    List {
        #[command(flatten)]
        robot: Which,
        /// Also those that nobody uses, and those that each node has of its own
        #[arg(short, long, alias = "include-hidden-topics")]
        all: bool,
        /// Print only how many there are
        #[arg(short, long = "count-topics", conflicts_with = "json")]
        count: bool,
        /// Print one JSON array
        #[arg(long)]
        json: bool,
    },
    /// Show one topic: type, fields, queue, and all who are at it, guests included
    #[command(
        after_help = "Example:\n  teseo topic info cmd_vel",
        arg = understood('v', "verbose")
    )]
    Info {
        #[command(flatten)]
        robot: Which,
        /// The topic
        topic: String,
    },
    /// Print the type of a topic
    #[command(after_help = "Example:\n  teseo topic type scan")]
    Type {
        #[command(flatten)]
        robot: Which,
        /// The topic
        topic: String,
    },
    /// List the topics of a type
    #[command(after_help = "Example:\n  teseo topic find LaserScan")]
    Find {
        #[command(flatten)]
        robot: Which,
        /// The type
        #[arg(value_name = "TYPE")]
        message: String,
    },
    /// Print the samples of a topic as they come, field by field
    Echo(echo::Options),
    /// Say how often a topic carries a sample, and how evenly
    #[command(after_help = "Example:\n  teseo topic hz scan --for 5")]
    Hz(meter::Options),
    /// Say how much a topic carries
    #[command(after_help = "Example:\n  teseo topic bw scan --once")]
    Bw(meter::Options),
    /// Say how old the data of a topic is when it comes
    #[command(after_help = "Example:\n  teseo topic delay odom --once --json")]
    Delay(meter::Options),
    /// Publish on a topic that has no publisher, and is no node's of this robot
    Pub(publish::Options),
}

impl Topic {
    pub(crate) fn carry_out(&self) -> Result<u8, Failure> {
        match &self.verb {
            Verb::List { robot, all, count: true, .. } => {
                say(&lines(&robot.find()?, *all).len().to_string()).map(|()| 0)
            }
            Verb::List { robot, all, json, .. } => list(&robot.find()?, *all, *json),
            Verb::Info { robot, topic } => info(&robot.find()?, topic),
            Verb::Type { robot, topic } => say(row(&robot.find()?, topic)?.message).map(|()| 0),
            Verb::Find { robot, message } => find(&robot.find()?, message),
            Verb::Echo(options) => echo::echo(options),
            Verb::Hz(options) => meter::measure(options, Figure::Rate),
            Verb::Bw(options) => meter::measure(options, Figure::Bandwidth),
            Verb::Delay(options) => meter::measure(options, Figure::Delay),
            Verb::Pub(options) => publish::publish(options),
        }
    }
}

/// The topics in use, or all that there can be.
fn lines(robot: &Robot, all: bool) -> Vec<Line> {
    names(robot)
        .iter()
        .filter_map(|name| Line::of(robot, name))
        .filter(|line| all || (line.is_used() && !line.row.name.contains('/')))
        .collect()
}

fn list(robot: &Robot, all: bool, json: bool) -> Result<u8, Failure> {
    let lines = lines(robot, all);
    if json {
        let lines: Vec<_> = lines.iter().map(Line::json).collect();
        return say(&json!(lines).to_string()).map(|()| 0);
    }
    let rows: Vec<_> = lines.iter().map(Line::cells).collect();
    say(&table(&["TOPIC", "TYPE", "RATE", "PUBLISHER", "READERS"], &rows)).map(|()| 0)
}

/// By the type's name, with ROS 2's package before it or without.
fn find(robot: &Robot, message: &str) -> Result<u8, Failure> {
    let wanted = message.rsplit('/').next().unwrap_or_default();
    let rows: Vec<_> = names(robot).iter().filter_map(|name| observe::row(name)).collect();
    let found: Vec<_> =
        rows.iter().filter(|row| row.message == wanted).map(|row| row.name.as_str()).collect();
    if found.is_empty() {
        let mut types: Vec<_> = rows.iter().map(|row| row.message).collect();
        types.sort_unstable();
        types.dedup();
        let help = suggestion_or(wanted, &types, "`teseo topic list --all` has them");
        return Err(Failure::Refused(format!("there is no type `{wanted}`; {help}")));
    }
    say(&found.join("\n")).map(|()| 0)
}

/// Every topic that the robot can have.
fn names(robot: &Robot) -> Vec<String> {
    let of_nodes = robot.nodes.iter().flat_map(|node| {
        topics::names_of_each_node().into_iter().map(|name| format!("{}/{name}", node.name))
    });
    topics::names().into_iter().map(str::to_owned).chain(of_nodes).collect()
}

/// What the table says of a topic of this robot, or what else might have been meant.
pub(crate) fn row(robot: &Robot, topic: &str) -> Result<Row, Failure> {
    let topic = topic.trim_start_matches('/');
    let names = names(robot);
    let is_there = names.iter().any(|name| name == topic);
    observe::row(topic).filter(|_| is_there).ok_or_else(|| {
        let help = suggestion_or(topic, &names, "`teseo topic list --all` has them");
        Failure::Refused(format!("there is no topic `{topic}`; {help}"))
    })
}

/// One topic in a list.
struct Line {
    row: Row,
    publisher: Option<String>,
    rate: Option<f64>,
    readers: Vec<String>,
}

impl Line {
    fn of(robot: &Robot, name: &str) -> Option<Self> {
        let publisher = robot.publisher(name).filter(|node| node.is_alive);
        let port = publisher.and_then(|node| node.topics(true).find(|port| port.topic == name));
        let readers = robot.readers(name).iter().map(|(node, _)| node.name.clone()).collect();
        let row = observe::row(name)?;
        // On its own topics a node and its supervisor speak, which neither of them counts.
        let owner = name.split_once('/').map(|(owner, _)| match row.publisher {
            "the node" => owner.to_owned(),
            role => role.to_owned(),
        });
        Some(Self {
            row,
            publisher: publisher.map(|node| node.name.clone()).or(owner),
            rate: port.and_then(|port| port.rate),
            readers,
        })
    }

    fn is_used(&self) -> bool {
        self.publisher.is_some() || !self.readers.is_empty()
    }

    fn cells(&self) -> Vec<String> {
        let rate = self.publisher.as_ref().and_then(|_| rate(&self.row.name, self.rate));
        vec![
            self.row.name.clone(),
            self.row.message.to_owned(),
            rate.unwrap_or_else(|| "-".to_owned()),
            self.publisher.clone().unwrap_or_else(|| "-".to_owned()),
            listed(&self.readers),
        ]
    }

    fn json(&self) -> Value {
        json!({
            "topic": self.row.name,
            "type": self.row.message,
            "hz": self.rate,
            "publisher": self.publisher,
            "readers": self.readers,
        })
    }
}

fn info(robot: &Robot, topic: &str) -> Result<u8, Failure> {
    let row = row(robot, topic)?;
    let session = join(robot)?;
    let observer = observe::topic(&session, &row.name).map_err(|error| refused(&error))?;
    let (publishers, readers) =
        observer.map_or_else(Default::default, |o| (o.publishers(), o.readers()));
    let counted = robot.readers(&row.name);
    let reader = |name: &String| {
        let port = counted.iter().find(|(node, _)| node.name == *name).map(|(_, port)| port);
        let counts = |port: &&crate::robot::Port| {
            format!("{name} ({} received, {} lost)", port.samples, port.lost)
        };
        port.map_or_else(|| name.clone(), counts)
    };
    let readers: Vec<_> = readers.iter().map(reader).collect();
    let loss = match row.loss {
        Loss::KeepNewest if robot.clock == Clock::Lockstep => "when full its publisher waits",
        Loss::KeepNewest => "when full the oldest goes",
        Loss::Latched => "when full the oldest goes; latched: who comes late gets the newest",
    };
    let field = |field: &interfaces::Field| format!("{} [{}]", field.name, field.unit);
    let fields: Vec<_> = row.fields.iter().map(field).collect();
    say(&format!(
        "{}: {}, {} bytes\npublisher  {} (may be: {})\nreaders    {}\n\
         queue      {} deep, stale after {} ms; {loss}\nfields     {}",
        row.name,
        row.message,
        row.size,
        listed(&publishers),
        row.publisher,
        readers_in_lines(&readers),
        row.depth,
        row.deadline.as_millis(),
        wrapped(&fields),
    ))?;
    Ok(0)
}

fn readers_in_lines(readers: &[String]) -> String {
    if readers.is_empty() { "-".to_owned() } else { readers.join("\n           ") }
}

/// With commas, in lines that are not too long.
fn wrapped(items: &[String]) -> String {
    const INDENT: usize = "fields     ".len();
    let mut lines = vec![String::new()];
    for (index, item) in items.iter().enumerate() {
        let comma = if index + 1 < items.len() { ", " } else { "" };
        let line = lines.last_mut().unwrap_or_else(|| unreachable!("it has a line"));
        if crate::table::WIDTH < INDENT + line.len() + item.len() + comma.len() {
            lines.push(format!("{item}{comma}"));
        } else {
            line.push_str(item);
            line.push_str(comma);
        }
    }
    let trimmed: Vec<_> = lines.iter().map(|line| line.trim_end()).collect();
    trimmed.join(&format!("\n{:INDENT$}", ""))
}

/// Joins the robot's shared memory as one who looks on.
pub(crate) fn join(robot: &Robot) -> Result<Session, Failure> {
    Session::guest(&robot.namespace, "console").map_err(|error| refused(&error))
}

/// Looks on at a topic of which the table knows.
fn open(session: &Session, robot: &Robot, row: &Row) -> Result<Box<dyn Observer>, Failure> {
    let observer = observe::topic(session, &row.name).map_err(|error| refused(&error))?;
    observer.ok_or_else(|| {
        let (robot, topic) = (robot.name(), &row.name);
        let publisher = row.publisher;
        let why = format!("robot '{robot}' has no topic `{topic}`: it has no {publisher}");
        Failure::Refused(why)
    })
}

/// Whether the robot is still there; the reason to stop looking where it is not.
fn check_presence(robot: &Robot) -> Result<(), Failure> {
    node::control::check_stop()?;
    if robot.namespace.lock().exists() {
        return Ok(());
    }
    Err(Failure::NotRunning(format!("robot '{}' went away", robot.name())))
}
