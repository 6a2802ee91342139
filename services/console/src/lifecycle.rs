//! `teseo lifecycle`: where nodes stand, in ROS 2's words. Only the supervisor moves a node.

use clap::{Args, Subcommand};
use interfaces::{State, Transition};
use node::config::suggestion;
use node::control::{self, Failure};
use node::say::say;

use crate::robot::Node;
use crate::{Steer, Which, understood};

/// A verb about where nodes stand.
#[derive(Debug, Args)]
pub struct Lifecycle {
    #[command(subcommand)]
    verb: Verb,
}

/// What there is to be asked.
#[derive(Debug, Subcommand)]
enum Verb {
    /// List the nodes that have a lifecycle, which all have
    #[command(after_help = "Example:\n  teseo lifecycle nodes", arg = understood('a', "all"))]
    Nodes {
        #[command(flatten)]
        robot: Which,
        /// Print only how many there are
        #[arg(short, long = "count-nodes")]
        count: bool,
    },
    /// Say where a node stands
    #[command(after_help = "Example:\n  teseo lifecycle get controller")]
    Get {
        #[command(flatten)]
        robot: Which,
        /// The node [default: all]
        #[arg(value_parser = control::node_name)]
        node: Option<String>,
    },
    /// Have the supervisor move a node: `activate` one that is finalized, `shutdown` another
    #[command(after_help = "Example:\n  teseo lifecycle set controller shutdown")]
    Set {
        #[command(flatten)]
        robot: Which,
        /// The node
        #[arg(value_parser = control::node_name)]
        node: String,
        /// ROS 2's word for the transition
        transition: String,
    },
    /// List the transitions that a node can be asked for now
    #[command(after_help = "Example:\n  teseo lifecycle list controller", arg = understood('a', "all"))]
    List {
        #[command(flatten)]
        robot: Which,
        /// The node
        #[arg(value_parser = control::node_name)]
        node: String,
    },
}

/// Every word that ROS 2 has.
const WORDS: [Transition; 5] = [
    Transition::Configure,
    Transition::CleanUp,
    Transition::Activate,
    Transition::Deactivate,
    Transition::ShutdownActive,
];

impl Lifecycle {
    pub(crate) fn carry_out(&self, steer: Steer) -> Result<u8, Failure> {
        match &self.verb {
            Verb::Nodes { robot, count } => {
                let nodes = robot.find()?.nodes;
                let names: Vec<_> = nodes.iter().map(|node| node.name.as_str()).collect();
                say(&if *count { names.len().to_string() } else { names.join("\n") })?;
            }
            Verb::Get { robot, node: Some(name) } => say(&state(robot.find()?.node(name)?))?,
            Verb::Get { robot, node: None } => {
                let robot = robot.find()?;
                let width = robot.nodes.iter().map(|node| node.name.len()).max().unwrap_or(0);
                let line = |node: &Node| format!("{:<width$}  {}", node.name, state(node));
                say(&robot.nodes.iter().map(line).collect::<Vec<_>>().join("\n"))?;
            }
            Verb::Set { robot, node, transition } => {
                let robot = robot.find()?;
                let node = robot.node(node)?;
                return steer(&robot.namespace, &node.name, goal(node, transition)?);
            }
            Verb::List { robot, node } => {
                let robot = robot.find()?;
                let node = robot.node(node)?;
                let transition = possible(node);
                say(&format!("{transition}  {} -> {}", node.state, transition.goal()))?;
            }
        }
        Ok(0)
    }
}

/// ROS 2's word and number.
fn state(node: &Node) -> String {
    let numbers = (0..=u8::MAX).filter_map(|number| State::try_from(number).ok());
    let state = numbers.into_iter().find(|state| state.label() == node.state);
    format!("{} [{}]", node.state, state.unwrap_or(State::Unknown) as u8)
}

/// What a supervised node can be asked for: it is up, or it is down.
const fn possible(node: &Node) -> Transition {
    if node.is_alive { Transition::ShutdownActive } else { Transition::Activate }
}

/// Whether the node is wanted up, by ROS 2's word for the transition.
fn goal(node: &Node, word: &str) -> Result<bool, Failure> {
    let Some(transition) = WORDS.into_iter().find(|transition| transition.label() == word) else {
        let help = suggestion(word, &WORDS.map(Transition::label));
        return Err(Failure::Refused(format!("there is no transition `{word}`; {help}")));
    };
    let possible = possible(node);
    if transition != possible {
        let name = &node.name;
        return Err(Failure::Refused(format!(
            "{name} is {}, and a supervisor keeps a node active or finalized: ask for `{possible}`, \
             or `teseo restart {name}`",
            node.state
        )));
    }
    Ok(transition == Transition::Activate)
}
