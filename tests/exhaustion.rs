//! Where there is no more of something: shared memory, files, addresses, process numbers.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::time::Duration;

use node::clock;
use rustix::process::Signal;

use crate::robot::{Ended, Robot, Run, mount_namespace, wait_until};

/// The robot that restarts what dies.
const LAB_ROBOT: &str = include_str!("../config/lab_robot.toml");

/// Long enough on a machine that is busy with other things.
const PATIENCE: Duration = Duration::from_secs(30);

#[test]
fn where_shared_memory_is_short_the_robot_is_refused_with_what_it_needs() {
    let Some(wrapper) = in_shared_memory_of("4m") else { return };
    let wrapper: Vec<_> = wrapper.iter().map(String::as_str).collect();
    let robot = Robot::new();
    let file = robot.launch_file_from(LAB_ROBOT, &[]);
    let begun = clock::now();
    let ended = robot.start_up_under(&wrapper, &[&file], |_| ()).wait();
    println!("F15 /dev/shm full at start: refused after {:?}", clock::now().since(begun));

    ended.assert_code(1).assert_says(&["/dev/shm has 4.0 MiB free, and the robot needs", "MiB;"]);
    assert!(!ended.out.contains("unconfigured"), "a node was started\n{}", ended.story());
    robot.assert_nothing_left();
}

// Broken on purpose: without `Namespace::reserve`, the simulator died of SIGBUS.
#[test]
fn where_shared_memory_is_used_up_in_motion_the_robot_drives_on() {
    let Some(wrapper) = in_shared_memory_of("32m") else { return };
    let wrapper: Vec<_> = wrapper.iter().map(String::as_str).collect();
    let robot = Robot::new();
    // What a process locks it has: here the supervisor alone sees to it.
    let unlocked = [("restart = \"on-failure\"", "memory_lock = false")];
    let file = robot.launch_file_from(LAB_ROBOT, &unlocked);
    let run = robot.start_up_under(&wrapper, &[&file], |_| ()).await_count("READY", 1);
    // The robot's own shared memory, by the kernel's way into a process's root directory.
    let own = Path::new("/proc").join(run.process().pid.to_string()).join("root/dev/shm");
    let mut filler = File::create(own.join("filler")).unwrap();
    let piece = vec![1; 4096];
    while filler.write_all(&piece).is_ok() {}
    let size = filler.metadata().unwrap().len();
    // Longer than any queue is deep.
    let ended = run.go_on(Duration::from_secs(3)).stop();

    println!("F15 /dev/shm full in motion: {size} bytes of others, nothing happened");
    assert!(!ended.out.contains("failed"), "{}", ended.story());
    let sent = ended.topics()["scan"]["sent"].as_u64().unwrap();
    assert!(20 < sent, "{sent} scans\n{}", ended.story());
    assert!(0.1 < ended.figure("simulator", "distance_m"), "{}", ended.story());
}

/// What runs a command where `/dev/shm` is of this size, and nobody else's.
fn in_shared_memory_of(size: &str) -> Option<Vec<String>> {
    let script = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm; exec \"$@\"");
    let mut wrapper: Vec<_> = mount_namespace()?.into_iter().map(str::to_owned).collect();
    wrapper.extend(["sh", "-euc", &script, "sh"].map(str::to_owned));
    Some(wrapper)
}

// Broken on purpose: without `preflight::check`, the supervisor said of 64 files that it could not
// open a topic, died of SIGSEGV within 28000 KiB of addresses, and aborted after a while in 150000.
#[test]
fn with_few_files_to_open_or_few_addresses_the_robot_is_refused_or_runs() {
    let runs = [
        ("ulimit -n 16", "a process may open 16 files, and the robot's need 208: ulimit -n 208"),
        ("ulimit -n 32", "a process may open 32 files"),
        ("ulimit -n 40", "a process may open 40 files"),
        ("ulimit -n 207", "a process may open 207 files"),
        ("ulimit -n 208", "asked to stop"),
        // Which it may raise itself.
        ("ulimit -S -n 40", "asked to stop"),
        ("ulimit -v 28000", "a process may have 27.3 MiB of addresses, and the robot's need"),
        ("ulimit -v 150000", "a process may have 146.5 MiB of addresses"),
        ("ulimit -v 300000", "asked to stop"),
    ];
    for (limit, says) in runs {
        let ended = refuse_or_run(limit);
        ended.assert_says(&[says]);
    }
}

/// The robot within `limit` comes up and down in order, or says why not; no panic, nothing left.
fn refuse_or_run(limit: &str) -> Ended {
    let robot = Robot::new();
    let file = robot.launch_file_from(LAB_ROBOT, &[]);
    let script = format!("{limit}; exec \"$@\"");
    let run = robot.start_up_under(&["sh", "-euc", &script, "sh"], &[&file], |_| ());
    let ended = match run.wait_or(|run| run.output().contains("READY")) {
        Ok(ended) => ended,
        Err(run) => run.signal(Signal::INT).wait(),
    };
    let last = ended.out.lines().chain(ended.err.lines()).last().unwrap_or_default();
    println!("F26 {limit}: exit {}: {last}", ended.code);
    assert!(ended.code <= 1 && !ended.err.contains("panicked"), "{}", ended.story());
    robot.assert_nothing_left();
    ended
}

// Broken on purpose: where neither guardian nor supervisor was a subreaper, all of them were left.
#[test]
fn of_a_storm_of_processes_nothing_is_left_whoever_ends_it() {
    type End = for<'a> fn(Run<'a>) -> Run<'a>;
    let ends: [(&str, End); 2] = [
        ("Ctrl-C", |run| run.signal(Signal::INT)),
        ("SIGKILL of the supervisor", |run| {
            run.supervisor().signal(Signal::KILL);
            run
        }),
    ];
    for (what, end) in ends {
        let robot = Robot::new();
        let storm = robot.file("storm", STORM);
        // A number that no other process has in its words.
        let mark = format!("8640{}", std::process::id());
        let last = "parameters_file = \"controller/lab_robot.toml\"\n";
        let more = format!(
            "{last}\n[[process]]\nname = \"stranger\"\ntype = \"simple\"\n\
             exec = [\"/bin/sh\", \"{storm}\", \"{mark}\"]\n"
        );
        let file = robot.launch_file_from(LAB_ROBOT, &[(last, &more)]);
        let run = robot.start_up(&[&file]).await_count("READY", 1);
        let is_blowing = wait_until(PATIENCE, || STORM_MIN <= marked(&mark));
        assert!(is_blowing, "{} of {STORM_MIN}\n{}", marked(&mark), run.output());
        let processes = marked(&mark);
        let begun = clock::now();
        let run = end(run);
        let is_over = wait_until(PATIENCE, || marked(&mark) == 0);
        println!("F25 {processes} processes, {what}: gone after {:?}", clock::now().since(begun));
        let ended = run.wait();
        assert!(is_over, "{} are left\n{}", marked(&mark), ended.story());
        robot.assert_nothing_left();
    }
}

/// Two hundred in sessions of their own, half of them without a variable in their environment; and
/// two chains in which each process starts the next and ends.
const STORM: &str = "\
if [ $# -gt 1 ]; then
    [ $2 -eq 0 ] || setsid sh $0 $1 $(($2 - 1)) &
    exit
fi
for i in $(seq 100); do
    setsid sleep $1 &
    env -i setsid sleep $1 &
done
sh $0 $1 20000 &
sh $0 $1 20000 &
exec sleep $1
";

/// [-] Of the processes of a storm.
const STORM_MIN: usize = 200;

/// [-] Processes that have this among their words.
fn marked(mark: &str) -> usize {
    let entries = fs::read_dir("/proc").unwrap().flatten();
    let words = entries.filter_map(|entry| fs::read_to_string(entry.path().join("cmdline")).ok());
    words.filter(|words| words.split('\0').any(|word| word == mark)).count()
}
