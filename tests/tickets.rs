//! The controller alone, between a sensor and a pairing that the test plays: what it makes of tickets.

use std::time::Duration;

use interfaces::topics::{ODOMETRY, SCAN, SENSOR_PAIR, STATUS, VELOCITY_COMMAND};
use interfaces::{LaserScan, Odometry, SensorPair, Stamp, VelocityCommand};
use node::{Clock, Publisher, Session, Subscriber, clock};
use rustix::process::Signal;

use crate::robot::{alone_in, test_of, wait_until};

/// How long a command may take that is sure to come.
const TIMEOUT: Duration = Duration::from_secs(20);

/// How long the test waits for a command that must not come.
const SILENCE: Duration = Duration::from_millis(300);

#[test]
fn a_ticket_that_comes_before_its_samples_waits_for_them() {
    with_controller(|wires| {
        wires.ticket(0);
        assert_eq!(wires.commands_within(SILENCE), [0; 0], "a command without a scan");
        wires.odometry(0);
        assert_eq!(wires.commands_within(SILENCE), [0; 0], "a command without a scan");
        wires.scan(0);

        assert_eq!(wires.next_command(), Some(stamp(0)));
        assert_eq!(wires.gone(), 0, "the samples came late, they were not gone");
    });
}

#[test]
fn tickets_are_driven_in_their_order_where_samples_come_late() {
    with_controller(|wires| {
        (0..3).for_each(|number| wires.ticket(number));
        (0..3).for_each(|number| wires.odometry(number));
        (0..3).for_each(|number| wires.scan(number));

        for number in 0..3 {
            assert_eq!(wires.next_command(), Some(stamp(number)));
        }
    });
}

#[test]
fn a_ticket_whose_sample_is_gone_is_counted_and_skipped() {
    with_controller(|wires| {
        let newest = 2 * SCAN.depth as u64;
        for number in 0..=newest {
            wires.scan(number);
            wires.odometry(number);
        }
        wires.ticket(0);
        wires.ticket(newest);

        assert_eq!(wires.next_command(), Some(stamp(newest)));
        assert_eq!(wires.commands_within(SILENCE), [0; 0], "a command for a scan that is gone");
        assert_eq!(wires.gone(), 1);
    });
}

#[test]
fn without_a_ticket_no_sample_moves_the_robot() {
    with_controller(|wires| {
        for number in 0..3 {
            wires.scan(number);
            wires.odometry(number);
        }

        assert_eq!(wires.commands_within(SILENCE), [0; 0]);
    });
}

/// What the controller is wired to.
struct Wires<'a> {
    session: &'a Session,
    scans: Publisher<LaserScan>,
    odometry: Publisher<Odometry>,
    tickets: Publisher<SensorPair>,
    commands: Subscriber<VelocityCommand>,
}

impl<'a> Wires<'a> {
    fn new(session: &'a Session) -> Self {
        Self {
            session,
            scans: session.publisher(&SCAN).unwrap(),
            odometry: session.publisher(&ODOMETRY).unwrap(),
            tickets: session.publisher(&SENSOR_PAIR).unwrap(),
            commands: session.subscriber(&VELOCITY_COMMAND).unwrap(),
        }
    }

    fn scan(&mut self, number: u64) {
        let free = |scan: &mut LaserScan| {
            scan.header.stamp = stamp(number);
            scan.length = 240;
            scan.ranges_mut().fill(1.0);
        };
        self.scans.send_with(free).unwrap();
    }

    fn odometry(&mut self, number: u64) {
        self.odometry.send_with(|odometry| odometry.header.stamp = stamp(number)).unwrap();
    }

    /// For the scan and the odometry of this number, which have come or will come.
    fn ticket(&mut self, number: u64) {
        let pair = |ticket: &mut SensorPair| {
            ticket.header.stamp = stamp(number);
            (ticket.scan_stamp, ticket.scan_sequence, ticket.scan_epoch) =
                (stamp(number), number, 1);
            ticket.odometry_stamp = stamp(number);
            (ticket.odometry_sequence, ticket.odometry_epoch) = (number, 1);
            ticket.formed = clock::now();
        };
        self.tickets.send_with(pair).unwrap();
    }

    /// The stamp of the next command.
    fn next_command(&mut self) -> Option<Stamp> {
        let mut command = None;
        wait_until(TIMEOUT, || {
            command = self.commands.receive().unwrap();
            command.is_some()
        });
        command.map(|command| command.header.stamp)
    }

    /// The sequence numbers of the commands that come in this time.
    fn commands_within(&mut self, duration: Duration) -> Vec<u64> {
        let mut numbers = Vec::new();
        wait_until(duration, || {
            let command = self.commands.receive().unwrap();
            numbers.extend(command.map(|command| command.header.sequence));
            false
        });
        numbers
    }

    /// The tickets that the controller has given up, by its own count.
    fn gone(&self) -> u64 {
        let mut statuses = self.session.subscriber_to(&STATUS, "controller").unwrap();
        let mut count = None;
        wait_until(TIMEOUT, || {
            let status = statuses.latest().unwrap();
            count = status.and_then(|status| status.value("tickets_whose_sample_is_gone"));
            count.is_some()
        });
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count")]
        count.map(|count| count as u64).unwrap()
    }
}

fn stamp(number: u64) -> Stamp {
    Stamp::from_nanoseconds(1_000_000_000 + 50_000_000 * number)
}

/// Runs a controller that nobody supervises, wired to `body`.
fn with_controller<F: FnOnce(&mut Wires<'_>)>(body: F) {
    alone_in(test_of(&body), |robot| {
        let session = Session::join(&robot.namespace(), "test", 1).unwrap();
        let session = session.with_clock(Clock::Lockstep);
        let mut wires = Wires::new(&session);
        let run = robot.start(&["controller", "--autostart", "--log-level", "debug"]);
        let run = run.await_output("goal=active");
        body(&mut wires);
        run.signal(Signal::TERM).wait().assert_code(0);
    });
}
