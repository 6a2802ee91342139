//! `teseo param`: what a node was told, and telling it something else while it runs.

mod file;

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Arg, ArgAction, Args, Subcommand};
use node::config::{Listed, Place, suggestion_or};
use node::control::{self, Connection, Failure, Request};
use node::say::{mention, say, wrapped};
use node::{Choice, Clock, Settings, Tunable, clock};
use serde_json::{Map, Value, json};

use crate::robot::{Node, Robot};
use crate::table::{cut, number, table};
use crate::{Which, refused};

/// What knows the parameters of a service and which of them may be changed while it runs; `None` where
/// there is no such service.
pub type Know = fn(&Settings) -> Option<(node::Result<Vec<Listed>>, &'static [Tunable])>;

/// [character] Of a text in a table; `param get` prints all of it.
const VALUE_WIDTH: usize = 16;

/// A verb about parameters.
#[derive(Debug, Args)]
pub struct Parameters {
    #[command(subcommand)]
    verb: Verb,
}

/// What there is to be asked.
#[derive(Debug, Subcommand)]
enum Verb {
    /// List a node's parameters: value, what it may be changed to, default, and who says so
    #[command(after_help = "Example:\n  teseo param list controller")]
    List {
        #[command(flatten)]
        robot: Which,
        /// The node [default: all]
        #[arg(value_parser = control::node_name)]
        node: Option<String>,
        /// Print one JSON array
        #[arg(long)]
        json: bool,
    },
    /// Print one parameter's value
    #[command(
        after_help = "Example:\n  teseo param get controller wall_following.speed_m_s",
        arg = Arg::new("hide-type").long("hide-type").action(ArgAction::SetTrue).hide(true)
    )]
    Get {
        #[command(flatten)]
        one: One,
    },
    /// Change a parameter from now until the node starts anew; the change is an event
    #[command(
        after_help = "Examples:\n  teseo param set controller wall_following.speed_m_s 0.1\n  \
                            teseo param set simulator lidar.noise gazebo"
    )]
    Set {
        #[command(flatten)]
        one: One,
        /// The value: a number in the unit at the key's end, a word, true or false
        #[arg(allow_negative_numbers = true)]
        value: String,
    },
    /// Tell everything about a parameter
    #[command(after_help = "Example:\n  teseo param describe odometry track_m")]
    Describe {
        #[command(flatten)]
        one: One,
    },
    /// Print a node's parameters as they are by now, as a file of parameters
    #[command(after_help = "Example:\n  teseo param dump controller > controller.toml")]
    Dump {
        #[command(flatten)]
        robot: Which,
        /// The node
        #[arg(value_parser = control::node_name)]
        node: String,
    },
    /// Change all parameters of a node to what a file says, where they are something else
    #[command(after_help = "Example:\n  teseo param load controller controller.toml")]
    Load {
        #[command(flatten)]
        robot: Which,
        /// The node
        #[arg(value_parser = control::node_name)]
        node: String,
        /// As `param dump` prints it; what it does not have stays as it is
        file: PathBuf,
    },
}

/// Which parameter of which node.
#[derive(Debug, Args)]
struct One {
    #[command(flatten)]
    robot: Which,
    /// The node
    #[arg(value_parser = control::node_name)]
    node: String,
    /// The parameter's dotted key
    key: String,
}

impl Parameters {
    pub(crate) fn carry_out(&self, know: Know) -> Result<u8, Failure> {
        match &self.verb {
            Verb::List { robot, node: Some(node), json } => {
                let robot = robot.find()?;
                list(&robot, robot.node(node)?, *json, know)?;
            }
            Verb::List { robot, node: None, json } => list_all(&robot.find()?, *json, know)?,
            Verb::Get { one } => {
                let robot = one.robot.find()?;
                let node = robot.node(&one.node)?;
                let all = all(&robot, node, know)?;
                say(&shown(&find(&all, &node.name, &one.key)?.value))?;
                mention_newer_files(&robot, node, &all);
            }
            Verb::Set { one, value } => {
                let robot = one.robot.find()?;
                let node = robot.node(&one.node)?;
                // A node that is none of ours knows its parameters alone.
                if let Ok(all) = all(&robot, node, know) {
                    check_tunable(&robot, node, find(&all, &node.name, &one.key)?)?;
                }
                say(&set(&robot, &node.name, &one.key, value)?)?;
            }
            Verb::Describe { one } => {
                let robot = one.robot.find()?;
                let node = robot.node(&one.node)?;
                let all = all(&robot, node, know)?;
                say(&find(&all, &node.name, &one.key)?.described(&node.name))?;
                mention_newer_files(&robot, node, &all);
            }
            Verb::Dump { robot, node } => {
                let robot = robot.find()?;
                let node = robot.node(node)?;
                say(&file::dumped(&all(&robot, node, know)?))?;
            }
            Verb::Load { robot, node, file } => {
                let robot = robot.find()?;
                let node = robot.node(node)?;
                return file::load(&robot, node, &all(&robot, node, know)?, file);
            }
        }
        Ok(0)
    }
}

fn list(robot: &Robot, node: &Node, json: bool, know: Know) -> Result<(), Failure> {
    let all = all(robot, node, know)?;
    if json {
        let all: Vec<_> = all.iter().map(Parameter::json).collect();
        say(&json!(all).to_string())?;
    } else {
        let mut files = Vec::new();
        let rows: Vec<_> = all.iter().map(|parameter| parameter.cells(&mut files)).collect();
        say(&table(&["PARAMETER", "VALUE", "MAY BE", "DEFAULT", "FROM"], &rows))?;
        for (number, file) in (1..).zip(files) {
            say(&format!("[{number}] {}", from_here(file).display()))?;
        }
    }
    mention_newer_files(robot, node, &all);
    Ok(())
}

/// Of all nodes that have any, under the name of each.
fn list_all(robot: &Robot, json: bool, know: Know) -> Result<(), Failure> {
    let mut told = Map::new();
    let mut is_first = true;
    for node in &robot.nodes {
        let Ok(all) = all(robot, node, know) else { continue };
        if json {
            told.insert(node.name.clone(), all.iter().map(Parameter::json).collect());
            continue;
        }
        if !std::mem::replace(&mut is_first, false) {
            say("")?;
        }
        say(&format!("{}:", node.name))?;
        list(robot, node, false, know)?;
    }
    if json { say(&Value::Object(told).to_string()) } else { Ok(()) }
}

/// One parameter of a node that runs.
struct Parameter {
    key: String,
    value: Value,
    default: Value,
    from: From,
    tunable: Option<&'static Tunable>,
}

/// Who says what a parameter is.
enum From {
    Place(Place),
    /// Somebody, while the node runs.
    Change,
}

/// All parameters of a node: as its launch file has them, and what was changed since its start.
fn all(robot: &Robot, node: &Node, know: Know) -> Result<Vec<Parameter>, Failure> {
    let settings = Settings::of_supervisor(&robot.config(), &robot.sets())
        .map_err(|error| refused(&error))?
        .within(&node.name);
    let Some((listed, tunables)) = know(&settings) else {
        let (name, file) = (&node.name, robot.config());
        return Err(Failure::Refused(format!(
            "{name} has no table of parameters of its own; what it is told stands in {}",
            from_here(&file).display()
        )));
    };
    let changed = &node.json["changed"];
    let of = |listed: Listed| {
        let change = changed.get(&listed.key).filter(|_| node.is_alive);
        Parameter {
            tunable: tunables.iter().find(|tunable| tunable.key == listed.key),
            value: change.cloned().unwrap_or(listed.value),
            from: change.map_or(From::Place(listed.place), |_| From::Change),
            key: listed.key,
            default: listed.default,
        }
    };
    let listed = listed.map_err(|error| refused(&error))?;
    Ok(listed.into_iter().map(of).collect())
}

fn find<'a>(all: &'a [Parameter], node: &str, key: &str) -> Result<&'a Parameter, Failure> {
    all.iter().find(|parameter| parameter.key == key).ok_or_else(|| {
        let keys: Vec<_> = all.iter().map(|parameter| &parameter.key).collect();
        let help = suggestion_or(key, &keys, &format!("`teseo param list {node}` has them"));
        Failure::Refused(format!("{node} has no parameter `{key}`; {help}"))
    })
}

/// Asks for it; says what has become of it.
fn set(robot: &Robot, node: &str, key: &str, value: &str) -> Result<String, Failure> {
    let request = Request::Set { node: node.to_owned(), key: key.to_owned(), value: value.into() };
    let answer = Connection::open(&robot.namespace, &request)?.answer()?;
    let parameter = &answer["parameter"];
    let (former, value) = (shown(&parameter["former"]), shown(&parameter["value"]));
    Ok(wrapped(&format!(
        "{node}: {key} {former} -> {value}, until it starts anew; for good: --set \
         {node}.{key}={value}, or its file"
    )))
}

/// Refuses what is read only when the node starts, and says how it is changed all the same. In
/// lock-step nothing is changed, which the supervisor says.
fn check_tunable(robot: &Robot, node: &Node, parameter: &Parameter) -> Result<(), Failure> {
    if parameter.tunable.is_some() || robot.clock == Clock::Lockstep {
        return Ok(());
    }
    let (name, key) = (&node.name, &parameter.key);
    let why = if key.starts_with("deadman.") {
        "is what stops the robot, and cannot be changed while the node runs"
    } else {
        "is read when the node starts, and cannot be changed while it runs"
    };
    let file = match &parameter.from {
        From::Place(Place::Line { file, line, .. }) => {
            format!("{}:{line}", from_here(file).display())
        }
        From::Place(Place::Setting(_)) => {
            let how = "`--set` gave it: `teseo down`, and `teseo up` with another";
            return Err(Failure::Refused(format!("{name}: {key} {why}; {how}")));
        }
        From::Place(_) | From::Change => from_here(&robot.config()).display().to_string(),
    };
    // A node in its supervisor's process goes by what that one has read.
    let is_thread = node.json["pid"] == robot.json["supervisor"];
    let then = if is_thread {
        "`teseo down` and `teseo up`".to_owned()
    } else {
        format!("`teseo restart {name}`")
    };
    Err(Failure::Refused(format!("{name}: {key} {why}; write it to {file}, then {then}")))
}

/// A node was told what its files said when it started, and nobody knows that any more where they have
/// changed.
fn mention_newer_files(robot: &Robot, node: &Node, all: &[Parameter]) {
    let Some(uptime) = node.json["uptime_s"].as_f64() else { return };
    let uptime = Duration::try_from_secs_f64(uptime).unwrap_or_default();
    let mut files = vec![robot.config()];
    for parameter in all {
        if let From::Place(Place::Line { file, .. }) = &parameter.from
            && !files.contains(file)
        {
            files.push(file.clone());
        }
    }
    for file in files.iter().filter(|file| age(file).is_some_and(|age| age < uptime)) {
        mention(&format!(
            "{} was written after {} started, which goes by what it said before",
            from_here(file).display(),
            node.name
        ));
    }
}

fn age(file: &Path) -> Option<Duration> {
    let written = std::fs::metadata(file).ok()?.modified().ok()?;
    clock::wall().duration_since(written).ok()
}

impl Robot {
    fn config(&self) -> PathBuf {
        let given = Path::new(self.json["config"].as_str().unwrap_or_default());
        // As it is written is shorter, where that is the same file.
        let whole = Path::new(self.json["directory"].as_str().unwrap_or_default()).join(given);
        let here = std::env::current_dir().is_ok_and(|here| here.join(given) == whole);
        if here { given.to_owned() } else { whole }
    }

    fn sets(&self) -> Vec<String> {
        let sets = self.json["sets"].as_array().into_iter().flatten();
        sets.filter_map(|set| set.as_str().map(str::to_owned)).collect()
    }
}

impl Parameter {
    /// A row of the table; a file is told by its number in `files`, since no column is wide enough.
    fn cells<'a>(&'a self, files: &mut Vec<&'a Path>) -> Vec<String> {
        vec![
            self.key.clone(),
            self.measured(),
            match self.tunable.map(|tunable| &tunable.to) {
                // They are too long for a column; `param describe` has them.
                Some(Choice::Word(words)) => format!("{} words", words.len()),
                Some(to) => choice(to),
                None => "fixed".to_owned(),
            },
            if self.default == self.value { "same".to_owned() } else { shown(&self.default) },
            self.source(files),
        ]
    }

    fn described(&self, node: &str) -> String {
        let kind = match &self.value {
            Value::Bool(_) => "true or false",
            Value::Number(_) => "a number",
            Value::String(_) => "a word",
            _ => "more than one value, or none",
        };
        let may = match self.tunable {
            Some(tunable) => choice(&tunable.to),
            None => "nothing else while the node runs".to_owned(),
        };
        let place = match &self.from {
            From::Place(place) => place.to_string(),
            From::Change => "param set".to_owned(),
        };
        let (value, default) = (shown(&self.value), shown(&self.default));
        let unit = match unit(&self.key) {
            "-" => String::new(),
            unit => format!(" {unit}"),
        };
        format!(
            "{node} {}\nis        {kind}\nvalue     {value}{unit}\nmay be    {may}\n\
             default   {default}{unit}\nfrom      {place}",
            self.key
        )
    }

    /// The value with its unit.
    fn measured(&self) -> String {
        match unit(&self.key) {
            unit if unit != "-" && self.value.is_number() => {
                format!("{} {unit}", shown(&self.value))
            }
            _ => cut(&shown(&self.value), VALUE_WIDTH),
        }
    }

    fn source<'a>(&'a self, files: &mut Vec<&'a Path>) -> String {
        let mut number = |file: &'a Path| {
            let known = files.iter().position(|known| *known == file);
            1 + known.unwrap_or_else(|| {
                files.push(file);
                files.len() - 1
            })
        };
        match &self.from {
            From::Place(Place::Default) => "default".to_owned(),
            From::Place(Place::Setting(_)) => "--set".to_owned(),
            From::Place(Place::Line { file, line, .. }) => format!("[{}]:{line}", number(file)),
            From::Place(Place::File(file)) => format!("[{}]", number(file)),
            From::Change => "param set".to_owned(),
        }
    }

    fn json(&self) -> Value {
        let (mut range, mut words) = (None, None);
        match self.tunable.map(|tunable| &tunable.to) {
            Some(Choice::Number(numbers)) => range = Some([*numbers.start(), *numbers.end()]),
            Some(Choice::Word(allowed)) => words = Some(*allowed),
            Some(Choice::Switch) | None => {}
        }
        let place = match &self.from {
            From::Place(place) => place.to_string(),
            From::Change => "param set".to_owned(),
        };
        json!({
            "key": self.key,
            "value": self.value,
            "unit": unit(&self.key),
            "tunable": self.tunable.is_some(),
            "range": range,
            "words": words,
            "default": self.default,
            "from": place,
        })
    }
}

/// As it would be typed here.
fn from_here(file: &Path) -> &Path {
    let below = std::env::current_dir().ok().and_then(|here| file.strip_prefix(here).ok());
    below.unwrap_or(file)
}

/// What it may be changed to.
fn choice(choice: &Choice) -> String {
    match choice {
        Choice::Number(range) => format!("{}..{}", number(*range.start()), number(*range.end())),
        Choice::Word(words) => words.join(", "),
        Choice::Switch => "true, false".to_owned(),
    }
}

/// As it would be written, or a dash where there is nothing.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => "-".to_owned(),
        Value::String(text) => node::say::shown(text),
        Value::Number(value) => {
            value.as_f64().filter(|_| value.is_f64()).map_or_else(|| value.to_string(), number)
        }
        other => other.to_string(),
    }
}

/// The unit at the end of a key, the longest that there is.
fn unit(key: &str) -> &'static str {
    const UNITS: [(&str, &str); 13] = [
        ("_rad_s_m", "rad/(s m)"),
        ("_m_s2", "m/s^2"),
        ("_rad_s2", "rad/s^2"),
        ("_rad_s", "rad/s"),
        ("_rad_m", "rad/m"),
        ("_m_s", "m/s"),
        ("_1_s", "1/s"),
        ("_rad", "rad"),
        ("_ms", "ms"),
        ("_us", "us"),
        ("_hz", "Hz"),
        ("_m", "m"),
        ("_s", "s"),
    ];
    UNITS.iter().find(|(end, _)| key.ends_with(end)).map_or("-", |(_, unit)| unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_is_the_longest_end_of_the_key() {
        for (key, expected) in [
            ("wall_following.gain_proportional_rad_s_m", "rad/(s m)"),
            ("gain_derivative_rad_m", "rad/m"),
            ("speed_m_s", "m/s"),
            ("acceleration_m_s2", "m/s^2"),
            ("teleop_timeout_ms", "ms"),
            ("gain_heading_1_s", "1/s"),
            ("track_m", "m"),
            ("algorithm", "-"),
        ] {
            assert_eq!(unit(key), expected, "{key}");
        }
    }

    #[test]
    fn values_are_shown_as_they_would_be_written() {
        for (value, text) in [
            (json!(0.15), "0.15"),
            (json!(240), "240"),
            (json!(true), "true"),
            (json!("outer"), "outer"),
            (json!([1.5, 2.0]), "[1.5,2.0]"),
            (Value::Null, "-"),
        ] {
            assert_eq!(shown(&value), text);
        }
    }
}
