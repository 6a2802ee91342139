//! `teseo lifecycle`: where nodes stand, in ROS 2's words. Only the supervisor moves a node.

use clap::{Args, Subcommand};
use interfaces::{State, Transition};
use node::config::suggestion;
use node::control::Failure;
use node::say::say;

use crate::robot::Node;
use crate::{Steer, Which};

/// A verb about where nodes stand.
#[derive(Debug, Args)]
pub struct Lifecycle {
    #[command(subcommand)]
    verb: Verb,
}

/// What there is to be asked.
#[derive(Debug, Subcommand)]
enum Verb {
    /// Say where a node stands
    #[command(after_help = "Example:\n  teseo lifecycle get controller")]
    Get {
        #[command(flatten)]
        robot: Which,
        /// The node [default: all]
        node: Option<String>,
    },
    /// Have the supervisor move a node: `activate` one that is down, `shutdown` one that is up
    #[command(after_help = "Example:\n  teseo lifecycle set controller shutdown")]
    Set {
        #[command(flatten)]
        robot: Which,
        /// The node
        node: String,
        /// ROS 2's word for the transition
        transition: String,
    },
    /// List the transitions that a node can be asked for now
    #[command(after_help = "Example:\n  teseo lifecycle list controller")]
    List {
        #[command(flatten)]
        robot: Which,
        /// The node
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
                let goal = if transition == Transition::Activate { "active" } else { "finalized" };
                say(&format!("{transition}  {} -> {goal}", node.stands()))?;
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
            "`{word}` is not for {name}, which is {}: its supervisor keeps a node active or down, \
             and starts it in one go; it can be asked for `{possible}`, or to begin anew by \
             `teseo restart {name}`",
            node.stands()
        )));
    }
    Ok(transition == Transition::Activate)
}
