//! What is said to the OpenCR board, and when: greet, stop, calibrate, then read, command and beat.
//!
//! Pure: time and bytes come in as arguments, bytes and events come out.

use std::fmt;
use std::time::Duration;

use interfaces::Stamp;
use node::deadman::Motion;

use crate::board_clock::{BoardClock, STANDSTILL_MAX, Told};
use crate::link::{Failure, Link, Request};
use crate::packet::{encode, instruction};
use crate::table::{
    ADDRESS_BLOCK, ADDRESS_COMMAND, ADDRESS_HEARTBEAT, ADDRESS_IMU_RECALIBRATION, ADDRESS_MODEL,
    ADDRESS_MODEL_NUMBER, ADDRESS_SOUND, ADDRESS_TORQUE, BLOCK, ID, MODEL_NUMBER, Reading, Words,
};

/// Between two heartbeats: four may be lost within the firmware's 500 ms.
pub const HEARTBEAT_PERIOD: Duration = Duration::from_millis(100);

/// A command that has not changed is said again: the firmware forgets it where its watchdog bit.
pub const COMMAND_PERIOD: Duration = Duration::from_millis(50);

/// The gyro takes up to 5 s, and the board says nothing meanwhile.
pub const CALIBRATION_MAX: Duration = Duration::from_secs(6);

/// [-] Transactions that fail in a row: then nobody is there. 150 ms, less than the dead-man waits.
pub const FAILURES_MAX: u32 = 3;

/// What the board shall do.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wish {
    /// How the wheels shall move the robot, in `base_link`; the board counts turns as we do.
    pub motion: Motion,
    /// Whether our own dead-man is fed. Only then the heart beats, so that the firmware stops the
    /// wheels by itself where we, or those who command us, do not.
    pub is_fed: bool,
}

/// What has come of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// It is a TurtleBot3's board.
    Greeted {
        /// [-] 1 is a Burger, 2 a Waffle, 3 a Waffle with an arm.
        model: u32,
        /// [-] Version of its firmware.
        firmware: u8,
    },
    /// It measures its gyro's bias, and says nothing for up to 5 s.
    Calibrating,
    /// It has, or at least says something again.
    Calibrated,
    /// It says how it is.
    Read(Reading, Told),
    /// Nobody can be talked to any more; [`Board::reset`] begins anew.
    Lost(Loss),
}

/// Why the board cannot be talked to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// Nothing comes.
    Silence,
    /// What comes is no answer, or not a whole one.
    Garbage,
    /// It answers, but gathers nothing new.
    Hung,
    /// It is a device of another model.
    WrongModel(u16),
    /// It refuses what it is asked, with this error.
    Refusal(u8),
}

impl fmt::Display for Loss {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silence => formatter.write_str(
                "no answer: is the board switched on, and is `board_port` its port and no other \
                 device's?",
            ),
            Self::Garbage => formatter.write_str(
                "what comes is no whole answer of the board: is `board_port` its port, is its cable \
                 sound, and does no other program use it?",
            ),
            Self::Hung => formatter.write_str("it answers, but its clock stands: reset the board"),
            Self::WrongModel(model) => write!(
                formatter,
                "model {model:#06x} is no TurtleBot3's board, which is {MODEL_NUMBER:#06x}: load \
                 the TurtleBot3 firmware"
            ),
            Self::Refusal(error) => {
                write!(formatter, "it refuses with error {error}: is its firmware a TurtleBot3's?")
            }
        }
    }
}

/// A melody of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Sound {
    /// None.
    Off = 0,
    /// As when it is switched on.
    On = 1,
    /// Of an empty battery.
    LowBattery = 2,
    /// Of something wrong.
    Error = 3,
    /// Of button 1.
    Button1 = 4,
    /// Of button 2.
    Button2 = 5,
}

/// How far one has come with the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Greeting,
    Identifying,
    Stopping,
    Calibrating,
    Running,
}

/// One's dealings with the board.
#[derive(Debug)]
pub struct Board {
    read_period: Duration,
    /// Whether the gyro is yet to be calibrated.
    calibrates: bool,
    link: Link,
    stage: Stage,
    clock: BoardClock,
    gathered: Stamp,
    failures: u32,
    heartbeat: u8,
    heartbeat_due: Stamp,
    command_due: Stamp,
    read_due: Stamp,
    asked: Words,
    told: Option<Words>,
    sound: Option<Sound>,
    torque: Option<bool>,
}

impl Board {
    /// Of which nothing is known yet.
    pub fn new(read_period: Duration, calibrates: bool) -> Self {
        Self {
            read_period,
            calibrates,
            link: Link::default(),
            stage: Stage::Greeting,
            clock: BoardClock::default(),
            gathered: Stamp::ZERO,
            failures: 0,
            heartbeat: 0,
            heartbeat_due: Stamp::ZERO,
            command_due: Stamp::ZERO,
            read_due: Stamp::ZERO,
            asked: Words::default(),
            told: None,
            sound: None,
            torque: None,
        }
    }

    /// The port was opened anew: everything is to be found out again. What was gathered before
    /// still counts for its clock.
    pub fn reset(&mut self) {
        self.link.reset();
        self.stage = Stage::Greeting;
        self.failures = 0;
        self.told = None;
        self.heartbeat_due = Stamp::ZERO;
        self.gathered = Stamp::ZERO;
    }

    /// What makes the board stop the wheels, whoever commanded it before and whether it can be
    /// heard or not.
    pub fn farewell(out: &mut Vec<u8>) {
        let nothing = Words::default().to_bytes();
        encode(ID, instruction::WRITE, &[&ADDRESS_COMMAND.to_le_bytes(), &nothing], out);
    }

    /// Takes in what has come from the port.
    pub fn hear(&mut self, bytes: &[u8]) {
        self.link.hear(bytes);
    }

    /// Plays a melody.
    pub fn play(&mut self, sound: Sound) {
        self.sound = Some(sound);
    }

    /// Lets the motors hold the wheels, or go.
    pub fn set_torque(&mut self, on: bool) {
        self.torque = Some(on);
    }

    /// Whether the board was told to stand, and has said that it heard, or cannot be told anything.
    pub fn stands(&self) -> bool {
        self.stage != Stage::Running || self.told.is_some_and(Words::is_zero)
    }

    /// What the board was told last, whether it has heard it or not.
    pub fn asked(&self) -> Words {
        self.asked
    }

    /// [-] Stretches of bytes so far that were no packet.
    pub fn garbage(&self) -> u64 {
        self.link.garbage()
    }

    /// When there is something to do, whatever comes.
    pub fn due(&self, wish: &Wish) -> Stamp {
        if let Some(due) = self.link.due() {
            return due;
        }
        if self.stage != Stage::Running {
            return Stamp::ZERO;
        }
        let heartbeat = wish.is_fed.then_some(self.heartbeat_due);
        self.read_due.min(self.command_due).min(heartbeat.unwrap_or(self.read_due))
    }

    /// The next thing that has come of it all; what is to be written to the port goes to `out`.
    /// To be called until it returns `None`.
    pub fn turn(&mut self, now: Stamp, wish: &Wish, out: &mut Vec<u8>) -> Option<Event> {
        loop {
            let ended = self.link.end(now).map(|ended| match ended.outcome {
                Ok(data) => (ended.request, parse(self.stage, &ended.request, data)),
                Err(failure) => (ended.request, Err(failure)),
            });
            let Some((request, outcome)) = ended else {
                if self.link.is_free() {
                    self.ask(now, wish, out);
                }
                return None;
            };
            let event = match outcome {
                Ok(answer) => {
                    self.failures = 0;
                    self.take(now, &request, &answer)
                }
                Err(failure) => self.fail(failure),
            };
            if event.is_some() {
                return event;
            }
        }
    }

    /// Takes an answer.
    fn take(&mut self, now: Stamp, request: &Request, answer: &Answer) -> Option<Event> {
        match answer {
            &Answer::ModelNumber(MODEL_NUMBER) => self.stage = Stage::Identifying,
            &Answer::ModelNumber(other) => return Some(Event::Lost(Loss::WrongModel(other))),
            &Answer::Model { model, firmware } => {
                self.stage = Stage::Stopping;
                return Some(Event::Greeted { model, firmware });
            }
            Answer::Written if self.stage == Stage::Stopping => {
                self.told = Some(Words::default());
                self.run(now);
                if self.calibrates {
                    self.stage = Stage::Calibrating;
                    return Some(Event::Calibrating);
                }
            }
            Answer::Written if self.stage == Stage::Calibrating => {
                self.run(now);
                return Some(Event::Calibrated);
            }
            Answer::Written => {
                if request.address == ADDRESS_COMMAND {
                    self.told = Some(self.asked);
                }
            }
            &Answer::Block(reading) => {
                let told = self.clock.read(reading.millis, now);
                match told {
                    Told::Same if STANDSTILL_MAX < now.since(self.gathered) => {
                        return Some(Event::Lost(Loss::Hung));
                    }
                    Told::Same => return None,
                    Told::New(_) | Told::Restarted(_) => self.gathered = now,
                }
                return Some(Event::Read(reading, told));
            }
        }
        None
    }

    fn run(&mut self, now: Stamp) {
        self.calibrates &= self.stage != Stage::Calibrating;
        self.stage = Stage::Running;
        self.gathered = now;
        self.read_due = now;
        self.command_due = now;
    }

    fn fail(&mut self, failure: Failure) -> Option<Event> {
        if self.stage == Stage::Calibrating && failure == Failure::TimedOut {
            // Some firmware forgets to answer; the next question will show.
            self.run(Stamp::ZERO);
            return Some(Event::Calibrated);
        }
        self.told = None;
        self.failures += 1;
        if self.failures < FAILURES_MAX {
            return None;
        }
        Some(Event::Lost(match failure {
            Failure::Refused(error) => Loss::Refusal(error),
            Failure::WrongLength | Failure::Broken => Loss::Garbage,
            Failure::TimedOut => Loss::Silence,
        }))
    }

    /// Begins the next transaction, if it is time for one.
    fn ask(&mut self, now: Stamp, wish: &Wish, out: &mut Vec<u8>) {
        match self.stage {
            Stage::Greeting => self.link.read(now, ADDRESS_MODEL_NUMBER, 2, out),
            Stage::Identifying => self.link.read(now, ADDRESS_MODEL, 5, out),
            Stage::Stopping => {
                self.asked = Words::default();
                self.link.write(now, ADDRESS_COMMAND, &self.asked.to_bytes(), out);
            }
            Stage::Calibrating => {
                let address = ADDRESS_IMU_RECALIBRATION;
                self.link.write_within(now, CALIBRATION_MAX, address, &[1], out);
            }
            Stage::Running => self.ask_running(now, wish, out),
        }
    }

    fn ask_running(&mut self, now: Stamp, wish: &Wish, out: &mut Vec<u8>) {
        let words = Words::nearest(wish.motion);
        let is_overdue = self.read_due.after(self.read_period) <= now;
        let commands = self.told != Some(words) || self.command_due <= now;
        // The heart first: a command that the firmware hears while it believes us dead is undone.
        if wish.is_fed && self.heartbeat_due <= now {
            self.heartbeat_due = now.after(HEARTBEAT_PERIOD);
            self.heartbeat = self.heartbeat.wrapping_add(1);
            self.link.write(now, ADDRESS_HEARTBEAT, &[self.heartbeat], out);
        } else if commands && !is_overdue {
            self.command_due = now.after(COMMAND_PERIOD);
            self.asked = words;
            self.link.write(now, ADDRESS_COMMAND, &words.to_bytes(), out);
        } else if let Some(on) = self.torque.take() {
            self.link.write(now, ADDRESS_TORQUE, &[u8::from(on)], out);
        } else if let Some(sound) = self.sound.take() {
            self.link.write(now, ADDRESS_SOUND, &[sound as u8], out);
        } else if self.read_due <= now {
            self.read_due = self.read_due.after(self.read_period).max(now);
            let length = u16::try_from(BLOCK).unwrap_or_default();
            self.link.read(now, ADDRESS_BLOCK, length, out);
        }
    }
}

/// What an answer says.
enum Answer {
    ModelNumber(u16),
    Model { model: u32, firmware: u8 },
    Block(Reading),
    Written,
}

fn parse(stage: Stage, request: &Request, data: &[u8]) -> Result<Answer, Failure> {
    match (stage, data) {
        (Stage::Greeting, &[low, high]) => Ok(Answer::ModelNumber(u16::from_le_bytes([low, high]))),
        (Stage::Identifying, &[a, b, c, d, firmware]) => {
            Ok(Answer::Model { model: u32::from_le_bytes([a, b, c, d]), firmware })
        }
        (Stage::Stopping | Stage::Calibrating | Stage::Running, &[]) => Ok(Answer::Written),
        (Stage::Running, data) if request.address == ADDRESS_BLOCK => {
            let block = data.try_into().map_err(|_| Failure::WrongLength)?;
            Ok(Answer::Block(Reading::parse(block)))
        }
        _ => Err(Failure::WrongLength),
    }
}

#[cfg(test)]
mod tests;
