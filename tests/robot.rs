//! The harness: a robot of a test's own, the runs of it, and the proof that nothing is left of them.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use node::{Namespace, clock};
use rustix::process::{Pid, Signal};
use serde_json::Value;

/// Long enough for the slowest run on a machine that is busy with other things.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Between two looks at a process.
const POLL: Duration = Duration::from_millis(2);

/// How long the kernel may take to end what it was told to end.
const SURVIVAL_MAX: Duration = Duration::from_secs(10);

/// Where shared memory lies.
const SHARED_MEMORY: &str = "/dev/shm";

/// Names the robot's directory where a test's body runs in a process of its own; see [`alone`].
const ALONE: &str = "TESEO_TEST_ALONE";

/// The launch file that the tests' own are made of.
pub(crate) const SIMULATION: &str = include_str!("../config/simulation.toml");

static ROBOTS: AtomicU32 = AtomicU32::new(0);

/// A runtime directory that no other test uses, and so a namespace of its own. Dropping it asserts
/// that nothing is left there: no process, no file, no shared memory.
#[derive(Debug)]
pub(crate) struct Robot {
    directory: PathBuf,
    /// Of the names in shared memory, as read while a run was on.
    prefixes: RefCell<BTreeSet<String>>,
}

impl Robot {
    pub(crate) fn new() -> Self {
        let number = ROBOTS.fetch_add(1, Ordering::Relaxed);
        // Short: a socket's address has 108 bytes.
        let name = format!("teseo-t{}-{number}", std::process::id());
        let directory = std::env::temp_dir().join(name);
        fs::create_dir(&directory).unwrap();
        Self { directory, prefixes: RefCell::default() }
    }

    /// A file of the test's own, gone with the robot.
    pub(crate) fn file(&self, name: &str, text: &str) -> String {
        let path = self.directory.join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    }

    /// A launch file of the test's own: config/simulation.toml, each `(old, new)` of `changes` made.
    pub(crate) fn launch_file(&self, changes: &[(&str, &str)]) -> String {
        self.launch_file_from(SIMULATION, changes)
    }

    /// The same of another launch file of config/.
    pub(crate) fn launch_file_from(&self, original: &str, changes: &[(&str, &str)]) -> String {
        let directory = concat!(env!("CARGO_MANIFEST_DIR"), "/config/");
        let mut text = original.to_owned();
        for (old, new) in changes {
            assert!(text.contains(old), "the launch file has no '{old}'");
            text = text.replace(old, new);
        }
        // Names of files are relative to the launch file, which lies elsewhere now.
        for folder in ["controller/", "worlds/"] {
            text = text.replace(&format!("\"{folder}"), &format!("\"{directory}{folder}"));
        }
        self.file("launch.toml", &text)
    }

    /// A launch file with one more process, which is none of ours, and starts last.
    pub(crate) fn launch_file_with(&self, name: &str, exec: &str) -> String {
        let last = "start = \"outer\"\n";
        let more = format!("{last}\n[[process]]\nname = \"{name}\"\nexec = {exec}\n");
        self.launch_file(&[(last, &more)])
    }

    /// Runs `teseo up` with these arguments to its end.
    pub(crate) fn up(&self, arguments: &[&str]) -> Ended {
        self.start_up(arguments).wait()
    }

    /// Starts `teseo up` with these arguments.
    pub(crate) fn start_up(&self, arguments: &[&str]) -> Run<'_> {
        self.start_up_under(&[], arguments, |_| ())
    }

    /// The same under another command; see [`Robot::start_under`].
    pub(crate) fn start_up_under(
        &self,
        wrapper: &[&str],
        arguments: &[&str],
        change: impl FnOnce(&mut Command),
    ) -> Run<'_> {
        let report = self.directory.join("report.json");
        let report = report.to_str().unwrap();
        self.start_under(wrapper, &[&["up", "--report", report], arguments].concat(), change)
    }

    /// What `teseo status --json` says; null where it says nothing.
    pub(crate) fn status(&self) -> Value {
        serde_json::from_str(&self.start(&["status", "--json"]).wait().out).unwrap_or_default()
    }

    /// Waits until `teseo status` says that the robot is ready: for runs that print nothing.
    pub(crate) fn await_ready(&self) {
        let is_ready = wait_until(TIMEOUT, || self.status()["state"] == "ready");
        assert!(is_ready, "{}", self.status());
    }

    /// A directory of the test's own, gone with the robot.
    pub(crate) fn folder(&self, name: &str) -> String {
        let path = self.directory.join(name);
        fs::create_dir(&path).unwrap();
        path.to_str().unwrap().to_owned()
    }

    /// Starts `teseo` with these arguments.
    pub(crate) fn start(&self, arguments: &[&str]) -> Run<'_> {
        self.start_under(&[], arguments, |_| ())
    }

    /// The same with variables in its environment.
    pub(crate) fn start_in(&self, environment: &[(&str, &str)], arguments: &[&str]) -> Run<'_> {
        self.start_under(&[], arguments, |command| {
            command.envs(environment.iter().copied());
        })
    }

    /// The same with another standard input, and with another standard output where one is given.
    pub(crate) fn start_at(
        &self,
        arguments: &[&str],
        input: Stdio,
        output_to: Option<Stdio>,
    ) -> Run<'_> {
        self.start_under(&[], arguments, |command| {
            command.stdin(input);
            if let Some(output) = output_to {
                command.stdout(output);
            }
        })
    }

    /// The same as the last words of the command `wrapper`, which has to become it; `change` is the
    /// last to say how it is started.
    pub(crate) fn start_under(
        &self,
        wrapper: &[&str],
        arguments: &[&str],
        change: impl FnOnce(&mut Command),
    ) -> Run<'_> {
        let output = |name: &str| {
            let number = ROBOTS.fetch_add(1, Ordering::Relaxed);
            self.directory.join(format!("{name}-{number}"))
        };
        let (out, err) = (output("out"), output("err"));
        let words = [wrapper, &[env!("CARGO_BIN_EXE_teseo")], arguments].concat();
        let mut command = Command::new(words[0]);
        command
            .args(&words[1..])
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .env("TESEO_RUNTIME_DIR", self.runtime())
            .stdin(Stdio::null())
            .stdout(File::create(&out).unwrap())
            .stderr(File::create(&err).unwrap());
        change(&mut command);
        let child = command.spawn().unwrap();
        let command = arguments.join(" ");
        Run { robot: self, command, child, out, err, has_ended: false }
    }

    /// What `TESEO_RUNTIME_DIR` says.
    pub(crate) fn runtime(&self) -> PathBuf {
        self.directory.join("r")
    }

    /// What a process of this binary finds in its environment where it is to run the body of
    /// [`alone`], for this robot.
    pub(crate) fn inside(&self) -> [(&'static str, PathBuf); 2] {
        [("TESEO_RUNTIME_DIR", self.runtime()), (ALONE, self.directory.clone())]
    }

    /// Where its shared memory lies, for one that joins it; see [`alone`].
    pub(crate) fn namespace(&self) -> Namespace {
        let namespace = Namespace::new("burger").unwrap();
        assert_eq!(namespace.directory(), self.runtime().join("burger"), "call this in `alone`");
        namespace
    }

    /// The processes that live in this robot's runtime directory, whoever their parent is.
    pub(crate) fn processes(&self) -> Vec<Process> {
        let mark = format!("TESEO_RUNTIME_DIR={}", self.runtime().display());
        let entries = fs::read_dir("/proc").unwrap().flatten();
        let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        pids.filter(|&pid: &i32| pid != i32::try_from(std::process::id()).unwrap())
            .filter(|pid| {
                let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
                environment.split(|&byte| byte == 0).any(|entry| entry == mark.as_bytes())
            })
            .map(|pid| Process { pid })
            .collect()
    }

    /// Waits until no process of this robot lives.
    pub(crate) fn await_no_process(&self) {
        let gone = wait_until(SURVIVAL_MAX, || self.processes().is_empty());
        assert!(gone, "these outlive the run: {:?}", self.describe_processes());
    }

    fn describe_processes(&self) -> Vec<String> {
        let describe =
            |process: Process| format!("{} {}", process.pid, process.command().join(" "));
        self.processes().into_iter().map(describe).collect()
    }

    /// Notes the prefix of every file that a run puts into shared memory, while it can be read.
    fn note_prefixes(&self) {
        let robots = fs::read_dir(self.runtime()).into_iter().flatten().flatten();
        for robot in robots {
            self.prefixes.borrow_mut().extend(prefix(&robot.path()));
        }
    }

    /// The files of this robot in shared memory.
    pub(crate) fn segments(&self) -> Vec<String> {
        self.prefixes.borrow().iter().flat_map(|prefix| segments(prefix)).collect()
    }

    /// The files of this robot, in shared memory and in its directory.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        let segments = self.segments().into_iter().map(|name| Path::new(SHARED_MEMORY).join(name));
        let robots = fs::read_dir(self.runtime()).into_iter().flatten().flatten();
        let entries = robots.flat_map(|robot| fs::read_dir(robot.path()).into_iter().flatten());
        segments.chain(entries.flatten().map(|entry| entry.path())).collect()
    }

    /// Nothing is left of the runs so far.
    pub(crate) fn assert_nothing_left(&self) {
        self.await_no_process();
        assert_eq!(self.segments(), [""; 0], "left in {SHARED_MEMORY}");
        let files: Vec<_> = fs::read_dir(self.runtime()).into_iter().flatten().flatten().collect();
        assert!(!self.runtime().exists(), "left in the runtime directory: {files:?}");
    }

    /// After a failed test, so that it does not harm the next.
    fn clean_up(&self) {
        wait_until(SURVIVAL_MAX, || {
            let processes = self.processes();
            for process in &processes {
                process.signal(Signal::KILL);
            }
            processes.is_empty()
        });
        for segment in self.segments() {
            let _ = fs::remove_file(Path::new(SHARED_MEMORY).join(segment));
        }
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        self.note_prefixes();
        if std::thread::panicking() {
            self.clean_up();
            let _ = fs::remove_dir_all(&self.directory);
            return;
        }
        let processes = self.describe_processes();
        let segments = self.segments();
        let is_left = self.runtime().exists();
        self.clean_up();
        let _ = fs::remove_dir_all(&self.directory);
        assert_eq!(processes, [""; 0], "outlived the run");
        assert_eq!(segments, [""; 0], "left in {SHARED_MEMORY}");
        assert!(!is_left, "the run left its runtime directory");
    }
}

/// A process of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Process {
    pub(crate) pid: i32,
}

impl Process {
    pub(crate) fn signal(self, signal: Signal) {
        assert!(1 < self.pid, "{} is nobody to send a signal to", self.pid);
        // It may have ended by itself meanwhile.
        let _ = rustix::process::kill_process(Pid::from_raw(self.pid).unwrap(), signal);
    }

    /// The words that it was started with.
    pub(crate) fn command(self) -> Vec<String> {
        let command = fs::read_to_string(format!("/proc/{}/cmdline", self.pid));
        command.unwrap_or_default().split_terminator('\0').map(str::to_owned).collect()
    }

    /// The processes that it has started, or was left with.
    pub(crate) fn children(self) -> Vec<Self> {
        let path = format!("/proc/{0}/task/{0}/children", self.pid);
        let children = fs::read_to_string(path).unwrap_or_default();
        children.split_whitespace().map(|pid| Self { pid: pid.parse().unwrap() }).collect()
    }
}

/// A process that was started, and what it has written.
#[derive(Debug)]
pub(crate) struct Run<'a> {
    robot: &'a Robot,
    command: String,
    child: Child,
    out: PathBuf,
    err: PathBuf,
    has_ended: bool,
}

impl Run<'_> {
    /// The process itself: of `teseo up`, the guardian.
    pub(crate) fn process(&self) -> Process {
        Process { pid: i32::try_from(self.child.id()).unwrap() }
    }

    /// The one process that `teseo up` has started itself.
    pub(crate) fn supervisor(&self) -> Process {
        let children = self.process().children();
        assert_eq!(children.len(), 1, "`up` has one child: {children:?}\n{}", self.output());
        children[0]
    }

    /// The process of the node called `name`.
    pub(crate) fn node(&self, name: &str) -> Process {
        let argument = format!("--name={name}");
        let children = self.supervisor().children();
        let node = children.into_iter().find(|child| child.command().contains(&argument));
        node.unwrap_or_else(|| panic!("no process is the node {name}\n{}", self.output()))
    }

    /// Waits until the run's output contains `text`.
    pub(crate) fn await_output(mut self, text: &str) -> Self {
        let found = self.watch_until(|run| run.output().contains(text));
        assert!(found, "{} never said '{text}'\n{}", self.command, self.output());
        self
    }

    /// Waits until the run's output contains `text` so many times.
    pub(crate) fn await_count(mut self, text: &str, count: usize) -> Self {
        let found = self.watch_until(|run| count <= run.output().matches(text).count());
        let enough = count <= self.output().matches(text).count();
        assert!(
            found && enough,
            "{} has not said '{text}' {count} times\n{}",
            self.command,
            self.output()
        );
        self
    }

    /// The supervisor's child whose command line contains `text`.
    pub(crate) fn child_running(&self, text: &str) -> Process {
        let is_it = |child: &Process| child.command().join(" ").contains(text);
        let child = self.supervisor().children().into_iter().find(is_it);
        child.unwrap_or_else(|| panic!("nobody runs '{text}'\n{}", self.output()))
    }

    /// Waits until the run has ended, or `is_enough` holds.
    pub(crate) fn wait_or(mut self, is_enough: impl Fn(&Self) -> bool) -> Result<Ended, Self> {
        let found = self.watch_until(&is_enough);
        assert!(found, "{} neither ended nor came so far\n{}", self.command, self.output());
        if self.has_ended { Ok(self.wait()) } else { Err(self) }
    }

    /// Waits until all nodes are active.
    pub(crate) fn await_active(self) -> Self {
        // The world is the last to be activated.
        self.await_output("simulator    inactive -> active")
    }

    /// Goes on for about this long.
    pub(crate) fn go_on(mut self, duration: Duration) -> Self {
        let ended = wait_until(duration, || self.poll());
        assert!(!ended, "{} ended by itself\n{}", self.command, self.output());
        self
    }

    pub(crate) fn signal(self, signal: Signal) -> Self {
        self.process().signal(signal);
        self
    }

    /// Asks it to stop and waits for the end, which is a clean one.
    #[track_caller]
    pub(crate) fn stop(self) -> Ended {
        let ended = self.signal(Signal::INT).wait();
        ended.assert_code(0).assert_says(&["asked to stop"]);
        ended
    }

    /// Waits for the end.
    pub(crate) fn wait(mut self) -> Ended {
        let ended = self.watch_until(|_| false);
        assert!(ended, "{} did not end in {TIMEOUT:?}\n{}", self.command, self.output());
        let status = self.child.wait().unwrap();
        let report = fs::read_to_string(self.robot.directory.join("report.json")).ok();
        let _ = fs::remove_file(self.robot.directory.join("report.json"));
        Ended {
            command: self.command.clone(),
            code: status.code().unwrap_or_else(|| 128 + status.signal().unwrap()),
            out: fs::read_to_string(&self.out).unwrap(),
            err: fs::read_to_string(&self.err).unwrap(),
            report: report.map_or(Value::Null, |text| serde_json::from_str(&text).unwrap()),
        }
    }

    /// Standard output and standard error so far.
    pub(crate) fn output(&self) -> String {
        let read = |path| fs::read_to_string(path).unwrap_or_default();
        format!("{}{}", read(&self.out), read(&self.err))
    }

    /// False where neither the process has ended nor `is_enough` held in time.
    fn watch_until(&mut self, is_enough: impl Fn(&Self) -> bool) -> bool {
        wait_until(TIMEOUT, || {
            let has_ended = self.poll();
            is_enough(self) || has_ended
        })
    }

    fn poll(&mut self) -> bool {
        self.robot.note_prefixes();
        self.has_ended |= self.child.try_wait().unwrap().is_some();
        self.has_ended
    }
}

impl Drop for Run<'_> {
    fn drop(&mut self) {
        if !self.has_ended {
            self.process().signal(Signal::KILL);
            let _ = self.child.wait();
        }
    }
}

/// A run that is over.
#[derive(Debug)]
pub(crate) struct Ended {
    command: String,
    pub(crate) code: i32,
    pub(crate) out: String,
    pub(crate) err: String,
    /// Null where the run did not come so far as to write one.
    pub(crate) report: Value,
}

impl Ended {
    /// Everything that a failed assertion should show.
    pub(crate) fn story(&self) -> String {
        format!("$ teseo {}\n{}{}exit {}", self.command, self.out, self.err, self.code)
    }

    #[track_caller]
    pub(crate) fn assert_code(&self, code: i32) -> &Self {
        assert_eq!(self.code, code, "exit code\n{}", self.story());
        self
    }

    /// Whatever was printed, to either side, contains each of `texts`, wherever its lines break: a
    /// file's name in a sentence is as long as the way to the project is.
    #[track_caller]
    pub(crate) fn assert_says(&self, texts: &[&str]) -> &Self {
        let unbroken = |said: &str| said.split_whitespace().collect::<Vec<_>>().join(" ");
        let (out, err) = (unbroken(&self.out), unbroken(&self.err));
        for text in texts {
            let sides = [&self.out, &self.err, &out, &err];
            let is_said = sides.iter().any(|side| side.contains(text));
            assert!(is_said, "it does not say '{text}'\n{}", self.story());
        }
        self
    }

    /// Every sample that was sent came to every reader, or was at least accounted for.
    #[track_caller]
    pub(crate) fn assert_counters_close(&self) -> &Self {
        assert_eq!(self.report["counters_close"], true, "{}", self.story());
        self
    }

    /// Every sample that was sent was received, and read, by every reader.
    #[track_caller]
    pub(crate) fn assert_nothing_lost(&self) -> &Self {
        self.assert_counters_close();
        for (name, topic) in self.topics().iter().filter(|(_, topic)| topic["on_event"] == false) {
            for (reader, counters) in topic["readers"].as_object().unwrap() {
                let whole = [&topic["sent"], &0.into(), &0.into(), &0.into()];
                let counted = ["received", "lost", "unread", "stale"].map(|key| &counters[key]);
                assert_eq!(counted, whole, "{reader} of {name}\n{}", self.story());
            }
        }
        self
    }

    pub(crate) fn topics(&self) -> &serde_json::Map<String, Value> {
        self.report["topics"].as_object().unwrap_or_else(|| panic!("no report\n{}", self.story()))
    }

    /// A figure of a node.
    #[track_caller]
    pub(crate) fn figure(&self, node: &str, key: &str) -> f64 {
        let figure = self.report["nodes"][node][key].as_f64();
        figure.unwrap_or_else(|| panic!("no figure {key} of {node}\n{}", self.story()))
    }

    #[track_caller]
    pub(crate) fn digest(&self) -> &str {
        let digest = self.report["digest"].as_str();
        digest.unwrap_or_else(|| panic!("no digest\n{}", self.story()))
    }

    /// The nodes that went from one state to another, in the order in which they were told.
    pub(crate) fn changed(&self, change: &str) -> Vec<&str> {
        let lines = self.out.lines().filter_map(|line| line.strip_suffix(change));
        lines.filter_map(|line| line.split_whitespace().last()).collect()
    }
}

/// For how long a fault lasts: `LASTS` seconds, or else `default`.
pub(crate) fn lasts(default: u64) -> Duration {
    let seconds = std::env::var("LASTS").map_or(default, |text| text.parse().unwrap());
    Duration::from_secs(seconds)
}

/// What puts a command into a mount name space of its own, whose root may mount what it likes;
/// `None`, and a word about it on screen, where this user may not.
pub(crate) fn mount_namespace() -> Option<Vec<&'static str>> {
    let as_root = vec!["unshare", "--mount"];
    let as_user = vec!["unshare", "--user", "--map-root-user", "--mount"];
    let works = |way: &Vec<&str>| {
        let tried = Command::new(way[0]).args(&way[1..]).arg("true").output();
        tried.is_ok_and(|tried| tried.status.success())
    };
    let way = [as_root, as_user].into_iter().find(works);
    if way.is_none() {
        println!("skipped: a mount name space takes root, or user name spaces");
    }
    way
}

/// Runs `body`, a closure of a test, in a process of its own, so that it may join the robot's shared
/// memory: what the transport takes for its namespace it keeps for the life of a process.
pub(crate) fn alone<F: FnOnce(&Robot)>(body: F) {
    alone_in(test_of(&body), body);
}

/// The same for a test by name, where `body` is not the test's own closure.
pub(crate) fn alone_in(test: &str, body: impl FnOnce(&Robot)) {
    let output = alone_with(test, &[], body).unwrap_or_default();
    // What it has measured, as a test of this process would show it.
    output.lines().filter(|line| line.starts_with("| ")).for_each(|line| println!("{line}"));
}

/// The same with variables in the environment of `body`'s process. Returns what that has printed, to
/// the process that has started it.
pub(crate) fn alone_with(
    test: &str,
    environment: &[(&str, String)],
    body: impl FnOnce(&Robot),
) -> Option<String> {
    if let Some(directory) = std::env::var_os(ALONE) {
        let robot = Robot { directory: directory.into(), prefixes: RefCell::default() };
        body(&robot);
        robot.note_prefixes();
        robot.namespace().remove();
        assert!(!robot.prefixes.borrow().is_empty(), "the body has joined nothing");
        return None;
    }
    let robot = Robot::new();
    // This same binary, which comes here again.
    let child = Command::new(std::env::current_exe().unwrap())
        .args([test, "--exact", "--nocapture"])
        .envs(robot.inside())
        .envs(environment.iter().map(|(key, value)| (key, value)))
        .output()
        .unwrap();
    let output = [child.stdout, child.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    assert!(child.status.success() && output.contains("1 passed"), "{output}");
    Some(output)
}

/// The name of the test that `body` is a closure of.
pub(crate) fn test_of<F>(_body: &F) -> &'static str {
    let (_, path) = std::any::type_name::<F>().split_once("::").unwrap();
    path.trim_end_matches("::{{closure}}")
}

/// What every name in shared memory of the robot in `directory` begins with, while it runs.
fn prefix(directory: &Path) -> Option<String> {
    let text = fs::read_to_string(directory.join("iceoryx2.toml")).ok()?;
    let prefix = text.lines().find_map(|line| line.strip_prefix("prefix = "))?;
    Some(prefix.trim_matches('"').to_owned())
}

/// The files in shared memory that begin with `prefix`.
fn segments(prefix: &str) -> Vec<String> {
    assert!(prefix.starts_with("teseo"), "'{prefix}' is not ours");
    let names = fs::read_dir(SHARED_MEMORY).unwrap().flatten();
    let names = names.filter_map(|entry| entry.file_name().into_string().ok());
    names.filter(|name| name.starts_with(prefix)).collect()
}

/// False where `timeout` passed before `is_done` held.
pub(crate) fn wait_until(timeout: Duration, mut is_done: impl FnMut() -> bool) -> bool {
    // The clock is read only where there is something to wait for: under valgrind it cannot be.
    let mut begun = None;
    loop {
        if is_done() {
            return true;
        }
        let now = clock::now();
        if timeout < now.since(*begun.get_or_insert(now)) {
            return false;
        }
        clock::nap(POLL);
    }
}
