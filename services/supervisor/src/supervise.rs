//! The supervisor: configures all nodes in order, activates all in order, stops them in reverse.

use std::time::Duration;

use interfaces::topics::{
    JOINT_STATES, ODOMETRY, POSE, ROBOT_POSE, SCAN, SENSOR_PAIR, VELOCITY_COMMAND,
};
use interfaces::{Outcome, Stamp, State, Transition};
use node::{Error, Held, Result, Session, Settings, clock, signal};
use rustix::process::Signal;

use crate::member::Member;
use crate::report::{self, Report};
use crate::screen::{self, Screen};
use crate::{Options, pairing};

/// The node that pairs scan and odometry lives in the supervisor's process, in a loop of its own.
const PAIRING: &str = "pairing";

/// Between two looks at the nodes while one is awaited.
const POLL_AWAITING: Duration = Duration::from_micros(500);

/// Between two looks at the nodes while all is well: nothing in the loop of the robot waits for it.
const POLL: Duration = Duration::from_millis(10);

/// How long a process may take until it is unconfigured.
const START_TIMEOUT: Duration = Duration::from_secs(10);

/// How long a transition may take.
const TRANSITION_TIMEOUT: Duration = Duration::from_secs(5);

/// How long a process may take to end once it was asked to, before it is killed.
const STOP_TIMEOUT: Duration = Duration::from_secs(2);

/// Why a run ended.
#[derive(Debug)]
pub(crate) enum Ending {
    /// A node said that it was done.
    Done(String),
    /// A node said that it had failed.
    Failed(String),
    /// Somebody asked for it.
    Asked,
    /// A node did not come up.
    NotStarted {
        /// The node.
        name: String,
        /// What happened.
        what: String,
        /// [-] Its exit code, if it had one.
        code: Option<i32>,
    },
    /// A node ended by itself.
    Died {
        /// The node.
        name: String,
        /// What happened.
        what: String,
    },
    /// The supervisor itself could not go on.
    Broken(Error),
}

impl Ending {
    /// [-] The exit code of the run.
    pub(crate) fn code(&self) -> u8 {
        match self {
            Self::Done(_) | Self::Asked => 0,
            Self::Failed(_) => 1,
            Self::Died { .. } => 3,
            Self::NotStarted { code: Some(78), .. } => 78,
            Self::NotStarted { .. } => 4,
            Self::Broken(error) => error.exit_code(),
        }
    }

    /// What happened, in one line.
    pub(crate) fn cause(&self) -> String {
        match self {
            Self::Done(why) | Self::Failed(why) => why.clone(),
            Self::Asked => "asked to stop".to_owned(),
            Self::NotStarted { name, what, .. } => format!("{name} did not come up: {what}"),
            Self::Died { name, what } => format!("{name} {what}"),
            Self::Broken(error) => error.to_string(),
        }
    }
}

impl From<Error> for Ending {
    fn from(error: Error) -> Self {
        Self::Broken(error)
    }
}

/// A step on the way up, or why the run ends here.
type Step<T = ()> = std::result::Result<T, Ending>;

/// Runs the robot of `options` until it is done; returns the exit code.
pub(crate) fn supervise(options: &Options) -> Result<u8> {
    signal::listen();
    node::die_with_parent(Signal::TERM);
    let settings = Settings::of_supervisor(&options.config, &options.sets())?;
    options.report.as_deref().map_or(Ok(()), report::check_writable)?;
    let mut supervisor = Supervisor::new(&settings)?;
    let ending = match supervisor.bring_up(options) {
        Ok(()) => supervisor.watch(),
        Err(ending) => ending,
    };
    supervisor.wind_down()?;
    let wall = supervisor.wall();
    supervisor.screen.clear();
    let report = Report::new(&settings, options, &supervisor.members, wall, &ending);
    if supervisor.activated.is_some() {
        screen::report(&report.text());
    } else {
        screen::report(&format!("{}\n", ending.cause()));
    }
    if let Some(path) = &options.report {
        report.write(path)?;
    }
    Ok(report.code())
}

struct Supervisor<'a> {
    settings: &'a Settings,
    session: Session,
    members: Vec<Member>,
    screen: Screen,
    activated: Option<Stamp>,
    stopped: Option<Stamp>,
    /// Held open by the process that outlives the others, so that a restart finds its topics.
    _topics: Vec<Held>,
}

impl<'a> Supervisor<'a> {
    fn new(settings: &'a Settings) -> Result<Self> {
        let session = Session::join(&settings.namespace()?, settings.name(), settings.epoch())?
            .with_clock(settings.clock());
        let own = settings.name();
        let topics = vec![
            session.hold(&JOINT_STATES, own)?,
            session.hold(&ROBOT_POSE, own)?,
            session.hold(&SCAN, own)?,
            session.hold(&ODOMETRY, own)?,
            session.hold(&SENSOR_PAIR, own)?,
            session.hold(&VELOCITY_COMMAND, own)?,
            session.hold(&POSE, own)?,
        ];
        Ok(Self {
            settings,
            session,
            members: Vec::new(),
            screen: Screen::new(clock::now()),
            activated: None,
            stopped: None,
            _topics: topics,
        })
    }

    /// Starts all, configures all in order, activates all in order.
    fn bring_up(&mut self, options: &Options) -> Step {
        self.start_all(options)?;
        for index in 0..self.members.len() {
            self.reach(index, State::Unconfigured, START_TIMEOUT)?;
        }
        for index in 0..self.members.len() {
            self.members[index].request(Transition::Configure)?;
            self.reach(index, State::Inactive, TRANSITION_TIMEOUT)?;
        }
        self.activated = Some(clock::now());
        for index in 0..self.members.len() {
            self.members[index].request(Transition::Activate)?;
            self.reach(index, State::Active, TRANSITION_TIMEOUT)?;
        }
        Ok(())
    }

    /// The pairing first: whoever feeds it finds it there.
    fn start_all(&mut self, options: &Options) -> Step {
        let settings = self.settings;
        let pairing = Member::spawn_thread(&self.session, settings, PAIRING, pairing::run)?;
        self.members.push(pairing);
        for process in &settings.launch().process {
            let arguments = arguments(options, &process.name);
            let member = Member::spawn(&self.session, settings, &process.name, &arguments)
                .map_err(|error| not_started(&process.name, error.to_string(), None))?;
            self.members.push(member);
        }
        Ok(())
    }

    /// Waits until the node has come to `goal`.
    fn reach(&mut self, index: usize, goal: State, timeout: Duration) -> Step {
        let begun = clock::now();
        loop {
            let reason = self.poll()?;
            if let Some((failed, reason)) = reason
                && failed == index
            {
                let code = self.exit_code(index);
                return Err(not_started(&self.members[index].name, reason, code));
            }
            let member = &self.members[index];
            if member.state == goal {
                return Ok(());
            }
            if let Some(ended) = member.ended() {
                return Err(not_started(&member.name, ended.what.clone(), ended.code));
            }
            if 0 < signal::stop_requests() {
                return Err(Ending::Asked);
            }
            if timeout < clock::now().since(begun) {
                let what = format!("still {} after {} s", member.state, timeout.as_secs());
                return Err(not_started(&member.name, what, None));
            }
            clock::nap(POLL_AWAITING);
        }
    }

    /// The exit code of a node that has just said why it gives up.
    fn exit_code(&mut self, index: usize) -> Option<i32> {
        let begun = clock::now();
        while clock::now().since(begun) < STOP_TIMEOUT {
            if self.poll().is_err() || self.members[index].ended().is_some() {
                break;
            }
            clock::nap(POLL_AWAITING);
        }
        self.members[index].ended().and_then(|ended| ended.code)
    }

    /// Watches the run until it ends.
    fn watch(&mut self) -> Ending {
        loop {
            if let Err(error) = self.poll() {
                return Ending::Broken(error);
            }
            for member in &self.members {
                if let Some(ended) = member.ended() {
                    let reason = &member.reason;
                    let colon = if reason.is_empty() { "" } else { ": " };
                    let what = format!("{}{colon}{reason}", ended.what);
                    return Ending::Died { name: member.name.clone(), what };
                }
                match Outcome::try_from(member.status.outcome).unwrap_or(Outcome::Working) {
                    Outcome::Working => {}
                    Outcome::Done => return Ending::Done(member.status.text.to_string()),
                    Outcome::Failed => return Ending::Failed(member.status.text.to_string()),
                }
            }
            if 0 < signal::stop_requests() {
                return Ending::Asked;
            }
            let wall = self.wall();
            self.screen.live(clock::now(), wall, &self.members);
            clock::nap(POLL);
        }
    }

    /// Deactivates all in reverse order, then ends all in reverse order.
    fn wind_down(&mut self) -> Result {
        self.stopped = Some(clock::now());
        for index in (0..self.members.len()).rev() {
            if self.members[index].state == State::Active {
                self.members[index].request(Transition::Deactivate)?;
                self.await_until(index, |member| member.state == State::Inactive)?;
            }
        }
        for member in &mut self.members {
            member.measure_memory();
        }
        for index in (0..self.members.len()).rev() {
            self.end(index)?;
        }
        Ok(())
    }

    /// Asks the node to end, then tells it to, then ends it.
    fn end(&mut self, index: usize) -> Result {
        let has_ended = |member: &Member| member.ended().is_some();
        if let Some(shutdown) = Transition::shutdown_from(self.members[index].state) {
            self.members[index].request(shutdown)?;
        } else {
            self.members[index].signal(Signal::TERM);
        }
        if self.await_until(index, has_ended)? {
            return Ok(());
        }
        self.members[index].signal(Signal::TERM);
        if self.await_until(index, has_ended)? {
            return Ok(());
        }
        let name = &self.members[index].name;
        tracing::warn!(node = name, "did not end when asked to: killed");
        self.members[index].signal(Signal::KILL);
        self.await_until(index, has_ended)?;
        Ok(())
    }

    /// Waits, but not for ever, until `reached` holds for the node or it has ended.
    fn await_until(&mut self, index: usize, reached: impl Fn(&Member) -> bool) -> Result<bool> {
        let begun = clock::now();
        loop {
            self.poll()?;
            let member = &self.members[index];
            if reached(member) || member.ended().is_some() {
                return Ok(true);
            }
            if STOP_TIMEOUT < clock::now().since(begun) {
                return Ok(false);
            }
            clock::nap(POLL_AWAITING);
        }
    }

    /// Takes in what all nodes have said; returns which one, if any, has given a reason for a
    /// change that nobody asked for.
    fn poll(&mut self) -> Result<Option<(usize, String)>> {
        let mut complaint = None;
        for (index, member) in self.members.iter_mut().enumerate() {
            while let Some(change) = member.poll()? {
                self.screen.change(clock::now(), &member.name, &change);
                if !change.reason.is_empty() {
                    complaint.get_or_insert((index, change.reason));
                }
            }
        }
        Ok(complaint)
    }

    /// How long the nodes have been active.
    fn wall(&self) -> Duration {
        let Some(activated) = self.activated else { return Duration::ZERO };
        self.stopped.unwrap_or_else(clock::now).since(activated)
    }
}

fn not_started(name: &str, what: String, code: Option<i32>) -> Ending {
    Ending::NotStarted { name: name.to_owned(), what, code }
}

/// The command line of a node of this robot.
fn arguments(options: &Options, name: &str) -> Vec<String> {
    let log = options.log;
    let mut arguments = vec![
        format!("--config={}", options.config.display()),
        format!("--name={name}"),
        format!("--log-format={}", log.format.label()),
        format!("--log-level={}", log.level),
    ];
    arguments.extend(options.sets().into_iter().map(|set| format!("--set={set}")));
    arguments
}
