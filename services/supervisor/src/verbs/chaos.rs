//! `teseo chaos`: a robot of this command's own, with which things go wrong, all from one seed: its
//! topics lose, delay and damage samples, its nodes are killed and stopped.

mod robot;
mod schedule;
mod story;

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use interfaces::topics::MOTION_STATE;
use node::control::{self, Failure};
use node::launch::{Launch, Restart};
use node::{Error, Namespace, Settings, signal};
use serde_json::Value;

use node::say::say;
use robot::Robot;
use schedule::Rates;
use story::Struck;

/// [-] A node has to be killed on the way down where it was stopped in that moment.
const HAD_TO_KILL: u8 = 6;

/// Which robot, and what goes wrong with it.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  teseo chaos config/lab_robot.toml --seed 7 --for 60 \
                        --set simulator.stop_at_collision=false")]
pub struct ChaosOptions {
    /// The launch file, whose processes are started again when they die
    #[arg(value_name = "LAUNCH")]
    launch: PathBuf,

    /// What goes wrong and when
    #[arg(long, value_name = "NUMBER", default_value_t = 1)]
    seed: u64,

    /// For how long, from the moment at which the robot is ready
    #[arg(long = "for", value_name = "SECONDS", default_value_t = 60)]
    seconds: u64,

    /// How often a node is killed
    #[arg(long, value_name = "NUMBER", default_value_t = 6.0)]
    kills_per_minute: f64,

    /// How often a node is stopped, for 20 ms to 1.5 s
    #[arg(long, value_name = "NUMBER", default_value_t = 6.0)]
    stops_per_minute: f64,

    /// How strong the topics' faults are: 0 none, 1 mild
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    faults: f64,

    /// The robot's name [default: the launch file's]
    #[arg(long, value_name = "NAME", value_parser = control::robot_name)]
    robot: Option<String>,

    /// As `teseo up` would be given it
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
}

/// Exit code 0 where the robot was ready again after all of it, and nothing is left.
pub(super) fn chaos(options: &ChaosOptions) -> Result<u8, Failure> {
    signal::listen();
    let refused = |error: Error| Failure::Refused(error.to_string());
    let mut sets = vec!["clock=realtime".to_owned()];
    sets.extend(options.robot.iter().map(|name| format!("robot=\"{name}\"")));
    sets.extend(options.sets.iter().cloned());
    let settings = Settings::of_supervisor(&options.launch, &sets).map_err(refused)?;
    check_restarts(settings.launch())?;
    let namespace = settings.namespace().map_err(refused)?;
    let nodes: Vec<_> =
        settings.launch().process.iter().map(|process| process.name.clone()).collect();
    let length = Duration::from_secs(options.seconds);
    let rates = Rates {
        kills_per_minute: options.kills_per_minute,
        stops_per_minute: options.stops_per_minute,
    };
    let blows = schedule::blows(options.seed, length, rates, &nodes);

    // Once as it is, to learn what it publishes.
    let robot = Robot::up(&options.launch, &sets, &namespace)?;
    let topics = topics(&robot.status()?, &nodes);
    robot.down()?;
    let faults = schedule::faults(options.seed, options.faults, &topics);
    say(&format!("seed {}: {} blows, and faults of topics:", options.seed, blows.len()))?;
    for fault in &faults {
        say(&format!("  {fault}"))?;
    }

    let mut robot = Robot::up(&options.launch, &[sets, faults].concat(), &namespace)?;
    let struck = robot.endure(blows, length)?;
    // Whoever pressed Ctrl-C does not wait for a robot that was just struck.
    let late = if signal::stop_requests() == 0 { robot.await_ready().err() } else { None };
    let ended = robot.down();
    conclude(options.seed, &struck, late.as_ref(), ended, &namespace)
}

/// Of a node that stays down nothing can be learnt.
fn check_restarts(launch: &Launch) -> Result<(), Failure> {
    match launch.process.iter().find(|process| process.restart == Restart::Never) {
        None => Ok(()),
        Some(process) => Err(Failure::Refused(format!(
            "`{}` would not be started again: give it restart = \"on-failure\"",
            process.name
        ))),
    }
}

/// What the processes of the launch file publish, but for the word about whether the wheels stand,
/// which this command goes by.
fn topics(status: &Value, nodes: &[String]) -> Vec<(String, String)> {
    let mut topics = Vec::new();
    for node in status["nodes"].as_array().into_iter().flatten() {
        let name = node["name"].as_str().unwrap_or_default();
        for topic in node["topics"].as_array().into_iter().flatten() {
            let topic = topic["topic"].as_str().unwrap_or_default();
            if topic != MOTION_STATE.name && nodes.iter().any(|node| node == name) {
                topics.push((name.to_owned(), topic.to_owned()));
            }
        }
    }
    topics
}

/// Says whether everything held that has to.
fn conclude(
    seed: u64,
    struck: &[Struck],
    late: Option<&Failure>,
    ended: Result<u8, Failure>,
    namespace: &Namespace,
) -> Result<u8, Failure> {
    let mut broken: Vec<_> = late.into_iter().map(text).collect();
    match ended {
        Ok(0 | HAD_TO_KILL) => {}
        Ok(code) => broken.push(format!("it ended with {code}")),
        Err(failure) => broken.push(text(&failure)),
    }
    let files = namespace.shared_memory().files;
    if 0 < files || namespace.directory().exists() {
        let directory = namespace.directory().display();
        broken.push(format!("{files} files are left in /dev/shm, or {directory} is"));
    }
    say(&story::table(struck))?;
    let outcome = match broken.as_slice() {
        [] => "READY after them, nothing left".to_owned(),
        some => some.join("; "),
    };
    say(&format!("seed {seed}: {} blows: {outcome}", struck.len()))?;
    Ok(u8::from(!broken.is_empty()))
}

fn text(failure: &Failure) -> String {
    match failure {
        Failure::Unwanted => "it was not waited for".to_owned(),
        Failure::Refused(text)
        | Failure::Unclear(text)
        | Failure::NotRunning(text)
        | Failure::TooLong(text) => text.clone(),
    }
}
