//! The process: commands to the board, measurements of board and LiDAR to the robot's topics.

mod desk;
mod eye;
mod told;

use std::time::Duration;

use interfaces::{Outcome, Stamp};
use node::{Latency, Node, Result, Settings, Wheels};

use crate::board::Wish;
use crate::config::PositiveTurn;
use crate::table::{FIRMWARE_ANGULAR_MAX, FIRMWARE_LINEAR_MAX, Words};
use crate::{Config, TUNABLES};
use desk::BoardDesk;
use eye::LidarDesk;

/// [byte] More than comes between two turns.
const PIECE: usize = 1024;

/// Runs the bridge as a managed node.
pub fn run(node: &mut Node<'_>) -> Result {
    let config: Config = load(node.settings())?;
    let mut bridge = Bridge::new(node, &config)?;
    node.set_period(config.read_period());
    let mut tuning = node.tuning(config, &TUNABLES)?;
    let mut over = None;
    while let Some(tick) = node.tick()? {
        if tick.activated {
            bridge.restart();
            over = node.settings().launch().for_s.map(|limit| after(tick.now, limit));
        }
        if over.is_some_and(|over| over <= tick.now) {
            over = None;
            node.finish(Outcome::Done, "the time is over")?;
        }
        if let Some(config) = tuning.take(node)? {
            bridge.lidar.retune(config);
        }
        bridge.wheels.attend(node, tick.now, tick.now)?;
        while let Some((command, verdict)) = bridge.wheels.hear(tick.now)? {
            if verdict.is_ok() {
                bridge.age.record(tick.now.since(command.header.stamp));
                bridge.heard.get_or_insert(tick.now);
            }
        }
        bridge.drive(node, tick.now)?;
        bridge.lidar.turn(node, tick.now)?;
        node.wake_by(bridge.due());
        // Whoever lets go of the wheels stops them first.
        if bridge.wheels.is_at_rest(tick.now) && bridge.board.stands() {
            node.release();
        } else {
            node.hold();
        }
    }
    Ok(())
}

fn after(now: Stamp, seconds: f64) -> Stamp {
    now.after(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX))
}

/// Says what is wrong with the parameters, without opening anything.
pub fn check(settings: &Settings) -> Result {
    load(settings).map(drop)
}

fn load(settings: &Settings) -> Result<Config> {
    if settings.clock() == node::Clock::Lockstep {
        let message = "a real robot waits for nobody";
        let help = "write clock = \"realtime\"";
        let place = node::config::Place::Default;
        return Err(node::config::Error::new(place, "clock", message, help).into());
    }
    settings.parameters()
}

/// The robot with its wires.
struct Bridge {
    turn_sign: f64,
    wheels: Wheels,
    board: BoardDesk,
    lidar: LidarDesk,
    /// Since when a command is under way to the board.
    heard: Option<Stamp>,
    wish: Wish,
    age: Latency,
    way: Latency,
    limited: node::Gauge,
}

impl Bridge {
    fn new(node: &mut Node<'_>, config: &Config) -> Result<Self> {
        let wheels = Wheels::new(node, &config.deadman)?;
        Ok(Self {
            turn_sign: match config.positive_turn {
                PositiveTurn::Counterclockwise => 1.0,
                PositiveTurn::Clockwise => -1.0,
            },
            wheels,
            board: BoardDesk::new(node, config)?,
            lidar: LidarDesk::new(node, config)?,
            heard: None,
            wish: Wish::default(),
            age: node.latency_by_steps("scan_to_command"),
            way: node.latency("command_to_bytes"),
            limited: node.gauge("commands_limited"),
        })
    }

    /// What came while nobody listened is too old.
    fn restart(&mut self) {
        self.wheels.restart();
        self.board.restart();
        self.lidar.restart();
        self.heard = None;
    }

    /// Tells the board what the dead-man lets pass, and the topics what the board says.
    fn drive(&mut self, node: &mut Node<'_>, now: Stamp) -> Result {
        self.board.listen(node, now)?;
        self.wheels.set_drive(now, self.board.has_drive())?;
        let mut motion = self.wheels.motion(now)?;
        if FIRMWARE_LINEAR_MAX < motion.linear.abs() || FIRMWARE_ANGULAR_MAX < motion.angular.abs()
        {
            self.limited.count();
        }
        motion.angular *= self.turn_sign;
        self.wish = Wish { motion, is_fed: self.wheels.is_fed(now) };
        self.board.turn(node, now, &self.wish)?;
        if self.board.asked() == Words::nearest(motion)
            && let Some(heard) = self.heard.take()
        {
            self.way.record(node::clock::now().since(heard));
        }
        // What the board has just said may have changed everything.
        self.wheels.set_drive(now, self.board.has_drive())
    }

    fn due(&self) -> Option<Stamp> {
        let moments = [self.wheels.due(), self.board.due(&self.wish), self.lidar.due()];
        moments.into_iter().flatten().min()
    }
}
