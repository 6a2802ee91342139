//! `teseo node`: the robot's nodes, and one of them in full.

use clap::{Args, Subcommand};
use node::control::{self, Failure};
use node::say::{say, shown, span};
use serde_json::{Value, json};

use crate::robot::{Node, Port};
use crate::table::{WIDTH, cut, number, rate, table};
use crate::{Which, understood};

/// A verb about nodes.
#[derive(Debug, Args)]
pub struct Nodes {
    #[command(subcommand)]
    verb: Verb,
}

/// What there is to be asked.
#[derive(Debug, Subcommand)]
enum Verb {
    /// List the robot's nodes: where they stand, their process, how many topics they have
    #[command(after_help = "Example:\n  teseo node list", arg = understood('a', "all"))]
    List {
        #[command(flatten)]
        robot: Which,
        /// Print only how many there are
        #[arg(short, long = "count-nodes", conflicts_with = "json")]
        count: bool,
        /// Print one JSON array
        #[arg(long)]
        json: bool,
    },
    /// Show one node: what it publishes and reads, with its counters and figures
    #[command(after_help = "Example:\n  teseo node info controller")]
    Info {
        #[command(flatten)]
        robot: Which,
        /// The node
        #[arg(value_parser = control::node_name)]
        node: String,
        /// Print everything that is known, as JSON
        #[arg(long)]
        json: bool,
    },
}

impl Nodes {
    pub(crate) fn carry_out(&self) -> Result<u8, Failure> {
        match &self.verb {
            Verb::List { robot, count: true, .. } => say(&robot.find()?.nodes.len().to_string())?,
            Verb::List { robot, json, .. } => {
                let robot = robot.find()?;
                if *json {
                    let nodes: Vec<_> = robot.nodes.iter().map(|node| &node.json).collect();
                    say(&json!(nodes).to_string())?;
                } else {
                    let rows: Vec<_> = robot.nodes.iter().map(row).collect();
                    say(&table(&["NODE", "STATE", "PID", "UP", "PUBLISHES", "READS"], &rows))?;
                }
            }
            Verb::Info { robot, node, json } => {
                let robot = robot.find()?;
                let node = robot.node(node)?;
                let pretty = || serde_json::to_string_pretty(&node.json).unwrap_or_default();
                say(&if *json { pretty() } else { described(node) })?;
            }
        }
        Ok(0)
    }
}

fn row(node: &Node) -> Vec<String> {
    let count = |publishes| node.topics(publishes).count().to_string();
    vec![node.name.clone(), node.state.clone(), pid(node), uptime(node), count(true), count(false)]
}

fn described(node: &Node) -> String {
    let json = &node.json;
    let mut lines = vec![format!(
        "{} is {} ({}): process {}, epoch {}, up {}, restarts {}",
        node.name,
        node.state,
        shown(json["doing"].as_str().unwrap_or_default()),
        pid(node),
        json["epoch"],
        uptime(node),
        json["restarts"]
    )];
    if let Some(text) = json["text"].as_str().filter(|text| !text.is_empty()) {
        lines.push(format!("it says: {}", shown(text)));
    }
    if let Some(what) = json["last_failure"]["what"].as_str() {
        let ago = span(json["last_failure"]["ago_s"].as_f64().unwrap_or_default());
        lines.push(format!("last fault, {ago} ago: {}", shown(what)));
    }
    let publishes: Vec<_> = node.topics(true).map(port).collect();
    let reads: Vec<_> = node.topics(false).map(port).collect();
    for (title, rows) in [("PUBLISHES", publishes), ("READS", reads)] {
        if !rows.is_empty() {
            lines.push(table(&[title, "RATE", "SAMPLES", "LOST"], &rows));
        }
    }
    let figures = json["values"].as_object().into_iter().flatten();
    let figures: Vec<_> = figures.map(|(key, value)| vec![shown(key), figure(value)]).collect();
    if !figures.is_empty() {
        lines.push(table(&["FIGURE", "VALUE"], &figures));
    }
    lines.join("\n").lines().map(|line| cut(line, WIDTH)).collect::<Vec<_>>().join("\n")
}

fn port(port: &Port) -> Vec<String> {
    let rate = port.publishes.then(|| rate(&port.topic, port.rate)).flatten();
    let rate = rate.unwrap_or_else(|| "-".to_owned());
    vec![port.topic.clone(), rate, port.samples.to_string(), port.lost.to_string()]
}

fn figure(value: &Value) -> String {
    value.as_f64().map_or_else(|| "not a number".to_owned(), number)
}

fn pid(node: &Node) -> String {
    node.json["pid"].as_u64().map_or_else(|| "-".to_owned(), |pid| pid.to_string())
}

fn uptime(node: &Node) -> String {
    node.json["uptime_s"].as_f64().map_or_else(|| "-".to_owned(), span)
}
