//! The robots of this user: which run, what those that do not have left, and where they live.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use node::{Namespace, SharedMemory};
use rustix::fs::FlockOperation;

use super::finding::{Finding, Level, mebibytes};
use super::machine::{Machine, RuntimeState};
use super::needs::Needs;
use crate::sweep;

/// The robots of this user.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Robots {
    running: Vec<Running>,
    stale: Vec<Stale>,
    /// What is in shared memory and no robot's, by prefix.
    orphans: BTreeMap<String, SharedMemory>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Running {
    robot: String,
    directory: PathBuf,
    /// As it says itself; empty in its first moment.
    process: String,
    /// Whether it lies where this user's robots do.
    is_own: bool,
}

/// A robot that does not run, and has left its directory.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Stale {
    robot: String,
    directory: PathBuf,
    shared_memory: SharedMemory,
}

/// One robot's directory, as it was found.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Place {
    robot: String,
    directory: PathBuf,
    prefix: String,
    /// Who holds the lock.
    holder: Option<String>,
    /// Whether it lies where this user's robots do.
    is_own: bool,
}

/// Who lives, by the system's list of processes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Living {
    /// Of the files in shared memory that somebody uses.
    prefixes: BTreeSet<String>,
    /// Of the robots whose nodes they are.
    directories: BTreeSet<PathBuf>,
    /// Where else robots may be.
    runtimes: BTreeSet<PathBuf>,
}

impl Robots {
    pub(super) fn read(runtime: &Path) -> Self {
        // Files first, processes second, files again: what was made in between somebody uses, and
        // what was removed in between is nobody's waste.
        let before = Namespace::shared_memory_of_all();
        let living = Living::read();
        let mut places = BTreeMap::new();
        let runtimes = living.runtimes.iter().map(PathBuf::as_path).chain([runtime]);
        let marked = living.directories.iter().filter_map(|directory| Namespace::at(directory));
        for namespace in runtimes.flat_map(Namespace::all_under).chain(marked) {
            let place = Place::read(&namespace, runtime);
            places.insert(place.directory.clone(), place);
        }
        let mut after = Namespace::shared_memory_of_all();
        after.retain(|prefix, _| before.contains_key(prefix));
        Self::sort(places.into_values(), &living, after)
    }

    /// Tells the running from the stale, and what belongs to neither.
    fn sort(
        places: impl Iterator<Item = Place>,
        living: &Living,
        mut shared_memory: BTreeMap<String, SharedMemory>,
    ) -> Self {
        let mut robots = Self::default();
        shared_memory.retain(|prefix, _| !living.prefixes.contains(prefix));
        for place in places {
            let held = shared_memory.remove(&place.prefix).unwrap_or_default();
            let Place { robot, directory, prefix, holder, is_own } = place;
            let is_used =
                living.prefixes.contains(&prefix) || living.directories.contains(&directory);
            if let Some(process) = holder {
                robots.running.push(Running { robot, directory, process, is_own });
            } else if is_own && !is_used {
                robots.stale.push(Stale { robot, directory, shared_memory: held });
            }
        }
        robots.orphans = shared_memory;
        robots
    }
}

impl Place {
    fn read(namespace: &Namespace, runtime: &Path) -> Self {
        Self {
            robot: namespace.robot().to_owned(),
            directory: namespace.directory().to_owned(),
            prefix: namespace.prefix().to_owned(),
            holder: holder(&namespace.lock()),
            is_own: namespace.directory().parent() == Some(runtime),
        }
    }
}

/// Who holds the robot's lock, if anybody does. To know, it is taken for a moment, which harms
/// nobody: a supervisor that comes just then tries again where a dead one's number is in the file.
fn holder(lock: &Path) -> Option<String> {
    let file = File::open(lock).ok()?;
    match rustix::fs::flock(&file, FlockOperation::NonBlockingLockShared) {
        Ok(()) => None,
        Err(_) => Some(fs::read_to_string(lock).unwrap_or_default().trim().to_owned()),
    }
}

impl Living {
    fn read() -> Self {
        let mut living = Self::default();
        let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
        for process in processes.map(|entry| entry.path()) {
            // Those of other users are not for us to read, nor are their files.
            let environment = fs::read(process.join("environ")).unwrap_or_default();
            let maps = fs::read(process.join("maps")).unwrap_or_default();
            living.note(&String::from_utf8_lossy(&environment), &String::from_utf8_lossy(&maps));
        }
        living
    }

    /// What one process says of itself in its environment, and the files that it maps.
    fn note(&mut self, environment: &str, maps: &str) {
        for entry in environment.split('\0') {
            match entry.split_once('=') {
                Some((sweep::MARK, directory)) => {
                    self.directories.insert(PathBuf::from(directory));
                }
                Some(("TESEO_RUNTIME_DIR", runtime)) => {
                    self.runtimes.insert(PathBuf::from(runtime));
                }
                _ => {}
            }
        }
        let names = maps.lines().filter_map(|line| line.split_once("/dev/shm/"));
        let prefixes = names.filter_map(|(_, name)| Namespace::prefix_of(name));
        self.prefixes.extend(prefixes.map(str::to_owned));
    }
}

/// What robots that do not run any more have left.
pub(super) fn former_runs(robots: &Robots) -> Finding {
    let what = "former runs";
    if robots.stale.is_empty() && robots.orphans.is_empty() {
        return Finding::ok(what, "nothing is left of them");
    }
    let stale = robots.stale.iter().map(|stale| {
        let SharedMemory { files, bytes } = stale.shared_memory;
        let directory = stale.directory.display();
        let memory = mebibytes(bytes);
        format!("{directory} of '{}', with {files} files of {memory}", stale.robot)
    });
    let orphans = robots.orphans.iter().map(|(prefix, held)| {
        let memory = mebibytes(held.bytes);
        format!("/dev/shm/{prefix}*, {} files of {memory} whose robot is gone", held.files)
    });
    let found: Vec<_> = stale.chain(orphans).collect();
    // The next run of a robot removes what the last one left; an orphan is nobody's to remove.
    let level = if robots.orphans.is_empty() { Level::Note } else { Level::Warning };
    let mut finding = Finding::new(level, what, found.join("; "));
    for stale in &robots.stale {
        finding = finding.mend(format!("teseo clear --robot {}", stale.robot));
    }
    // A prefix is one robot's alone, and so names its files exactly.
    let removals = robots.orphans.keys().map(|prefix| format!("rm /dev/shm/{prefix}*"));
    removals.fold(finding, Finding::mend)
}

/// Who runs beside the robot that is to come.
pub(super) fn running(robots: &Robots) -> Finding {
    let what = "running robots";
    if robots.running.is_empty() {
        return Finding::ok(what, "none of this user's");
    }
    let describe = |running: &Running| {
        let Running { robot, directory, process, .. } = running;
        format!("'{robot}' by process {process} in {}", directory.display())
    };
    let found: Vec<_> = robots.running.iter().map(describe).collect();
    let found = found.join("; ");
    // One that lives elsewhere may be somebody else's, and well.
    let mut own = robots.running.iter().filter(|running| running.is_own).peekable();
    if own.peek().is_none() {
        return Finding::ok(what, found);
    }
    own.map(Running::down).fold(Finding::note(what, found), Finding::mend)
}

impl Running {
    /// The command that takes it down.
    fn down(&self) -> String {
        format!("teseo down --robot {}", self.robot)
    }
}

/// Whether robots can have their directories, for this user alone.
pub(super) fn runtime_directory(machine: &Machine, needs: Option<&Needs>) -> Finding {
    let what = "runtime directory";
    let user = machine.user.id;
    let path = machine.runtime.path.display();
    let robot = needs.map_or("burger", |needs| needs.robot.as_str());
    let length = machine.runtime.path.join(robot).as_os_str().len();
    let length_max = Namespace::DIRECTORY_LENGTH_MAX;
    let elsewhere = format!("export TESEO_RUNTIME_DIR=/tmp/teseo-{user}");
    let failure = |found: String| Finding::new(Level::Failure, what, found);
    if length_max < length {
        let found = format!("{path} with '{robot}' has {length} bytes, {length_max} at most");
        return failure(found).mend(elsewhere);
    }
    let fits = format!("{length} of {length_max} bytes with '{robot}'");
    match machine.runtime.state {
        RuntimeState::Absent { can_be: false } => {
            failure(format!("{path} is not there and cannot be made")).mend(elsewhere)
        }
        RuntimeState::Absent { can_be: true } => {
            Finding::ok(what, format!("{path}, made when a robot runs; {fits}"))
        }
        RuntimeState::Present { owner, .. } if owner != user => {
            failure(format!("{path} belongs to user {owner}, not to {user}")).mend(elsewhere)
        }
        RuntimeState::Present { mode: 0o700, .. } => {
            Finding::ok(what, format!("{path}, mode 0700; {fits}"))
        }
        RuntimeState::Present { mode, .. } => {
            // Who can write there can put a robot's directory in our place.
            let level = if mode & 0o022 == 0 { Level::Note } else { Level::Warning };
            Finding::new(level, what, format!("{path}, mode {mode:04o} instead of 0700; {fits}"))
                .mend(format!("chmod 700 {path}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HELD: SharedMemory = SharedMemory { files: 3, bytes: 3 << 20 };

    fn place(robot: &str, holder: Option<&str>) -> Place {
        Place {
            robot: robot.to_owned(),
            directory: PathBuf::from("/run/user/1000/teseo").join(robot),
            prefix: format!("teseo0100_{robot}_"),
            holder: holder.map(str::to_owned),
            is_own: true,
        }
    }

    fn memory(prefixes: &[&str]) -> BTreeMap<String, SharedMemory> {
        prefixes.iter().map(|&prefix| (prefix.to_owned(), HELD)).collect()
    }

    #[test]
    fn a_running_robot_s_files_are_no_waste() {
        let places = [place("burger", Some("12041"))].into_iter();
        let robots = Robots::sort(places, &Living::default(), memory(&["teseo0100_burger_"]));

        assert_eq!(former_runs(&robots).level, Level::Ok);
        let finding = running(&robots);
        assert_eq!(finding.level, Level::Note);
        assert!(finding.found.contains("'burger' by process 12041"), "{finding:?}");
        assert_eq!(finding.mend, ["teseo down --robot burger"]);
    }

    #[test]
    fn a_robot_that_runs_elsewhere_is_told_of_and_left_alone() {
        let place = Place { is_own: false, ..place("burger", Some("12041")) };
        let robots = Robots::sort([place].into_iter(), &Living::default(), memory(&[]));

        let finding = running(&robots);
        assert!(finding.found.contains("in /run/user/1000/teseo/burger"), "{finding:?}");
        assert!(finding.level == Level::Ok && finding.mend.is_empty(), "{finding:?}");
    }

    #[test]
    fn a_robot_that_does_not_run_is_stale_unless_somebody_uses_its_files() {
        let burger = || [place("burger", None)].into_iter();
        let all = || memory(&["teseo0100_burger_"]);

        let robots = Robots::sort(burger(), &Living::default(), all());
        let finding = former_runs(&robots);
        assert_eq!(finding.level, Level::Note);
        assert!(finding.found.contains("3 files of 3.0 MiB"), "{finding:?}");
        assert_eq!(finding.mend, ["teseo clear --robot burger"]);

        let mut living = Living::default();
        living.note("", "7f00-7f01 rw-s 0 00:1b 7 /dev/shm/teseo0100_0123abcd_node\n");
        living.prefixes.insert("teseo0100_burger_".to_owned());
        let robots = Robots::sort(burger(), &living, all());
        assert_eq!(robots, Robots::default());

        let mut living = Living::default();
        living.note("A=1\0TESEO_ROBOT_DIRECTORY=/run/user/1000/teseo/burger\0", "");
        let robots = Robots::sort(burger(), &living, all());
        assert_eq!(robots, Robots::default());
    }

    #[test]
    fn files_of_a_robot_without_a_directory_are_removed_by_their_prefix() {
        let name = "teseo0100_0123abcd_";
        let robots = Robots::sort(std::iter::empty(), &Living::default(), memory(&[name]));
        let finding = former_runs(&robots);
        assert_eq!(finding.level, Level::Warning);
        assert_eq!(finding.mend, ["rm /dev/shm/teseo0100_0123abcd_*"]);

        let mut living = Living::default();
        living.note("", "7f00-7f01 rw-s 0 00:1b 7 /dev/shm/teseo0100_0123abcd_node\n");
        let robots = Robots::sort(std::iter::empty(), &living, memory(&[name]));
        assert_eq!(robots, Robots::default());
    }

    #[test]
    fn a_runtime_directory_is_the_user_s_alone_and_short() {
        let present = |owner, mode| RuntimeState::Present { owner, mode };
        for (state, level) in [
            (present(1000, 0o700), Level::Ok),
            (present(1000, 0o755), Level::Note),
            (present(1000, 0o777), Level::Warning),
            (present(1001, 0o700), Level::Failure),
            (RuntimeState::Absent { can_be: true }, Level::Ok),
            (RuntimeState::Absent { can_be: false }, Level::Failure),
        ] {
            let mut machine = Machine::good();
            machine.runtime.state = state;
            let finding = runtime_directory(&machine, None);

            assert_eq!(finding.level, level, "{finding:?}");
            assert_eq!(finding.mend.is_empty(), level == Level::Ok, "{finding:?}");
        }
        let mut machine = Machine::good();
        machine.runtime.path = PathBuf::from(format!("/tmp/{}", "x".repeat(40)));
        assert_eq!(runtime_directory(&machine, None).level, Level::Failure);
    }
}
