//! `teseo graph`: the running robot's processes and the topics between them, as `rqt_graph` shows them.

mod svg;

use std::collections::BTreeMap;
use std::fmt::Write;

use clap::Args;
use node::control::Failure;
use node::observe;
use node::say::say;
use serde_json::{Value, json};

use crate::robot::Robot;
use crate::table::{WIDTH, cut, listed, rate};
use crate::topic::join;
use crate::{Which, refused};

/// How to show it.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  teseo graph\n  teseo graph --svg > robot.svg\n  \
                        teseo graph --dot | dot -Tpng > robot.png")]
#[expect(clippy::struct_excessive_bools, reason = "a flag for each format, and one may be given")]
pub struct Options {
    #[command(flatten)]
    robot: Which,
    /// For Graphviz
    #[arg(long, group = "format")]
    dot: bool,
    /// For Markdown
    #[arg(long, group = "format")]
    mermaid: bool,
    /// For a browser: one file that needs no other
    #[arg(long, group = "format")]
    svg: bool,
    /// For programs
    #[arg(long, group = "format")]
    json: bool,
}

/// Prints the graph.
pub(crate) fn show(options: &Options) -> Result<u8, Failure> {
    let graph = Graph::of(&options.robot.find()?)?;
    let text = if options.dot {
        graph.dot()
    } else if options.mermaid {
        graph.mermaid()
    } else if options.svg {
        svg::draw(&graph)
    } else if options.json {
        serde_json::to_string_pretty(&graph.json()).unwrap_or_default()
    } else {
        graph.text()
    };
    say(&text)?;
    Ok(0)
}

/// Processes and topics.
#[derive(Debug)]
struct Graph {
    title: String,
    /// In the order in which they start, guests last.
    processes: Vec<Process>,
    edges: Vec<Edge>,
}

/// One who publishes or reads.
#[derive(Debug)]
struct Process {
    name: String,
    /// ROS 2's word, or `guest` for one whom no supervisor looks after.
    state: String,
}

/// One topic that somebody publishes or reads.
#[derive(Debug)]
struct Edge {
    topic: String,
    /// [Hz] As its publisher's supervisor counts it.
    rate: Option<f64>,
    publisher: Option<String>,
    readers: Vec<String>,
}

impl Graph {
    fn of(robot: &Robot) -> Result<Self, Failure> {
        let mut edges: BTreeMap<String, Edge> = BTreeMap::new();
        let mut processes: Vec<_> = robot
            .nodes
            .iter()
            .map(|node| Process { name: node.name.clone(), state: node.state.clone() })
            .collect();
        let mut order = Vec::new();
        for node in robot.nodes.iter().filter(|node| node.is_alive) {
            for port in &node.ports {
                if !edges.contains_key(&port.topic) {
                    order.push(port.topic.clone());
                }
                let edge =
                    edges.entry(port.topic.clone()).or_insert_with(|| Edge::new(&port.topic));
                if port.publishes {
                    edge.publisher = Some(node.name.clone());
                    edge.rate = port.rate;
                } else {
                    edge.readers.push(node.name.clone());
                }
            }
        }
        add_guests(robot, &mut processes, &mut edges)?;
        let mut edges: Vec<_> = order.iter().filter_map(|topic| edges.remove(topic)).collect();
        let place = |edge: &Edge| {
            let publisher = edge.publisher.as_ref();
            processes.iter().position(|process| Some(&process.name) == publisher)
        };
        // What nobody publishes comes last.
        edges.sort_by_key(|edge| place(edge).unwrap_or(usize::MAX));
        let title = format!("{} is {}", robot.name(), robot.state);
        Ok(Self { title, processes, edges })
    }

    fn text(&self) -> String {
        let mut text = self.title.clone();
        let width = self.edges.iter().map(|edge| edge.topic.len()).max().unwrap_or_default();
        for process in &self.processes {
            let _ = write!(text, "\n\n{} ({})", process.name, process.state);
            let edges =
                self.edges.iter().filter(|edge| edge.publisher.as_ref() == Some(&process.name));
            for edge in edges {
                let (topic, rate) = (&edge.topic, edge.label());
                let line = format!("  {topic:<width$}  {rate:>11}  -> {}", listed(&edge.readers));
                let _ = write!(text, "\n{}", cut(&line, WIDTH));
            }
        }
        let silent: Vec<_> = self.edges.iter().filter(|edge| edge.publisher.is_none()).collect();
        if !silent.is_empty() {
            text.push_str("\n\nnobody publishes");
            for edge in silent {
                let line =
                    format!("  {:<width$}  {:>11}  -> {}", edge.topic, "", listed(&edge.readers));
                let _ = write!(text, "\n{}", cut(&line, WIDTH));
            }
        }
        text
    }

    fn dot(&self) -> String {
        let mut text = format!("digraph {:?} {{\n  rankdir=LR;\n", self.title);
        for Process { name, state } in &self.processes {
            let _ = writeln!(text, "  {name:?} [label=\"{name}\\n{state}\"];");
        }
        for edge in &self.edges {
            let (topic, rate) = (&edge.topic, edge.label());
            let _ = writeln!(text, "  \"/{topic}\" [shape=box, label=\"{topic}\\n{rate}\"];");
            if let Some(publisher) = &edge.publisher {
                let _ = writeln!(text, "  {publisher:?} -> \"/{topic}\";");
            }
            for reader in &edge.readers {
                let _ = writeln!(text, "  \"/{topic}\" -> {reader:?};");
            }
        }
        text.push('}');
        text
    }

    fn mermaid(&self) -> String {
        let mut text = "flowchart LR".to_owned();
        for Process { name, state } in &self.processes {
            let _ = write!(text, "\n  n_{name}([\"{name}<br>{state}\"])");
        }
        for edge in &self.edges {
            let (topic, rate) = (&edge.topic, edge.label());
            let _ = write!(text, "\n  t_{topic}[\"{topic}<br>{rate}\"]");
            if let Some(publisher) = &edge.publisher {
                let _ = write!(text, "\n  n_{publisher} --> t_{topic}");
            }
            for reader in &edge.readers {
                let _ = write!(text, "\n  t_{topic} --> n_{reader}");
            }
        }
        text
    }

    fn json(&self) -> Value {
        let processes = self.processes.iter();
        let edges = self.edges.iter();
        json!({
            "title": self.title,
            "processes": processes
                .map(|process| json!({ "name": process.name, "state": process.state }))
                .collect::<Vec<_>>(),
            "topics": edges
                .map(|edge| json!({
                    "topic": edge.topic,
                    "hz": edge.rate,
                    "publisher": edge.publisher,
                    "readers": edge.readers,
                }))
                .collect::<Vec<_>>(),
        })
    }
}

impl Edge {
    fn new(topic: &str) -> Self {
        Self { topic: topic.to_owned(), rate: None, publisher: None, readers: Vec::new() }
    }

    fn label(&self) -> String {
        self.publisher.as_ref().and_then(|_| rate(&self.topic, self.rate)).unwrap_or_default()
    }
}

/// Those at the robot's topics whom no supervisor looks after, such as a person who drives.
fn add_guests(
    robot: &Robot,
    processes: &mut Vec<Process>,
    edges: &mut BTreeMap<String, Edge>,
) -> Result<(), Failure> {
    let session = join(robot)?;
    for (topic, edge) in edges {
        let observer = observe::topic(&session, topic).map_err(|error| refused(&error))?;
        let Some(observer) = observer else { continue };
        let mut guest = |name: &String| {
            // The supervisor reads of everything, and is in no picture.
            let is_known =
                name == "supervisor" || robot.nodes.iter().any(|node| node.name == *name);
            if !is_known && processes.iter().all(|process| process.name != *name) {
                processes.push(Process { name: name.clone(), state: "guest".to_owned() });
            }
            !is_known
        };
        for name in observer.publishers().iter().filter(|name| guest(name)) {
            edge.publisher = Some(name.clone());
        }
        edge.readers.extend(observer.readers().iter().filter(|name| guest(name)).cloned());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn graph() -> Graph {
        let process = |name: &str, state: &str| Process { name: name.into(), state: state.into() };
        let edge = |topic: &str, rate, publisher: Option<&str>, readers: &[&str]| Edge {
            topic: topic.to_owned(),
            rate,
            publisher: publisher.map(str::to_owned),
            readers: readers.iter().map(|&reader| reader.to_owned()).collect(),
        };
        Graph {
            title: "burger is ready".to_owned(),
            processes: vec![process("simulator", "active"), process("controller", "inactive")],
            edges: vec![
                edge("scan", Some(20.0), Some("simulator"), &["pairing", "controller"]),
                edge("pose", None, None, &["controller"]),
            ],
        }
    }

    #[test]
    fn a_robot_reads_like_this() {
        assert_eq!(
            graph().text(),
            "\
burger is ready

simulator (active)
  scan      20.0 Hz  -> pairing, controller

controller (inactive)

nobody publishes
  pose               -> controller"
        );
    }

    #[test]
    fn every_format_has_every_edge() {
        let graph = graph();

        for edge in ["\"simulator\" -> \"/scan\";", "\"/scan\" -> \"controller\";"] {
            assert!(graph.dot().contains(edge), "{}", graph.dot());
        }
        for edge in ["n_simulator --> t_scan", "t_pose --> n_controller"] {
            assert!(graph.mermaid().contains(edge), "{}", graph.mermaid());
        }
        assert_eq!(graph.json()["topics"][0]["readers"][1], "controller");
    }
}
