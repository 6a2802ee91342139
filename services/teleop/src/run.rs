//! The process: a guest in a robot's shared memory, with a person at its keyboard.

use std::time::Duration;

use interfaces::topics::{MOTION_STATE, TELEOP_COMMAND};
use interfaces::{MotionState, Stamp, VelocityCommand};
use node::deadman::Motion;
use node::hand::{Hand, Key};
use node::{Error, Namespace, Publisher, Result, Session, Subscriber, clock, signal};

use crate::line::{line, may_move};
use crate::terminal::{Come, Keyboard, Screen};
use crate::{Keys, Options};

/// Between two commands while a person drives: three may be late before the wheels stop.
const PERIOD: Duration = Duration::from_millis(50);

/// Drives `robot` by hand until the person has had enough.
pub fn run(robot: &Namespace, options: &Options) -> Result {
    signal::listen();
    let session = Session::guest(robot, "teleop")?;
    let commands = session.publisher(&TELEOP_COMMAND)?;
    if commands.readers() == 0 {
        return Err(deaf(robot));
    }
    let states = session.quiet_subscriber(&MOTION_STATE)?;
    // The last to be opened: what is refused before leaves the terminal alone.
    let screen = Screen::new();
    let keyboard = Keyboard::open()?;
    let hand = Hand::new(options.fastest(), options.patience());
    let mut cockpit = Cockpit { robot, commands, states, state: None, screen, keyboard, hand };
    cockpit.screen.say(&instructions(robot, options));
    match cockpit.drive()? {
        End::Wanted => cockpit.rest(),
        // Who is lost does not let go: without another word the wheels stop, and stay so.
        End::Lost => Ok(()),
    }
}

fn deaf(robot: &Namespace) -> Error {
    let robot = robot.robot();
    Error::Fault(format!(
        "robot '{robot}' has no multiplexer, so nobody would hear a person; have one between the \
         controller and the wheels, as config/teleop.toml does"
    ))
}

fn instructions(robot: &Namespace, options: &Options) -> String {
    let robot = robot.robot();
    let patience = options.patience().map_or_else(
        || "Speeds stay until another key is pressed.".to_owned(),
        |patience| {
            let seconds = patience.as_secs();
            format!(
                "Hold a key: without any for {seconds} s the robot stops; `e` keeps its speeds."
            )
        },
    );
    format!(
        "Driving {robot} by hand, over its autonomy:\n  \
           w, up    faster           x, down   slower, then backwards\n  \
           a, left  further left     d, right  further right\n  \
           s, space stop             q, Ctrl-C stop, and give the robot back\n\
         {patience}"
    )
}

/// Why nobody drives any more.
enum End {
    /// The person, or whoever sent a signal, wants it.
    Wanted,
    /// The terminal is gone, and the person with it.
    Lost,
}

/// Where a person sits.
struct Cockpit<'a> {
    robot: &'a Namespace,
    commands: Publisher<VelocityCommand>,
    states: Subscriber<MotionState>,
    state: Option<MotionState>,
    screen: Screen,
    keyboard: Keyboard,
    hand: Hand,
}

impl Cockpit<'_> {
    fn drive(&mut self) -> Result<End> {
        let mut keys = Keys::default();
        loop {
            self.turn(clock::now())?;
            let bytes = match self.keyboard.wait(PERIOD) {
                Come::Bytes(bytes) => bytes,
                Come::Gone => return Ok(End::Lost),
            };
            let now = clock::now();
            for key in bytes.into_iter().filter_map(|byte| keys.read(byte)) {
                if key == Key::Quit {
                    return Ok(End::Wanted);
                }
                self.hand.press(now, key);
            }
            if 0 < signal::stop_requests() {
                return Ok(End::Wanted);
            }
        }
    }

    /// One command, where the person drives, and one look at the robot.
    fn turn(&mut self, now: Stamp) -> Result {
        if !self.robot.lock().exists() {
            return Err(Error::Fault(format!("robot '{}' went away", self.robot.robot())));
        }
        if let Some(state) = self.states.latest()? {
            self.state = Some(*state);
        }
        let state = self.state.as_ref();
        let motion = self.hand.motion(now, may_move(state));
        let is_heard = 0 < self.commands.readers();
        self.screen.show(&line(self.robot.robot(), motion, state, is_heard));
        motion.map_or(Ok(()), |motion| self.command(now, motion))
    }

    /// Asks for rest, so that nobody has to find out by silence.
    fn rest(&mut self) -> Result {
        if self.hand.drives() { self.command(clock::now(), Motion::ZERO) } else { Ok(()) }
    }

    fn command(&mut self, now: Stamp, motion: Motion) -> Result {
        self.commands.send_with(|command| {
            // A person sees the robot as it is now.
            command.header.stamp = now;
            command.linear = motion.linear;
            command.angular = motion.angular;
        })
    }
}
