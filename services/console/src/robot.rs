//! The robot as its supervisor knows it: nodes, and what they publish and read.

use node::config::suggestion;
use node::control::{Connection, Failure, Request};
use node::{Clock, Namespace};
use serde_json::Value;

/// A robot that runs.
#[derive(Debug)]
pub(crate) struct Robot {
    pub(crate) namespace: Namespace,
    pub(crate) clock: Clock,
    /// `ready`, `starting`, `degraded` or `ending`.
    pub(crate) state: String,
    pub(crate) nodes: Vec<Node>,
    /// All that is known.
    pub(crate) json: Value,
}

/// One of its nodes.
#[derive(Debug)]
pub(crate) struct Node {
    pub(crate) name: String,
    /// ROS 2's word.
    pub(crate) state: String,
    pub(crate) is_alive: bool,
    pub(crate) ports: Vec<Port>,
    /// All that is known.
    pub(crate) json: Value,
}

/// One topic that a node publishes or reads.
#[derive(Debug)]
pub(crate) struct Port {
    pub(crate) topic: String,
    pub(crate) publishes: bool,
    /// [-] Samples sent or received in this life.
    pub(crate) samples: u64,
    pub(crate) lost: u64,
    /// [Hz] By the wall's clock; of a publisher.
    pub(crate) rate: Option<f64>,
}

impl Robot {
    /// Asks its supervisor.
    pub(crate) fn ask(namespace: Namespace) -> Result<Self, Failure> {
        let status = Connection::open(&namespace, &Request::Status)?.answer()?;
        let is_lockstep = status["clock"] == "lockstep";
        Ok(Self {
            namespace,
            clock: if is_lockstep { Clock::Lockstep } else { Clock::Realtime },
            state: text(&status["state"]),
            nodes: status["nodes"].as_array().into_iter().flatten().map(Node::of).collect(),
            json: status,
        })
    }

    pub(crate) fn name(&self) -> &str {
        self.namespace.robot()
    }

    /// The node called `name`.
    pub(crate) fn node(&self, name: &str) -> Result<&Node, Failure> {
        self.nodes.iter().find(|node| node.name == name).ok_or_else(|| {
            let names: Vec<_> = self.nodes.iter().map(|node| &node.name).collect();
            let help = suggestion(name, &names);
            Failure::Refused(format!("there is no node `{name}`; {help}"))
        })
    }

    /// The node that publishes `topic`, whether it lives at present or not.
    pub(crate) fn publisher(&self, topic: &str) -> Option<&Node> {
        let publishes =
            |node: &&Node| node.ports.iter().any(|port| port.publishes && port.topic == topic);
        self.nodes.iter().find(publishes)
    }

    /// The living nodes that read `topic`, with what they count there.
    pub(crate) fn readers(&self, topic: &str) -> Vec<(&Node, &Port)> {
        let living = self.nodes.iter().filter(|node| node.is_alive);
        let ports = living.flat_map(|node| node.ports.iter().map(move |port| (node, port)));
        ports.filter(|(_, port)| !port.publishes && port.topic == topic).collect()
    }
}

impl Node {
    fn of(json: &Value) -> Self {
        let rates = json["topics"].as_array();
        let rate = |topic: &Value| {
            let rate = rates.into_iter().flatten().find(|rate| rate["topic"] == *topic)?;
            rate["hz"].as_f64()
        };
        let port = |port: &Value| Port {
            topic: text(&port["topic"]),
            publishes: port["publishes"] == true,
            samples: port["samples"].as_u64().unwrap_or_default(),
            lost: port["lost"].as_u64().unwrap_or_default(),
            rate: rate(&port["topic"]).filter(|_| port["publishes"] == true),
        };
        Self {
            name: text(&json["name"]),
            state: text(&json["state"]),
            is_alive: !json["pid"].is_null(),
            ports: json["ports"].as_array().into_iter().flatten().map(port).collect(),
            json: json.clone(),
        }
    }

    /// The topics that it publishes, or those that it reads.
    pub(crate) fn topics(&self, publishes: bool) -> impl Iterator<Item = &Port> {
        self.ports.iter().filter(move |port| port.publishes == publishes)
    }
}

fn text(value: &Value) -> String {
    node::say::shown(value.as_str().unwrap_or_default())
}
