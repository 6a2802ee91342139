//! Driving by hand: a person at a real terminal, over the autonomy of a robot of real processes.

use std::fs::File;
use std::io::Write;
use std::time::Duration;

use interfaces::topics::{
    AUTONOMY_COMMAND, MOTION_STATE, ODOMETRY, STATUS, TELEOP_COMMAND, VELOCITY_COMMAND,
};
use interfaces::{
    MotionState, NodeStatus, Odometry, Permission, Stamp, StopCause, VelocityCommand,
};
use node::{Publisher, Session, Subscriber, clock};
use rustix::process::Signal;
use rustix::termios::LocalModes;

use crate::robot::{Ended, Robot, Run, alone, alone_in, test_of, wait_until};
use crate::terminal::Terminal;

const TELEOP: &str = include_str!("../config/teleop.toml");

/// How long may pass until something is sure to have happened.
const TIMEOUT: Duration = Duration::from_secs(30);

/// How long a test waits for something that must not happen.
const SILENCE: Duration = Duration::from_millis(300);

/// What a person is told who may drive.
const TAKES_OVER: &str = "the first key takes over";

/// Turn left on the spot, whatever was pressed before.
const LEFT: &str = "saaaaa";

/// [rad/s] What that asks for.
const TURNING: f64 = 0.5;

/// Between two times that a person presses the same keys: those pressed while the robot may not move
/// are forgotten.
const AGAIN: Duration = Duration::from_millis(300);

#[test]
fn a_person_drives_over_autonomy_and_gives_the_robot_back() {
    alone(|robot| {
        let run = up(robot);
        let mut watch = Watch::new(robot);
        watch.await_driver("autonomy");
        let terminal = Terminal::new(80, 24);
        let teleop = drive(&terminal, robot, &["--hold"]);

        watch.await_odometry_while(&terminal, LEFT, "turns on the spot", |odometry| {
            odometry.linear.abs() < 0.005 && (odometry.angular - TURNING).abs() < 0.05
        });
        watch.await_driver("teleop");
        // What the controller says meanwhile is heard, and kept back.
        assert!(0.0 < watch.await_figure("autonomy_outranked", |count| 0.0 < count));

        terminal.press("q");
        teleop.wait().assert_code(0);
        watch.await_driver("autonomy");
        watch.await_odometry("drives on", |odometry| 0.05 < odometry.linear);
        // That a person drove is on record, and who did before and after.
        let events = robot.start(&["events", "multiplexer"]).wait();
        let mut story = events.out.split("teleop drives");
        assert!(story.all(|part| part.contains("autonomy drives")), "{}", events.story());
        events.assert_says(&["teleop drives"]);
        let ended = run.stop();
        ended.assert_counters_close();
        assert_eq!(ended.topics()["cmd_vel"]["publisher"], "multiplexer", "{}", ended.story());
        assert!(2.0 <= ended.figure("multiplexer", "take_overs"), "{}", ended.story());
    });
}

#[test]
fn a_hand_that_has_left_the_keyboard_stops_the_robot() {
    alone(|robot| {
        let run = up(robot);
        let mut watch = Watch::new(robot);
        let terminal = Terminal::new(80, 24);
        let teleop = drive(&terminal, robot, &[]);

        watch.await_odometry_while(&terminal, LEFT, "turns", |odometry| 0.4 < odometry.angular);
        watch.await_odometry("stands", |odometry| {
            odometry.angular.abs() < 0.005 && odometry.linear.abs() < 0.005
        });
        assert!(watch.drives("teleop"), "it was not given back");

        terminal.press("\x03");
        teleop.wait().assert_code(0);
        run.stop();
    });
}

// Broken on purpose: where the multiplexer promised a steady flow, the robot was never ready.
#[test]
fn a_robot_without_autonomy_is_ready_for_a_person() {
    alone(|robot| {
        let (_, controller) = TELEOP.split_at(TELEOP.rfind("[[process]]").unwrap());
        assert!(controller.contains("controller"), "{controller}");
        let launch_file = robot.launch_file_from(TELEOP, &[(controller, "")]);
        let run = robot.start_up(&[&launch_file]).await_count("READY", 1);
        let mut watch = Watch::new(robot);
        let terminal = Terminal::new(80, 24);
        let teleop = drive(&terminal, robot, &[]);

        watch.await_odometry_while(&terminal, LEFT, "turns", |odometry| 0.4 < odometry.angular);
        terminal.press("\x03");
        teleop.wait().assert_code(0);
        run.stop();
    });
}

#[test]
fn a_second_person_is_refused() {
    alone(|robot| {
        let run = up(robot);
        let (terminal, other) = (Terminal::new(80, 24), Terminal::new(80, 24));
        let teleop = drive(&terminal, robot, &[]);

        let refused = robot.start_at(&["teleop"], other.end(), None).wait();
        refused.assert_code(1);
        refused.assert_says(&["'teleop_cmd_vel' already has its one publisher (teleop)"]);

        terminal.press("q");
        teleop.wait().assert_code(0);
        run.stop();
    });
}

#[test]
fn where_a_multiplexer_commands_a_controller_may_not() {
    let robot = Robot::new();
    let run = up(&robot);

    let stray = ["controller", "--name", "stray", "--autostart", "--set", "clock=realtime"];
    let refused = robot.start(&stray).wait();
    assert_ne!(refused.code, 0, "{}", refused.story());
    refused.assert_says(&["'cmd_vel' already has its one publisher (controller or multiplexer)"]);

    run.stop();
}

#[test]
fn where_the_person_is_killed_autonomy_takes_over_and_another_person_may() {
    alone(|robot| {
        let run = up(robot);
        let mut watch = Watch::new(robot);
        let terminal = Terminal::new(80, 24);
        let teleop = drive(&terminal, robot, &["--hold"]);
        watch.await_odometry_while(&terminal, LEFT, "turns", |odometry| 0.4 < odometry.angular);

        teleop.signal(Signal::KILL).wait();
        watch.await_driver("autonomy");

        let another = Terminal::new(80, 24);
        let teleop = drive(&another, robot, &["--hold"]);
        let what = "turns the other way";
        watch.await_odometry_while(&another, "sddddd", what, |odometry| odometry.angular < -0.4);
        another.press("q");
        teleop.wait().assert_code(0);
        run.stop();
    });
}

#[test]
fn one_whose_terminal_is_gone_drives_no_more() {
    alone(|robot| {
        let run = up(robot);
        let mut watch = Watch::new(robot);
        let terminal = Terminal::new(80, 24);
        let teleop = drive(&terminal, robot, &["--hold"]);
        watch.await_odometry_while(&terminal, LEFT, "turns", |odometry| 0.4 < odometry.angular);

        // A reader keeps what comes to it, but only from a publisher that it has met.
        let met = watch.persons.latest().unwrap();
        drop(terminal);
        teleop.wait().assert_code(0);
        let last = std::iter::from_fn(|| watch.persons.receive().unwrap()).last().or(met);
        let angular = last.expect("nobody drove").angular;
        assert!(0.0 < angular, "one who is lost says nothing, not even rest");
        watch.await_driver("autonomy");
        run.stop();
    });
}

#[test]
fn the_terminal_is_as_it_was_however_driving_ends() {
    let robot = Robot::new();
    let run = up(&robot);
    let terminal = Terminal::new(80, 24);
    let before = terminal.modes();
    let ways = [
        End::Keys("q"),
        End::Keys("\x03"),
        End::Keys("w\x03"),
        End::Signal(Signal::INT),
        End::Signal(Signal::TERM),
        End::Signal(Signal::HUP),
    ];
    for way in ways {
        let teleop = drive_shown(&terminal, &robot);
        terminal.await_shown(TAKES_OVER);
        assert!(!terminal.modes().local_modes.contains(LocalModes::ECHO), "keys are echoed");

        match way {
            End::Keys(keys) => terminal.press(keys),
            End::Signal(signal) => teleop.process().signal(signal),
        }
        teleop.wait().assert_code(0);
        assert_eq!(format!("{:?}", terminal.modes()), format!("{before:?}"), "after {way:?}");
        assert!(terminal.take_shown().contains("\r\x1b[K"), "the line is shown in place");
    }
    run.stop();
}

#[test]
fn where_the_robot_goes_down_so_does_its_person() {
    let robot = Robot::new();
    let run = up(&robot);
    let terminal = Terminal::new(80, 24);
    let before = format!("{:?}", terminal.modes());
    let teleop = drive(&terminal, &robot, &[]);
    terminal.press("s");
    let teleop = teleop.await_output(" 0.00 m/s");
    run.stop();

    let ended = teleop.wait();
    ended.assert_code(1).assert_says(&["robot 'burger' went away"]);
    assert_eq!(format!("{:?}", terminal.modes()), before);
    robot.assert_nothing_left();
}

#[test]
fn what_is_not_shown_on_a_terminal_has_no_escape_codes() {
    let robot = Robot::new();
    let run = up(&robot);
    let terminal = Terminal::new(80, 24);
    let teleop = drive(&terminal, &robot, &[]);
    terminal.press("w");
    let teleop = teleop.await_output("0.01 m/s");
    terminal.press("q");
    let ended: Ended = teleop.wait();

    assert!(!ended.out.contains('\x1b') && !ended.out.contains('\r'), "{:?}", ended.out);
    run.stop();
}

#[test]
fn without_a_robot_or_a_multiplexer_or_a_terminal_nobody_drives() {
    let robot = Robot::new();
    robot.start(&["teleop"]).wait().assert_code(3).assert_says(&["no robot is running"]);
    let absent = robot.start(&["teleop", "--robot", "burger"]).wait();
    absent.assert_code(3).assert_says(&["robot 'burger' is not running"]);
    robot.assert_nothing_left();

    let run = robot.start_up(&["--clock", "realtime"]).await_active();
    let deaf = robot.start(&["teleop"]).wait();
    deaf.assert_code(1).assert_says(&["has no multiplexer", "config/teleop.toml"]);
    run.stop();

    let run = up(&robot);
    let blind = robot.start(&["teleop"]).wait();
    blind.assert_code(1).assert_says(&["standard input is not"]);
    run.stop();
}

#[test]
fn a_robot_that_may_not_move_is_asked_to_rest_until_it_may() {
    alone(|robot| {
        let _lock = play_guardian(robot);
        let session = Session::join(&robot.namespace(), "wheels", 1).unwrap();
        let mut states = session.publisher(&MOTION_STATE).unwrap();
        let mut commands = session.subscriber(&TELEOP_COMMAND).unwrap();
        let terminal = Terminal::new(80, 24);
        let teleop = drive(&terminal, robot, &["--hold"]).await_output("nobody says whether");

        tell(&mut states, Permission::Held, StopCause::Silence, 1);
        let teleop = teleop.await_output("held: dead-man, needs `teseo arm`");
        terminal.press("wwww");
        // A stream that begins with rest, however hard the person presses.
        for _ in 0..5 {
            assert_eq!(next_speed(&mut commands).to_bits(), 0);
        }

        tell(&mut states, Permission::Armed, StopCause::None, 0);
        let teleop = teleop.await_output("armed");
        // What was sent before it knew.
        drop(commands.latest().unwrap());
        let speed = next_speed(&mut commands);
        assert_eq!(speed.to_bits(), 0, "what was pressed before is not forgotten");
        terminal.press("w");
        let found = wait_until(TIMEOUT, || 0.0 < next_speed(&mut commands));
        assert!(found, "the person is not heard");

        terminal.press("q");
        teleop.wait().assert_code(0);
        let rest = std::iter::from_fn(|| commands.receive().unwrap()).last();
        assert_eq!(rest.map(|command| command.linear), Some(0.0), "its last word is rest");
    });
}

#[test]
fn the_multiplexer_passes_on_the_more_important_with_stamps_of_their_own() {
    with_multiplexer(|wires| {
        wires.autonomy(0.1, 1);
        assert_eq!(wires.next(), (0.1, 1));
        wires.teleop(0.2, 2);
        assert_eq!(wires.next(), (0.2, 2));
        wires.autonomy(0.1, 3);
        wires.teleop(f64::NAN, 4);
        assert_eq!(wires.passed_within(SILENCE), [], "a person drives");

        // Silent for its time-out, without a word to let go.
        clock::nap(Duration::from_millis(500));
        wires.autonomy(0.3, 5);
        assert_eq!(wires.next(), (0.3, 5));
    });
}

#[test]
fn one_who_lets_go_of_a_robot_at_rest_is_not_waited_for() {
    with_multiplexer(|wires| {
        wires.teleop(0.2, 1);
        assert_eq!(wires.next(), (0.2, 1));
        wires.teleop(0.0, 2);
        wires.teleop = None;

        assert_eq!(wires.next(), (0.0, 2), "the last word comes through");
        // Two waits of a node, in which it looks; less than the time-out.
        clock::nap(Duration::from_millis(100));
        wires.autonomy(0.1, 3);
        assert_eq!(wires.next(), (0.1, 3));
    });
}

/// How a person ends.
#[derive(Debug)]
enum End {
    Keys(&'static str),
    Signal(Signal),
}

/// `config/teleop.toml`, ready.
fn up(robot: &Robot) -> Run<'_> {
    let launch_file = robot.launch_file_from(TELEOP, &[]);
    robot.start_up(&[&launch_file]).await_count("READY", 1)
}

/// Makes the robot one that runs, as far as anybody can see, held by this process.
fn play_guardian(robot: &Robot) -> File {
    robot.namespace().create_directory().unwrap();
    let mut lock = File::create(robot.namespace().lock()).unwrap();
    writeln!(lock, "{}", std::process::id()).unwrap();
    lock
}

/// [m/s] Of the next command that comes.
fn next_speed(commands: &mut Subscriber<VelocityCommand>) -> f64 {
    let mut speed = None;
    wait_until(TIMEOUT, || {
        speed = commands.receive().unwrap().map(|command| command.linear);
        speed.is_some()
    });
    speed.expect("no command came")
}

fn tell(
    states: &mut Publisher<MotionState>,
    permission: Permission,
    cause: StopCause,
    needs_person: u8,
) {
    states
        .send_with(|state| {
            state.permission = permission as u8;
            state.cause = cause as u8;
            state.needs_person = needs_person;
        })
        .unwrap();
}

/// What the robot does, and who drives it.
struct Watch {
    persons: Subscriber<VelocityCommand>,
    odometry: Subscriber<Odometry>,
    statuses: Subscriber<NodeStatus>,
    status: Option<NodeStatus>,
    _session: Session,
}

impl Watch {
    fn new(robot: &Robot) -> Self {
        let session = Session::join(&robot.namespace(), "watch", 1).unwrap();
        Self {
            persons: session.quiet_subscriber(&TELEOP_COMMAND).unwrap(),
            odometry: session.quiet_subscriber(&ODOMETRY).unwrap(),
            statuses: session.subscriber_to(&STATUS, "multiplexer").unwrap(),
            status: None,
            _session: session,
        }
    }

    #[track_caller]
    fn await_driver(&mut self, source: &str) {
        self.await_figure(&format!("{source}_drives"), |drives| 0.5 < drives);
    }

    fn drives(&mut self, source: &str) -> bool {
        0.5 < self.await_figure(&format!("{source}_drives"), |_| true)
    }

    #[track_caller]
    fn await_figure(&mut self, key: &str, is_it: impl Fn(f64) -> bool) -> f64 {
        let mut figure = None;
        let found = wait_until(TIMEOUT, || {
            if let Some(status) = self.statuses.latest().unwrap() {
                self.status = Some(*status);
            }
            figure = self.status.and_then(|status| status.value(key));
            figure.is_some_and(&is_it)
        });
        assert!(found, "the multiplexer's {key} is {figure:?}");
        figure.unwrap()
    }

    /// The same while somebody presses `keys` now and then.
    #[track_caller]
    fn await_odometry_while(
        &mut self,
        terminal: &Terminal,
        keys: &str,
        what: &str,
        is_it: impl Fn(&Odometry) -> bool,
    ) {
        let mut due = clock::now();
        self.await_odometry_and(what, |odometry| {
            if due <= clock::now() {
                due = clock::now().after(AGAIN);
                terminal.press(keys);
            }
            odometry.is_some_and(&is_it)
        });
    }

    #[track_caller]
    fn await_odometry(&mut self, what: &str, is_it: impl Fn(&Odometry) -> bool) {
        self.await_odometry_and(what, |odometry| odometry.is_some_and(&is_it));
    }

    #[track_caller]
    fn await_odometry_and(&mut self, what: &str, mut is_it: impl FnMut(Option<&Odometry>) -> bool) {
        let mut last = None;
        let found = wait_until(TIMEOUT, || {
            last = self.odometry.receive().unwrap().map(|odometry| *odometry).or(last);
            is_it(last.as_ref())
        });
        assert!(found, "the robot never {what}: {last:?}");
    }
}

/// Starts `teseo teleop` at `terminal`, with its standard output in a file, where nobody drives yet.
fn drive<'a>(terminal: &Terminal, robot: &'a Robot, options: &[&str]) -> Run<'a> {
    let teleop = robot.start_at(&[&["teleop"], options].concat(), terminal.end(), None);
    teleop.await_output(TAKES_OVER)
}

/// The same with its standard output on the terminal too.
fn drive_shown<'a>(terminal: &Terminal, robot: &'a Robot) -> Run<'a> {
    robot.start_at(&["teleop"], terminal.end(), Some(terminal.end()))
}

/// What the multiplexer is wired to.
struct Wires {
    autonomy: Publisher<VelocityCommand>,
    teleop: Option<Publisher<VelocityCommand>>,
    commands: Subscriber<VelocityCommand>,
}

impl Wires {
    fn new(session: &Session) -> Self {
        Self {
            autonomy: session.publisher(&AUTONOMY_COMMAND).unwrap(),
            teleop: Some(session.publisher(&TELEOP_COMMAND).unwrap()),
            commands: session.subscriber(&VELOCITY_COMMAND).unwrap(),
        }
    }

    fn autonomy(&mut self, linear: f64, stamp: u64) {
        send(&mut self.autonomy, linear, stamp);
    }

    fn teleop(&mut self, linear: f64, stamp: u64) {
        send(self.teleop.as_mut().unwrap(), linear, stamp);
    }

    /// Speed and stamp of the next command at the wheels.
    fn next(&mut self) -> (f64, u64) {
        let mut command = None;
        wait_until(TIMEOUT, || {
            command = self.take();
            command.is_some()
        });
        command.expect("no command came")
    }

    fn passed_within(&mut self, duration: Duration) -> Vec<(f64, u64)> {
        let mut passed = Vec::new();
        wait_until(duration, || {
            passed.extend(self.take());
            false
        });
        passed
    }

    fn take(&mut self) -> Option<(f64, u64)> {
        let command = self.commands.receive().unwrap()?;
        let since = command.header.stamp.since(Stamp::ZERO);
        Some((command.linear, u64::try_from(since.as_nanos()).unwrap()))
    }
}

fn send(to: &mut Publisher<VelocityCommand>, linear: f64, stamp: u64) {
    to.send_with(|command| {
        command.header.stamp = Stamp::from_nanoseconds(stamp);
        command.linear = linear;
    })
    .unwrap();
}

/// Runs a multiplexer that nobody supervises, wired to `body`.
fn with_multiplexer<F: FnOnce(&mut Wires)>(body: F) {
    alone_in(test_of(&body), |robot| {
        let session = Session::join(&robot.namespace(), "test", 1).unwrap();
        let mut wires = Wires::new(&session);
        let arguments = ["multiplexer", "--autostart", "--set", "clock=realtime"];
        let run = robot.start(&[&arguments[..], &["--log-level", "debug"]].concat());
        let run = run.await_output("goal=active");
        body(&mut wires);
        run.signal(Signal::TERM).wait().assert_code(0);
    });
}
