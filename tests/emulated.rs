//! A TurtleBot3 of a test's own, emulated on pseudo-terminals, and what it says of its wheels.

use std::fs::File;
use std::io::{PipeWriter, Write};
use std::time::Duration;

use interfaces::Stamp;

use crate::robot::{Robot, Run, wait_until};

/// The launch file of a real robot.
pub(crate) const TURTLEBOT3: &str = include_str!("../config/turtlebot3.toml");

/// Its firmware's watchdog and one of its motor cycles.
pub(crate) const FIRMWARE: Duration = Duration::from_millis(520);

/// Whatever it does, it does it sooner, also on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);

/// The emulator, and a hand at it.
pub(crate) struct Emulated<'a> {
    run: Run<'a>,
    orders: PipeWriter,
    ports: String,
}

impl<'a> Emulated<'a> {
    /// In the maze's outer corridor, with a gyro that is calibrated quickly.
    pub(crate) fn start(robot: &'a Robot, arguments: &[&str]) -> Self {
        let ports = robot.folder("ports");
        let (input, orders) = std::io::pipe().unwrap();
        let own = ["emulate", "turtlebot3", "--calibration", "0.2", "--ports", &ports];
        let words = [&own, arguments].concat();
        let run = robot.start_at(&words, input.into(), None).await_output("ready: ");
        Self { run, orders, ports }
    }

    /// The launch file of a robot with these ports: config/turtlebot3.toml, each `(old, new)` of
    /// `changes` made.
    pub(crate) fn launch_file(&self, robot: &Robot, changes: &[(&str, &str)]) -> String {
        let (board, lidar) = (format!("{}/board", self.ports), format!("{}/lidar", self.ports));
        let ports = [("/dev/ttyACM0", &*board), ("/dev/ttyUSB0", &*lidar)];
        robot.launch_file_from(TURTLEBOT3, &[&ports, changes].concat())
    }

    /// Gives an order, and waits until it is done; returns when that was.
    pub(crate) fn order(&mut self, order: &str) -> Stamp {
        let done = format!("done: {order}");
        let before = self.said(&done).len();
        writeln!(self.orders, "{order}").unwrap();
        let is_done = wait_until(PATIENCE, || before < self.said(&done).len());
        assert!(is_done, "never {order}\n{}", self.run.output());
        *self.said(&done).last().unwrap()
    }

    /// When it said exactly this, each time.
    pub(crate) fn said(&self, what: &str) -> Vec<Stamp> {
        let output = self.run.output();
        let lines = output.lines().filter_map(|line| line.split_once(' '));
        let said = lines.filter(|(_, text)| *text == what);
        said.map(|(seconds, _)| {
            let seconds: f64 = seconds.parse().unwrap();
            Stamp::ZERO.after(Duration::from_secs_f64(seconds))
        })
        .collect()
    }

    /// Waits until it says this after `moment`; returns when.
    #[track_caller]
    pub(crate) fn await_said(&self, what: &str, moment: Stamp) -> Stamp {
        let find = || self.said(what).into_iter().find(|said| moment <= *said);
        assert!(wait_until(PATIENCE, || find().is_some()), "never '{what}'\n{}", self.run.output());
        find().unwrap()
    }

    /// When its wheels stand after `moment`; none where they stood before.
    #[track_caller]
    pub(crate) fn await_stand(&self, moment: Stamp) -> Option<Stamp> {
        let last = |what| self.said(what).into_iter().rfind(|said| *said < moment);
        let turned = last("the wheels turn")? > last("the wheels stand").unwrap_or(Stamp::ZERO);
        turned.then(|| self.await_said("the wheels stand", moment))
    }

    /// Ends it, and returns its last words.
    pub(crate) fn stop(self) -> String {
        let ended = self.run.signal(rustix::process::Signal::TERM).wait();
        ended.assert_code(0);
        let ports = std::fs::read_dir(&self.ports).unwrap().count();
        assert_eq!(ports, 0, "left its ports");
        ended.out
    }

    /// The path of one of its ports.
    pub(crate) fn port(&self, name: &str) -> String {
        format!("{}/{name}", self.ports)
    }
}

/// Somebody else who has the board's port open, and does not share it.
pub(crate) fn occupy(path: &str) -> File {
    let file = File::options().read(true).write(true).open(path).unwrap();
    rustix::fs::flock(&file, rustix::fs::FlockOperation::NonBlockingLockExclusive).unwrap();
    file
}
