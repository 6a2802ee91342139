//! The process: the firmware's loop, the LiDAR's packets and the world's steps, by the clock.

use std::fs::File;
use std::io::Write;
use std::os::fd::{AsFd, BorrowedFd};
use std::path::PathBuf;
use std::time::Duration;

use interfaces::Stamp;
use node::{Error, Result, clock, signal};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::FlockOperation;

use crate::console::{HELP, Order, Place};
use crate::firmware::{Body, Firmware};
use crate::lds01::{self, Lds01};
use crate::lds02::{self, Lds02};
use crate::line::Line;
use crate::{Lidar, Options, STEP, World};

/// What a busy machine has held up for longer is not caught up with.
const LATE_MAX: Duration = Duration::from_millis(100);

/// [V] Of a battery that is full.
const VOLTAGE: f64 = 12.0;

/// Plays the robot in `world` until the world has an end, or somebody asks for one.
pub fn run(options: &Options, world: &mut dyn World) -> Result {
    signal::listen();
    let began = clock::now();
    let mut robot = Robot::new(options, began)?;
    say(began, &format!("ready: {}", robot.name));
    loop {
        let now = clock::now();
        robot.turn(now, world);
        if 0 < signal::stop_requests() {
            say(now, &world.summary());
            return Ok(());
        }
        if let Some(ending) = world.ending() {
            say(now, &world.summary());
            return ending.map(|why| say(now, &why)).map_err(Error::Fault);
        }
        if let Some(limit) = options.for_s.filter(|limit| *limit < now.since(began).as_secs_f64()) {
            say(now, &world.summary());
            let late = |missed| Err(Error::Fault(format!("{limit} s are over, no {missed}")));
            return world.awaited().map_or(Ok(()), late);
        }
        robot.wait(now);
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        self.board.unplug();
        self.lidar.unplug();
        // Unless somebody has put something into it.
        let _ = self.directory.take().map(std::fs::remove_dir);
    }
}

/// Says when, on the clock of everybody's stamps, and what.
fn say(now: Stamp, what: &str) {
    let mut out = std::io::stdout().lock();
    // Whoever closed it does not want to know.
    let _ = writeln!(out, "{:.6} {what}", now.seconds()).and_then(|()| out.flush());
}

/// Either LiDAR.
enum Sensor {
    Lds01(Lds01),
    Lds02(Lds02),
}

/// The robot with its lines.
struct Robot {
    name: String,
    firmware: Firmware,
    body: Body,
    board: Line,
    sensor: Sensor,
    lidar: Line,
    step_due: Stamp,
    packet_due: Stamp,
    turns: bool,
    is_alive: bool,
    /// What was said on standard input and is no whole line yet; `None` once that is closed.
    orders: Option<Vec<u8>>,
    /// The ports' directory, where it is of its own making.
    directory: Option<PathBuf>,
    /// Locked, so that no other takes the ports away.
    _claim: File,
}

impl Robot {
    fn new(options: &Options, now: Stamp) -> Result<Self> {
        let directory = options.directory();
        let failed = |cause| Error::File { path: directory.clone(), cause };
        let was_there = directory.is_dir();
        std::fs::create_dir_all(&directory).map_err(failed)?;
        let claim = File::open(&directory).map_err(failed)?;
        if rustix::fs::flock(&claim, FlockOperation::NonBlockingLockExclusive).is_err() {
            let place = directory.display();
            let why =
                format!("another emulated robot is at {place}: choose another place, --ports");
            return Err(Error::Fault(why));
        }
        let (board, lidar) = (directory.join("board"), directory.join("lidar"));
        Ok(Self {
            name: format!("board {}, lidar {}", board.display(), lidar.display()),
            firmware: Firmware::new(now, options.calibration()),
            body: Body { heading: 0.0, turning: 0.0, voltage: VOLTAGE, button: false },
            board: Line::new(&board, 1).map_err(failed)?,
            sensor: match options.lidar {
                Lidar::Lds01 => Sensor::Lds01(Lds01::default()),
                Lidar::Lds02 => Sensor::Lds02(Lds02::default()),
            },
            lidar: Line::new(&lidar, 2).map_err(failed)?,
            step_due: now,
            packet_due: now,
            turns: false,
            is_alive: false,
            orders: Some(Vec::new()),
            directory: (!was_there).then_some(directory),
            _claim: claim,
        })
    }

    fn turn(&mut self, now: Stamp, world: &mut dyn World) {
        self.step_due = self.step_due.max(now.before(LATE_MAX));
        while self.step_due <= now {
            self.step_due = self.step_due.after(STEP);
            let (linear, angular) = self.firmware.step();
            world.step(linear, angular);
            self.body.turning = angular;
        }
        self.body.heading = world.heading();
        // A board that calibrates leaves what comes in its buffer.
        let heard = if self.firmware.is_blocked() { Vec::new() } else { self.board.read() };
        let said = self.firmware.turn(now, &heard, &self.body);
        if !said.is_empty() {
            self.board.write(&said);
        }
        self.tell(now);
        self.measure(now, world);
        self.obey(now);
    }

    /// When the wheels begin to turn and when they stand, whether the firmware stopped them, and what it
    /// plays.
    fn tell(&mut self, now: Stamp) {
        let was_alive = std::mem::replace(&mut self.is_alive, self.firmware.is_alive());
        if was_alive != self.is_alive {
            say(now, if self.is_alive { "the heart beats" } else { "the heart stands" });
        }
        let did_turn = std::mem::replace(&mut self.turns, self.firmware.turns());
        if did_turn != self.turns {
            say(now, if self.turns { "the wheels turn" } else { "the wheels stand" });
        }
        if let Some(melody) = self.firmware.take_sound() {
            say(now, &format!("plays melody {melody}"));
        }
    }

    /// Sends the packets that are due by now.
    fn measure(&mut self, now: Stamp, world: &mut dyn World) {
        // Nothing is wanted of the reader; what it sends is a start command.
        self.lidar.read();
        self.packet_due = self.packet_due.max(now.before(LATE_MAX));
        while self.packet_due <= now {
            let (packet, period, baud_rate) = match &mut self.sensor {
                Sensor::Lds01(sensor) => (sensor.measure(world), lds01::PERIOD, lds01::BAUD_RATE),
                Sensor::Lds02(sensor) => (sensor.measure(world), lds02::PERIOD, lds02::BAUD_RATE),
            };
            if self.lidar.baud_rate() == baud_rate {
                self.lidar.write(&packet);
            } else {
                self.lidar.write_noise(&packet);
            }
            self.packet_due = self.packet_due.after(period);
        }
    }

    fn obey(&mut self, now: Stamp) {
        while let Some(line) = self.next_line() {
            let Some(order) = Order::parse(&line) else {
                say(now, HELP);
                continue;
            };
            match order {
                Order::Unplug(place) => self.line(place).unplug(),
                Order::Plug(place) => {
                    if let Err(cause) = self.line(place).plug() {
                        say(now, &format!("cannot plug it in: {cause}"));
                    }
                }
                Order::Fault(place, fault) => self.line(place).fault = fault,
                Order::Hang(hangs) => self.firmware.hang(hangs),
                Order::Power(on) => self.firmware.power(on),
                Order::Battery(volts) => self.body.voltage = volts,
                Order::Button(is_pressed) => self.body.button = is_pressed,
            }
            say(now, &format!("done: {}", line.trim()));
        }
    }

    fn line(&mut self, place: Place) -> &mut Line {
        match place {
            Place::Board => &mut self.board,
            Place::Lidar => &mut self.lidar,
        }
    }

    /// The next whole line on standard input.
    fn next_line(&mut self) -> Option<String> {
        let orders = self.orders.as_mut()?;
        let input = std::io::stdin();
        if is_readable(input.as_fd()) {
            let mut piece = [0; 256];
            match rustix::io::read(&input, &mut piece) {
                Ok(0) | Err(_) => {
                    self.orders = None;
                    return None;
                }
                Ok(count) => orders.extend_from_slice(&piece[..count]),
            }
        }
        let end = orders.iter().position(|&byte| byte == b'\n')?;
        let line: Vec<u8> = orders.drain(..=end).collect();
        Some(String::from_utf8_lossy(&line).into_owned())
    }

    /// Waits until something is due, comes or is ordered.
    fn wait(&self, now: Stamp) {
        let until = self.step_due.min(self.packet_due);
        let input = std::io::stdin();
        let mut fds: Vec<PollFd<'_>> = Vec::with_capacity(3);
        let board = self.board.waits_for().filter(|_| !self.firmware.is_blocked());
        fds.extend(board.map(|board| PollFd::from_borrowed_fd(board, PollFlags::IN)));
        fds.extend(self.orders.as_ref().map(|_| PollFd::new(&input, PollFlags::IN)));
        fds.extend(signal::wake().map(|wake| PollFd::new(wake, PollFlags::IN)));
        let timeout = Timespec::try_from(until.since(now)).unwrap_or_default();
        let _ = rustix::event::poll(&mut fds, Some(&timeout));
    }
}

fn is_readable(file: BorrowedFd<'_>) -> bool {
    let mut fds = [PollFd::from_borrowed_fd(file, PollFlags::IN)];
    rustix::event::poll(&mut fds, Some(&Timespec::default())).is_ok_and(|ready| 0 < ready)
}
