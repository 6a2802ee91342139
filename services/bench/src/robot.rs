//! A whole robot as `teseo up` runs it, from a launch file of the bench's own.

use std::fmt::Write;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Duration;

use interfaces::Stamp;
use node::{Error, Namespace, Result, Wait, clock, signal};
use rustix::process::{Pid, Signal};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde_json::Value;

use crate::peers::{cores, own};

/// The lab's maze, and its wall follower.
pub(crate) const WORLD: &str = include_str!("../../../config/worlds/lab02.toml");
const CONTROLLER: &str = include_str!("../../../config/controller/lab_simulation.toml");

/// What is different from one robot to the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Robot {
    pub(crate) wait: Wait,
    pub(crate) cores: Cores,
    /// [Hz] Of the measurements in real time; lock-step where there is none.
    pub(crate) rate: Option<u32>,
    /// [s] Of the robot's own time.
    pub(crate) length_s: f64,
    /// [-] Of the LiDAR.
    pub(crate) beams: usize,
    /// [-] Walls that stand around the maze.
    pub(crate) more_walls: usize,
}

/// Where a robot's processes run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cores {
    /// Where the kernel likes.
    Any,
    /// All on one.
    One,
    /// Simulator and pairing on one, odometry and controller on another: each wakes one over there.
    Two,
}

/// What a run has left.
pub(crate) struct Ran {
    /// The report of `teseo up`.
    pub(crate) report: Value,
    /// [ms] From its start until data flowed.
    pub(crate) ready_ms: f64,
}

/// A run takes as long as it shall and some seconds; after this long it hangs.
const TIMEOUT: Duration = Duration::from_secs(120);

/// Between two looks at whether a run has ended.
const PAUSE: Duration = Duration::from_millis(20);

/// A robot under way. Told to stop, and its files removed, when dropped.
pub(crate) struct Running {
    namespace: Namespace,
    directory: PathBuf,
    child: Child,
    until: Stamp,
}

impl Robot {
    /// How it waits and where it runs.
    pub(crate) fn setting(&self) -> String {
        let cores = match self.cores {
            Cores::Any => "any core",
            Cores::One => "one core",
            Cores::Two => "two cores",
        };
        format!("{}, {cores}", self.wait.label())
    }

    /// Starts it beside `namespace`, as the robot with this number.
    pub(crate) fn start(&self, namespace: &Namespace, number: usize) -> Result<Running> {
        let name = format!("{}-r{number}", namespace.robot());
        let files = [
            ("world.toml", &*self.world()),
            ("controller.toml", CONTROLLER),
            ("launch.toml", &self.launch(&name)),
        ];
        Running::start(&name, &files, self.cores)
    }

    fn launch(&self, name: &str) -> String {
        let period_s = self.rate.map_or(0.05, |rate| 1.0 / f64::from(rate));
        let clock = if self.rate.is_some() { "realtime" } else { "lockstep" };
        // In real time a scan belongs to the odometry of its own period.
        let slop_ms = if self.rate.is_some() { period_s * 400.0 } else { 10_000.0 };
        let keep_to = |which: usize| match self.cores {
            Cores::Two => format!("cpu_affinity = [{}]\n", cores()[which % cores().len()]),
            Cores::Any | Cores::One => String::new(),
        };
        let (first, second) = (keep_to(0), keep_to(1));
        format!(
            "robot = \"{name}\"\nclock = \"{clock}\"\nseed = 1\nfor_s = {}\nwait = \"{}\"\n\n\
             [pairing]\nslop_ms = {slop_ms}\nmax_age_ms = 10000.0\n{first}\n\
             [[process]]\nname = \"odometry\"\n{second}\n[process.parameters]\nsource = \"wheels\"\n\n\
             [[process]]\nname = \"controller\"\n{second}parameters_file = \"controller.toml\"\n\n\
             [[process]]\nname = \"simulator\"\n{first}\n[process.parameters]\nworld = \"world.toml\"\n\
             start = \"outer\"\ndt_s = {period_s}\nstop_at_collision = false\nlidar.beams = {}\n",
            self.length_s,
            self.wait.label(),
            self.beams
        )
    }

    /// The maze, and more walls in a square field around it, which no beam reaches.
    fn world(&self) -> String {
        let mut world = WORLD.to_owned();
        let columns = self.more_walls.isqrt() + 1;
        for wall in 0..self.more_walls {
            let (column, row) = (wall % columns, wall / columns);
            let (x, y) = (4.0 + 0.5 * column as f64, 4.0 + 0.5 * row as f64);
            let _ = write!(
                world,
                "\n[[box]]\nname = \"more{wall}\"\nx_m = {x}\ny_m = {y}\nsize_x_m = 0.4\nsize_y_m = 0.1\n"
            );
        }
        world
    }
}

impl Running {
    /// Starts the robot of this name from these files, of which one is `launch.toml`.
    pub(crate) fn start(name: &str, files: &[(&str, &str)], cores: Cores) -> Result<Self> {
        let namespace = Namespace::new(name)?;
        let directory = write(name, files)?;
        let said = directory.join("said");
        let output = File::create(&said).map_err(failed(&said))?;
        let error = output.try_clone().map_err(failed(&said))?;
        let mut command = own()?;
        command.arg("up").arg(directory.join("launch.toml"));
        command.arg("--report").arg(directory.join("report.json"));
        command.stdin(Stdio::null()).stdout(output).stderr(error);
        // What this process may use when it starts another is what that one may use.
        let everywhere = sched_getaffinity(None).map_err(unpinned)?;
        if cores == Cores::One {
            let mut one = CpuSet::new();
            one.set((0..CpuSet::MAX_CPU).find(|&core| everywhere.is_set(core)).unwrap_or_default());
            sched_setaffinity(None, &one).map_err(unpinned)?;
        }
        let child = command.spawn();
        sched_setaffinity(None, &everywhere).map_err(unpinned)?;
        let child = child.map_err(failed(Path::new("/proc/self/exe")))?;
        Ok(Self { namespace, directory, child, until: clock::now().after(TIMEOUT) })
    }

    /// The processes of this robot by name: the supervisor's own is that of the pairing.
    pub(crate) fn processes(&self) -> Vec<(String, u32)> {
        let supervisors = children(self.child.id());
        let nodes = supervisors.iter().flat_map(|&supervisor| children(supervisor));
        let nodes = nodes.filter_map(|process| Some((service(process)?, process)));
        let supervisors = supervisors.iter().map(|&process| ("supervisor".to_owned(), process));
        supervisors.chain(nodes).collect()
    }

    /// Waits for its end, and reads what is left.
    pub(crate) fn finish(mut self) -> Result<Ran> {
        while matches!(self.child.try_wait(), Ok(None)) {
            if 0 < signal::stop_requests() {
                return Err(Error::Fault("asked to stop".to_owned()));
            }
            if self.until < clock::now() {
                return Err(Error::Fault("a robot does not come to its end".to_owned()));
            }
            clock::nap(PAUSE);
        }
        let said = fs::read_to_string(self.directory.join("said")).unwrap_or_default();
        let path = self.directory.join("report.json");
        let report =
            fs::read_to_string(&path).ok().and_then(|text| serde_json::from_str(&text).ok());
        let report: Value =
            report.ok_or_else(|| Error::Fault(format!("a robot failed: {said}")))?;
        let is_well = report["exit"]["code"] == 0;
        if !is_well {
            return Err(Error::Fault(format!("a robot failed: {}", report["exit"]["cause"])));
        }
        let ready = said.split("READY in ").nth(1).and_then(|rest| rest.split(' ').next());
        let ready_ms = ready.and_then(|ready| ready.parse().ok()).unwrap_or(f64::NAN);
        Ok(Ran { report, ready_ms })
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        end(&mut self.child);
        let _ = fs::remove_file(self.namespace.last_words());
        self.namespace.remove();
        remove(&self.directory);
    }
}

/// Writes files for the robot of this name; returns where they are.
pub(crate) fn write(name: &str, files: &[(&str, &str)]) -> Result<PathBuf> {
    let directory = Namespace::runtime_directory().join(format!("{name}.files"));
    for (name, text) in files {
        let path = directory.join(name);
        Namespace::make(&directory).and_then(|()| fs::write(&path, text)).map_err(failed(&path))?;
    }
    Ok(directory)
}

/// Removes what [`write`] has written, and where it lies if nothing else does.
pub(crate) fn remove(directory: &Path) {
    let _ = fs::remove_dir_all(directory);
    Namespace::unmake(&Namespace::runtime_directory());
}

/// Tells a process to end, and waits until it has.
pub(crate) fn end(child: &mut Child) {
    if matches!(child.try_wait(), Ok(None)) {
        if let Some(process) = Pid::from_raw(child.id().cast_signed()) {
            let _ = rustix::process::kill_process(process, Signal::TERM);
        }
        drop(child.wait());
    }
}

/// Those whose parent is `process`; one thread of each starts others.
fn children(process: u32) -> Vec<u32> {
    let tasks = fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    let lists = tasks.filter_map(|task| fs::read_to_string(task.path().join("children")).ok());
    let ids: Vec<_> = lists
        .flat_map(|list| list.split_whitespace().map(str::to_owned).collect::<Vec<_>>())
        .filter_map(|id| id.parse().ok())
        .collect();
    ids
}

/// `simulator` of `teseo simulator …`.
fn service(process: u32) -> Option<String> {
    let line = fs::read_to_string(format!("/proc/{process}/cmdline")).ok()?;
    line.split('\0').nth(1).map(str::to_owned)
}

/// [ns] What a process has used of the processors so far, all its threads together.
pub(crate) fn processor_time(process: u32) -> Option<f64> {
    let tasks = fs::read_dir(format!("/proc/{process}/task")).ok()?.flatten();
    let times = tasks.filter_map(|task| {
        let text = fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    });
    Some(times.sum())
}

pub(crate) fn failed(path: &Path) -> impl Fn(std::io::Error) -> Error {
    let path = path.to_owned();
    move |cause| Error::File { path: path.clone(), cause }
}

fn unpinned(cause: rustix::io::Errno) -> Error {
    Error::Fault(format!("cannot keep a robot to one core: {cause}"))
}
