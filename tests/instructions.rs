//! The hot paths take no more instructions than they did: counted by valgrind, to which it does not
//! matter how busy the machine is.

use std::hint::black_box;
use std::process::Command;
use std::time::Duration;

use clap::Parser;
use controller::Controller;
use interfaces::topics::SCAN;
use interfaces::{JointState, LaserScan, Odometry, Stamp};
use node::pairing::{Bounds, Config, Entry, Pairing, Policy};
use node::{Session, Settings};
use odometry::WheelOdometry;
use simulator::{Simulator, World};

use crate::random::number;
use crate::robot::{Robot, alone, test_of};

const SIMULATION: &str = include_str!("../config/simulation.toml");

/// [1/s] Of simulated time.
const STEPS_PER_SECOND: u64 = 20;

/// The command line of the node that this process is, and the file for what it has counted.
const WORDS: &str = "NODE_WORDS";
const COUNT: &str = "NODE_COUNT";

/// Which path, and how often.
const PATH: &str = "HOT_PATH";
const TIMES: &str = "HOT_PATH_TIMES";

/// [-] Turns after which a loop has all the memory that it needs.
const WARM_UP: u64 = 100;

/// [-] Allocations that `loan` of iceoryx2 0.10.0 makes for each sample: the one that a shared count
/// of users lies in.
const LOANS: u64 = 1;

/// Processors differ in whether the C library sets memory by one instruction for each byte; here it
/// never does.
const WHOLE_VECTORS: &str =
    "glibc.cpu.x86_rep_stosb_threshold=16777216:glibc.cpu.x86_rep_movsb_threshold=16777216";

/// A path, how often it is taken, and how many instructions it may take in a test build: a tenth more
/// than were counted.
const LIMITS: [(&str, u64, u64); 7] = [
    ("publish a scan", 5000, 6_660),
    ("publish and receive a scan", 5000, 8_240),
    ("pair", 5000, 1_770),
    ("scan of lab02", 500, 23_500),
    ("drive", 5000, 2_350),
    ("odometry", 5000, 540),
    ("corridor following", 200, 2_020),
];

// Broken on purpose: with any limit a fifth below what was counted, the test failed and said so.
#[test]
fn the_hot_paths_take_no_more_instructions_than_they_did() {
    if Command::new("valgrind").arg("--version").output().is_err() {
        println!("skipped: there is no valgrind, which counts instructions");
        return;
    }
    let mut wrong = Vec::new();
    for (path, times, limit) in LIMITS {
        let count = instructions(path, times).saturating_sub(instructions(path, 0)) / times;
        println!("| {path} | {count} instructions | at most {limit} |");
        if limit < count {
            wrong.push(format!("{path}: {count} instructions, more than {limit}"));
        }
        if count < limit / 2 {
            wrong.push(format!("{path}: {count} instructions; lower its limit of {limit}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// [-] Instructions of a process that takes `path` so many times.
fn instructions(path: &str, times: u64) -> u64 {
    let test = if path.contains("publish") { "ports" } else { "cores" };
    let robot = Robot::new();
    let valgrind = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(std::env::current_exe().unwrap())
        .args([&format!("instructions::the_hot_paths_of_{test}"), "--exact", "--test-threads=1"])
        .envs(robot.inside())
        .env("GLIBC_TUNABLES", WHOLE_VECTORS)
        .env(PATH, path)
        .env(TIMES, times.to_string())
        .output()
        .unwrap();
    let told = [valgrind.stdout, valgrind.stderr].map(|text| String::from_utf8(text).unwrap());
    let told = told.concat();
    assert!(valgrind.status.success() && told.contains("1 passed"), "{told}");
    let counted = told.lines().find_map(|line| line.split_once("Collected : "));
    counted.unwrap_or_else(|| panic!("{told}")).1.trim().parse().unwrap()
}

// It failed when it was new: the simulator wrote down its way through the cells in every turn.
#[test]
fn a_whole_node_allocates_for_each_sample_that_it_sends_and_for_nothing_else() {
    if let Ok(words) = std::env::var(WORDS) {
        return be_node(&words);
    }
    // What each sends in a step. The pairing is a thread of the supervisor, and is counted above.
    for (node, samples) in [("simulator", 2), ("odometry", 1), ("controller", 1)] {
        let steps = 2_000;
        let count = allocations(node, 100 + steps) - allocations(node, 100);
        println!("| {node} | {count} allocations in {steps} steps |");
        let loans = LOANS * samples * steps;
        // Its status is a sample too, ten times in each second of the wall's.
        assert!(count.abs_diff(loans) < steps / 4, "{node}: {count} allocations, not {loans}");
    }
}

/// [-] Allocations in the whole life of `node`, in a run of so many steps.
fn allocations(node: &str, steps: u64) -> u64 {
    let robot = Robot::new();
    let count = robot.file("count", "");
    // This same binary, which comes to `be_node`.
    let own = std::env::current_exe().unwrap();
    let test = test_of(&a_whole_node_allocates_for_each_sample_that_it_sends_and_for_nothing_else);
    let shell = format!("{COUNT}={count} {WORDS}=\\\"$*\\\" exec {} {test} --exact", own.display());
    let name = format!("name = \"{node}\"\n");
    let exec = format!("{name}exec = [\"/bin/sh\", \"-c\", \"{shell}\", \"sh\"]\n");
    let launch_file = robot.launch_file_from(SIMULATION, &[(&name, &exec)]);
    let seconds = (steps / STEPS_PER_SECOND).to_string();
    robot.up(&[&launch_file, "--for", &seconds]).assert_code(0);
    std::fs::read_to_string(count).unwrap().parse().unwrap()
}

/// Lives as the node that the supervisor has started with these words, and counts.
fn be_node(words: &str) {
    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: node::Arguments,
    }
    let name = std::env::var("TESEO_NODE").unwrap();
    let body = match name.as_str() {
        "simulator" => simulator::run,
        "odometry" => odometry::run,
        _ => controller::run,
    };
    let line = Line::parse_from([name.as_str()].into_iter().chain(words.split(' ')));
    let settings = Settings::of_node(&line.arguments, &name).unwrap();
    let taken = allocation_counter::measure(|| node::run_with(&settings, body).unwrap());
    std::fs::write(std::env::var(COUNT).unwrap(), taken.count_total.to_string()).unwrap();
}

#[test]
fn the_hot_paths_of_ports() {
    alone(|robot| {
        let session = Session::join(&robot.namespace(), "talker", 1).unwrap();
        let mut publisher = session.publisher(&SCAN).unwrap();
        let mut subscriber = session.subscriber(&SCAN).unwrap();
        let mut received = 0;
        take("publish a scan", || {
            publisher.send_with(|scan| scan.length = 240).unwrap();
        });
        take("publish and receive a scan", || {
            publisher.send_with(|scan| scan.length = 240).unwrap();
            received += subscriber.receive().unwrap().map_or(0, |scan| scan.ranges().len());
        });
        assert_eq!(received % 240, 0);
    });
}

#[test]
fn the_hot_paths_of_cores() {
    let config = Config {
        policy: Policy::Nearest,
        topics: 2,
        queue_size: 10,
        slop: Duration::from_millis(50),
        bounds: Bounds::Limited {
            max_age: Duration::from_millis(500),
            max_delay: Duration::from_millis(100),
        },
    };
    let mut pairing = Pairing::new(&config).unwrap();
    let (mut sequence, mut pairs) = (0, 0);
    let taken = take("pair", || {
        sequence += 1;
        let stamp = Stamp::from_nanoseconds(sequence * 50_000_000);
        let entry = Entry { stamp, sequence, epoch: 1, received: stamp };
        pairs += pairing.push(0, entry).pairs().count() + pairing.push(1, entry).pairs().count();
    });
    assert!(usize::try_from(taken).unwrap() <= pairs + 1, "{pairs} pairs of {taken}");

    let world: World = toml::from_str(include_str!("../config/worlds/lab02.toml")).unwrap();
    let mut simulator = Simulator::new(&simulator::Config::default(), &world).unwrap();
    let (mut scan, mut joints) = (LaserScan::default(), JointState::default());
    take("drive", || simulator.step(0.01, 0.0));
    take("scan of lab02", || simulator.sense(&mut scan));
    simulator.sense(&mut scan);
    simulator.fill_joint_state(&mut joints);
    assert_eq!(scan.ranges().len(), 240);

    let mut wheels = WheelOdometry::new(&odometry::Config::default());
    let mut odometry = Odometry::default();
    take("odometry", || {
        joints.header.stamp = joints.header.stamp.after(Duration::from_millis(50));
        black_box(wheels.update(&joints, &mut odometry)).unwrap();
    });

    let following = include_str!("../config/controller/corridor_following.toml");
    let mut controller = Controller::new(&toml::from_str(following).unwrap()).unwrap();
    take("corridor following", || {
        black_box(controller.update(&scan, &odometry)).unwrap();
    });
}

/// Takes this path as often as the environment says; returns how often.
fn take(path: &str, mut once: impl FnMut()) -> u64 {
    let Ok(asked) = std::env::var(PATH) else {
        // By itself, this is a test of another cost: of the first turns only may take memory.
        (0..WARM_UP).for_each(|_| once());
        let taken = allocation_counter::measure(|| (0..WARM_UP).for_each(|_| once()));
        let allowed = if path.contains("publish") { LOANS * WARM_UP } else { 0 };
        assert_eq!(taken.count_total, allowed, "{path}: allocations in {WARM_UP} turns");
        return 2 * WARM_UP;
    };
    let times = if asked == path { number(TIMES, 0) } else { 0 };
    (0..times).for_each(|_| once());
    times
}
