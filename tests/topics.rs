//! Topics as they are promised: one publisher, counted losses, latches, and nothing copied.

use std::time::Duration;

use interfaces::topics::{ODOMETRY, SCAN, STATUS, TRANSITION_EVENT, VELOCITY_COMMAND};
use interfaces::{LaserScan, Message, Stamp, State};
use node::{Clock, Error, Sample, Session, clock};
use rustix::process::Signal;

use crate::robot::{Robot, alone, wait_until};

#[test]
fn a_second_publisher_is_refused_by_topic_and_by_who_should_be_the_first() {
    alone(|robot| {
        let session = Session::join(&robot.namespace(), "one", 1).unwrap();
        let _first = session.publisher(&ODOMETRY).unwrap();
        let other = Session::join(&robot.namespace(), "other", 1).unwrap();

        let refusal = other.publisher(&ODOMETRY).unwrap_err();
        assert!(matches!(&refusal, Error::Taken { topic, .. } if topic == "odom"), "{refusal}");
        assert_eq!(
            refusal.to_string(),
            "topic 'odom' already has its one publisher (odometry); stop that one first"
        );
    });
}

#[test]
fn where_the_publisher_has_gone_another_may_take_its_place() {
    alone(|robot| {
        let session = Session::join(&robot.namespace(), "one", 1).unwrap();
        drop(session.publisher(&ODOMETRY).unwrap());

        session.publisher(&ODOMETRY).unwrap();
    });
}

// A process that is killed gives nothing back, and nobody but whoever is asked to looks for the dead.
#[test]
fn the_place_of_a_publisher_that_was_killed_is_free_once_the_dead_are_cleared() {
    alone(|robot| {
        let publisher = robot.start(&["odometry", "--autostart", "--set", "clock=realtime"]);
        let namespace = robot.namespace();
        let session = Session::join(&namespace, "next", 1).unwrap();
        let mut events = session.subscriber_to(&TRANSITION_EVENT, "odometry").unwrap();
        // One who is killed on his way up may leave what the dead cannot be known by.
        let active = Some(State::Active as u8);
        let mut state = || events.latest().unwrap().map(|event| event.goal_state);
        assert!(wait_until(Duration::from_secs(10), || state() == active));
        publisher.signal(Signal::KILL).wait();
        let monitors = || {
            let nodes = std::fs::read_dir(namespace.directory().join("nodes")).unwrap();
            nodes.filter(|node| node.as_ref().unwrap().path().is_dir()).count()
        };

        let refusal = session.publisher(&ODOMETRY).unwrap_err();
        assert!(matches!(&refusal, Error::Taken { .. }), "{refusal}");
        assert_eq!(monitors(), 2);
        namespace.clear_dead().unwrap();
        assert_eq!(monitors(), 1);
        session.publisher(&ODOMETRY).unwrap();
    });
}

#[test]
fn a_second_controller_is_refused_and_the_robot_drives_on() {
    let robot = Robot::new();
    let run = robot.start_up(&["--clock", "realtime"]).await_active();

    let intruder = ["controller", "--name", "intruder", "--autostart", "--set", "clock=realtime"];
    let refused = robot.start(&intruder).wait();
    assert_ne!(refused.code, 0, "{}", refused.story());
    refused.assert_says(&["'cmd_vel' already has its one publisher (controller or multiplexer)"]);

    let ended = run.go_on(Duration::from_millis(300)).stop();
    ended.assert_counters_close();
    assert_eq!(ended.topics()["cmd_vel"]["publisher"], "controller", "{}", ended.story());
}

#[test]
fn a_reader_that_is_slow_gets_the_newest_samples_and_sees_the_gap() {
    alone(|robot| {
        let session = Session::join(&robot.namespace(), "node", 1).unwrap();
        let mut publisher = session.publisher(&ODOMETRY).unwrap();
        let mut slow = session.subscriber(&ODOMETRY).unwrap();
        let sent = ODOMETRY.depth + 5;
        for _ in 0..sent {
            publisher.send_with(|_| ()).unwrap();
        }

        let numbers = std::iter::from_fn(|| slow.receive().unwrap());
        let numbers: Vec<_> = numbers.map(|sample| sample.header.sequence).collect();
        assert_eq!(numbers, (5..sent as u64).collect::<Vec<_>>());
    });
}

#[test]
fn what_a_slow_node_misses_is_counted_as_lost() {
    let robot = Robot::new();
    let run = robot.start_up(&["--clock", "realtime"]).await_active();
    let controller = run.node("controller");
    let run = run.go_on(Duration::from_millis(300));
    controller.signal(Signal::STOP);
    // Many more samples than a queue holds.
    let run = run.go_on(Duration::from_secs(2));
    controller.signal(Signal::CONT);
    let ended = run.go_on(Duration::from_millis(500)).stop();

    ended.assert_counters_close();
    for topic in ["scan", "odom", "sensor_pair"] {
        let counters = &ended.topics()[topic]["readers"]["controller"];
        let lost = counters["lost"].as_u64().unwrap();
        assert!(0 < lost, "{topic}: lost {lost}\n{}", ended.story());
    }
    // The others had no part in it.
    assert_eq!(ended.topics()["joint_states"]["lost"], 0, "{}", ended.story());
    assert_eq!(ended.topics()["scan"]["readers"]["pairing"]["lost"], 0, "{}", ended.story());
}

#[test]
fn in_lock_step_one_who_reads_slowly_holds_the_robot_up_and_loses_nothing() {
    alone(|robot| {
        let run = robot.start_up(&[]).await_active();
        let session = Session::join(&robot.namespace(), "slow", 1).unwrap();
        let session = session.with_clock(Clock::Lockstep);
        let mut scans = session.subscriber(&SCAN).unwrap();
        let mut numbers = Vec::new();
        for _ in 0..5 {
            // Meanwhile a robot that waits for nobody sends more than any queue holds.
            clock::nap(Duration::from_millis(100));
            while let Some(scan) = scans.receive().unwrap() {
                numbers.push(scan.header.sequence);
            }
        }
        drop(scans);

        let whole: Vec<_> = (numbers[0]..).take(numbers.len()).collect();
        assert_eq!(numbers, whole, "gaps in the sequence");
        assert!(SCAN.depth < numbers.len(), "only {} scans came", numbers.len());
        run.stop();
    });
}

#[test]
fn while_no_commands_come_the_robot_stands() {
    let robot = Robot::new();
    let run = robot.start_up(&["--clock", "realtime"]).await_active();
    let controller = run.node("controller");
    let run = run.go_on(Duration::from_millis(300));
    controller.signal(Signal::STOP);
    let run = run.go_on(Duration::from_secs(4));
    controller.signal(Signal::CONT);
    let ended = run.stop();

    // It drives 0.15 m/s, but not for at least half of the time in which nobody told it to.
    let distance = ended.figure("simulator", "distance_m");
    let seconds = ended.figure("simulator", "simulated_s");
    assert!(distance < 0.15 * (seconds - 2.0), "{distance} m in {seconds} s\n{}", ended.story());
}

#[test]
fn one_who_comes_late_gets_the_last_status_first_but_no_old_command() {
    alone(|robot| {
        let session = Session::join(&robot.namespace(), "node", 1).unwrap();
        let mut status = session.publisher(&STATUS).unwrap();
        let mut wheels = session.publisher(&VELOCITY_COMMAND).unwrap();
        let mut say = |state: u8| {
            status.send_with(|status| status.state = state).unwrap();
            wheels.send_with(|command| command.linear = f64::from(state)).unwrap();
        };
        (1..=3).for_each(&mut say);
        let late = Session::join(&robot.namespace(), "late", 1).unwrap();
        let mut told = late.subscriber_to(&STATUS, "node").unwrap();
        let mut commands = late.subscriber(&VELOCITY_COMMAND).unwrap();
        say(4);

        let heard = std::iter::from_fn(|| told.receive().unwrap());
        assert_eq!(heard.map(|status| status.state).collect::<Vec<_>>(), [3, 4]);
        let speeds = std::iter::from_fn(|| commands.receive().unwrap());
        let numbers: Vec<_> = speeds.map(|command| command.header.sequence).collect();
        assert_eq!(numbers, [3], "a late joiner acts on no old command");
    });
}

#[test]
fn one_who_comes_late_learns_the_state_of_a_node_that_has_nothing_more_to_say() {
    alone(|robot| {
        let run = robot.start_up(&["--clock", "realtime"]).await_active();
        let late = Session::join(&robot.namespace(), "late", 1).unwrap();
        let mut events = late.subscriber_to(&TRANSITION_EVENT, "simulator").unwrap();

        let mut goal = None;
        wait_until(Duration::from_secs(5), || {
            goal = events.latest().unwrap().map(|event| event.goal_state);
            goal.is_some()
        });
        assert_eq!(goal, Some(State::Active as u8), "transition_event is latched, by the table");
        run.stop();
    });
}

#[test]
fn a_sample_is_written_once_and_read_where_it_was_written() {
    alone(|robot| {
        let session = Session::join(&robot.namespace(), "lidar", 1).unwrap();
        let mut publisher = session.publisher(&SCAN).unwrap();
        let readers =
            ["near", "far"].map(|name| Session::join(&robot.namespace(), name, 1).unwrap());
        let [mut near, mut far] = readers.map(|reader| reader.subscriber(&SCAN).unwrap());

        let mut written = Place::default();
        publisher.send_with(|scan| written = Place::of(scan)).unwrap();
        let [near, far] = [&mut near, &mut far].map(|reader| reader.receive().unwrap().unwrap());

        assert!(written.file.starts_with("/dev/shm/teseo"), "{written:?} is not shared");
        assert_eq!(Place::of::<LaserScan>(&near), written);
        assert_eq!(Place::of::<LaserScan>(&far), written);
    });
}

#[test]
fn a_borrowed_sample_stays_as_it_is_while_others_come() {
    alone(|robot| {
        let session = Session::join(&robot.namespace(), "lidar", 1).unwrap();
        let mut publisher = session.publisher(&SCAN).unwrap();
        let mut reader = session.subscriber(&SCAN).unwrap();
        let mut send = |number: u64| {
            let fill = |scan: &mut LaserScan| scan.header.stamp = Stamp::from_nanoseconds(number);
            publisher.send_with(fill).unwrap();
        };

        send(7);
        let borrowed: Sample<_> = reader.receive().unwrap().unwrap();
        let place = Place::of::<LaserScan>(&borrowed);
        (8..100).for_each(&mut send);

        assert_eq!(borrowed.header().stamp, Stamp::from_nanoseconds(7));
        assert_eq!(Place::of::<LaserScan>(&borrowed), place);
        // The queue has moved on meanwhile.
        let newest = reader.latest().unwrap().unwrap();
        assert_eq!(newest.header().stamp, Stamp::from_nanoseconds(99));
    });
}

/// Where in which file a value lies, wherever that file is mapped.
#[derive(Debug, Default, PartialEq, Eq)]
struct Place {
    file: String,
    offset: usize,
}

impl Place {
    fn of<T>(value: &T) -> Self {
        let address = std::ptr::from_ref(value).addr();
        let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
        let hexadecimal = |text| usize::from_str_radix(text, 16).unwrap();
        for map in maps.lines() {
            // 7f2c8a000000-7f2c8a100000 rw-s 00002000 00:18 1234 /dev/shm/teseo…
            let fields: Vec<_> = map.split_whitespace().collect();
            let (start, end) = fields[0].split_once('-').unwrap();
            let (start, end) = (hexadecimal(start), hexadecimal(end));
            if (start..end).contains(&address) {
                let file = fields.get(5).copied().unwrap_or_default().to_owned();
                return Self { file, offset: hexadecimal(fields[2]) + address - start };
            }
        }
        panic!("{address:x} is nowhere in\n{maps}");
    }
}
