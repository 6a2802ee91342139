//! The wires of a dead-man: what every node that drives wheels hears, asks and tells.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::Duration;

use interfaces::topics::{MOTION_REQUEST, MOTION_STATE, VELOCITY_COMMAND};
use interfaces::{MotionRequest, MotionState, Stamp, VelocityCommand};

use crate::deadman::{Config, DeadMan, Motion, Rejection};
use crate::{EmergencyStop, Gauge, Node, Publisher, Refusals, Result, Sample, Subscriber};

/// The emergency stop is looked for this often: a fifth of what a stop may take.
const LATCH_PERIOD: Duration = Duration::from_millis(10);

/// The file in the robot's directory that is there while a person has to arm it.
const UNARMED: &str = "unarmed";

/// A command, and what the dead-man says to it.
pub type Heard = (Sample<VelocityCommand>, std::result::Result<(), Rejection>);

/// What stands between commands and wheels.
#[derive(Debug)]
pub struct Wheels {
    config: Config,
    dead_man: DeadMan,
    has_drive: bool,
    commands: Subscriber<VelocityCommand>,
    requests: Subscriber<MotionRequest>,
    state: Publisher<MotionState>,
    told: u64,
    /// Whether whoever started this node is yet to be woken for what was told.
    has_news: bool,
    latch: EmergencyStop,
    latch_due: Stamp,
    /// Where the next life of this node finds that a person has to arm the robot.
    unarmed: PathBuf,
    needs_person: bool,
    refusals: Refusals,
    trips: Gauge,
}

impl Wheels {
    /// Opens the topics of a robot at rest.
    pub fn new(node: &mut Node<'_>, config: &Config) -> Result<Self> {
        let namespace = node.settings().namespace()?;
        let unarmed = namespace.directory().join(UNARMED);
        Ok(Self {
            config: *config,
            dead_man: dead_man(config, &unarmed),
            needs_person: unarmed.exists(),
            unarmed,
            has_drive: true,
            commands: node.subscribe(&VELOCITY_COMMAND)?,
            requests: node.subscribe(&MOTION_REQUEST)?,
            state: node.publish_on_event(&MOTION_STATE)?,
            told: 0,
            has_news: false,
            latch: EmergencyStop::of(&namespace),
            latch_due: Stamp::ZERO,
            refusals: Refusals::new(node, "rejected", Rejection::ALL.map(Rejection::key)),
            trips: node.gauge("dead_man_trips"),
        })
    }

    /// The node was activated: of what was before nothing counts but that a person has to arm the robot.
    pub fn restart(&mut self) {
        self.dead_man = dead_man(&self.config, &self.unarmed);
        self.dead_man.set_drive(Stamp::ZERO, self.has_drive);
        self.told = 0;
    }

    /// Looks at everything that may forbid motion or allow it again. `now` is the machine's time,
    /// `time` the robot's: the same, but in lock-step.
    pub fn attend(&mut self, node: &mut Node<'_>, now: Stamp, time: Stamp) -> Result {
        if self.latch_due <= now {
            self.latch_due = now.after(LATCH_PERIOD);
            self.dead_man.set_emergency_stop(time, self.latch.is_latched());
        }
        while let Some(request) = self.requests.receive()? {
            if request.arm == 1 {
                self.dead_man.arm(time);
            }
        }
        if node.has_lost_supervisor() {
            self.dead_man.lose_supervisor(time);
        } else if node.leaving()? {
            self.dead_man.pause(time);
        }
        // A trip is told before a command that came too late for it, and would hide the silence.
        self.dead_man.motion(time);
        self.tell(time)?;
        if std::mem::take(&mut self.has_news) {
            node.hint("MOTION");
        }
        self.state.greet()
    }

    /// The next command that was received, as the dead-man takes it.
    pub fn hear(&mut self, time: Stamp) -> Result<Option<Heard>> {
        let Some(command) = self.commands.receive()? else { return Ok(None) };
        let verdict = self.dead_man.hear(time, &command);
        match verdict {
            Ok(()) => self.refusals.accept(),
            Err(reason) => self.refusals.refuse(reason as usize),
        };
        self.tell(time)?;
        Ok(Some((command, verdict)))
    }

    /// What the wheels shall do at `time`.
    pub fn motion(&mut self, time: Stamp) -> Result<Motion> {
        let motion = self.dead_man.motion(time);
        self.tell(time)?;
        Ok(motion)
    }

    /// Says whether the wheels can be reached; where nothing is said, they can.
    pub fn set_drive(&mut self, time: Stamp, is_there: bool) -> Result {
        self.has_drive = is_there;
        self.dead_man.set_drive(time, is_there);
        self.tell(time)
    }

    /// Whether commands move the robot, and the last one is not too old.
    pub fn is_fed(&self, time: Stamp) -> bool {
        self.dead_man.is_fed(time)
    }

    /// Whether the wheels are held at zero.
    pub fn is_at_rest(&self, time: Stamp) -> bool {
        self.dead_man.is_at_rest(time)
    }

    /// The moment at which the dead-man trips unless a valid command comes before: whoever drives the
    /// wheels is awake then.
    pub fn due(&self) -> Option<Stamp> {
        self.dead_man.due()
    }

    fn tell(&mut self, time: Stamp) -> Result {
        let changes = self.dead_man.changes();
        if changes == self.told {
            return Ok(());
        }
        self.told = changes;
        self.has_news = true;
        self.trips.set(self.dead_man.trips() as f64);
        let dead_man = &self.dead_man;
        let mut needs_person = false;
        self.state.send_with(|state| {
            state.header.stamp = time;
            dead_man.describe(time, state);
            needs_person = state.needs_person == 1;
        })?;
        self.remember(needs_person);
        Ok(())
    }

    /// Tells the next life of this node whether a person has to arm the robot.
    fn remember(&mut self, needs_person: bool) {
        if std::mem::replace(&mut self.needs_person, needs_person) == needs_person {
            return;
        }
        let path = &self.unarmed;
        let outcome =
            if needs_person { File::create(path).map(drop) } else { fs::remove_file(path) };
        if let Err(cause) = outcome {
            tracing::warn!(%cause, path = %path.display(), "whether a person has to arm it is lost");
        }
    }
}

/// Of a robot at rest, which a person has to arm where one had to before.
fn dead_man(config: &Config, unarmed: &Path) -> DeadMan {
    DeadMan::new(&Config { start_armed: config.start_armed && !unarmed.exists(), ..*config })
}
