//! What this machine and this user are like, as far as it matters to a robot.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use node::Namespace;
use rustix::process::{Resource, getrlimit};
use rustix::thread::CapabilitySet;

use super::logind;
use crate::shim;

/// The facts, none of them judged.
#[derive(Debug, Clone)]
pub(super) struct Machine {
    pub(super) user: User,
    /// `None` where there is no shared memory.
    pub(super) shared_memory: Option<Space>,
    /// [byte] What a process may lock if it asks for all it can get; `None` is no limit.
    pub(super) memory_lock_limit: Option<u64>,
    /// [byte] The memory of a process of this executable that does nothing.
    pub(super) own_memory: u64,
    /// [-] The highest real-time priority that this user may have.
    pub(super) priority_limit: u64,
    pub(super) has_chrt: bool,
    /// [-] Open at once, in each process; `None` is no limit.
    pub(super) files_limit: Option<u64>,
    /// The group that owns serial ports.
    pub(super) dialout: Option<Group>,
    pub(super) logind_removes: bool,
    pub(super) systemd: Option<u32>,
    /// Whether it runs this machine, not only lies on it.
    pub(super) is_systemd_running: bool,
    /// Empty where frequencies cannot be seen.
    pub(super) governors: BTreeSet<String>,
    pub(super) clock_source: Option<String>,
    pub(super) processors: BTreeSet<usize>,
    pub(super) runtime: Runtime,
}

/// Who asks, and what is allowed to them.
#[derive(Debug, Clone)]
pub(super) struct User {
    pub(super) id: u32,
    pub(super) name: String,
    pub(super) groups: BTreeSet<u32>,
    pub(super) lingers: bool,
    pub(super) ignores_memory_lock_limit: bool,
    pub(super) ignores_priority_limit: bool,
}

/// A group of users.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    pub(super) id: u32,
    /// Whether the user belongs to it from the next login on.
    pub(super) has_user: bool,
}

/// Shared memory as a whole.
#[derive(Debug, Clone, Copy)]
pub(super) struct Space {
    /// [byte]
    pub(super) size: u64,
    /// [byte]
    pub(super) free: u64,
}

/// The directory of all robots of this user.
#[derive(Debug, Clone)]
pub(super) struct Runtime {
    pub(super) path: PathBuf,
    pub(super) state: RuntimeState,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RuntimeState {
    /// It is made by the first robot, where that `can_be`.
    Absent { can_be: bool },
    /// Owner and permissions.
    Present { owner: u32, mode: u32 },
}

impl Machine {
    pub(super) fn read() -> Self {
        let user = User::read();
        let size = Namespace::size().ok();
        Self {
            shared_memory: size
                .zip(Namespace::free().ok())
                .map(|(size, free)| Space { size, free }),
            // A node's own process raises its limit as far as it may.
            memory_lock_limit: getrlimit(Resource::Memlock).maximum,
            own_memory: own_memory(),
            priority_limit: getrlimit(Resource::Rtprio).current.unwrap_or(99),
            has_chrt: shim::find_program("chrt").is_ok(),
            files_limit: getrlimit(Resource::Nofile).current,
            dialout: Group::read("dialout", &user.name),
            logind_removes: logind::removes_shared_memory(Path::new("/")),
            systemd: systemd_version(),
            is_systemd_running: Path::new("/run/systemd/system").is_dir(),
            governors: governors(),
            clock_source: line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
            processors: processors(),
            runtime: Runtime::read(),
            user,
        }
    }
}

impl User {
    fn read() -> Self {
        let id = rustix::process::getuid().as_raw();
        let passwd = fs::read_to_string("/etc/passwd").unwrap_or_default();
        let own_line = passwd.lines().find(|line| line.split(':').nth(2) == Some(&id.to_string()));
        let name = own_line.and_then(|line| line.split(':').next());
        let name = name.map_or_else(|| id.to_string(), str::to_owned);
        let mut groups: BTreeSet<_> = rustix::process::getgroups()
            .unwrap_or_default()
            .into_iter()
            .map(rustix::process::Gid::as_raw)
            .collect();
        groups.insert(rustix::process::getegid().as_raw());
        let capabilities = rustix::thread::capabilities(None).map(|sets| sets.effective);
        let may = |capability| capabilities.is_ok_and(|effective| effective.contains(capability));
        Self {
            lingers: Path::new("/var/lib/systemd/linger").join(&name).exists(),
            ignores_memory_lock_limit: may(CapabilitySet::IPC_LOCK),
            ignores_priority_limit: may(CapabilitySet::SYS_NICE),
            id,
            name,
            groups,
        }
    }
}

impl Group {
    fn read(name: &str, user: &str) -> Option<Self> {
        let groups = fs::read_to_string("/etc/group").ok()?;
        // Name, password, number and members, with colons between.
        let mut fields = groups
            .lines()
            .map(|line| line.split(':'))
            .find_map(|mut fields| (fields.next() == Some(name)).then_some(fields))?;
        let id = fields.nth(1)?.parse().ok()?;
        let has_user = fields.next()?.split(',').any(|member| member == user);
        Some(Self { id, has_user })
    }
}

impl Runtime {
    fn read() -> Self {
        let path = Namespace::runtime_directory();
        let state = if let Ok(file) = fs::metadata(&path) {
            RuntimeState::Present { owner: file.uid(), mode: file.mode() & 0o777 }
        } else {
            let above = path.ancestors().find(|above| above.is_dir());
            let access = rustix::fs::Access::WRITE_OK;
            let can_be = above.is_some_and(|above| rustix::fs::access(above, access).is_ok());
            RuntimeState::Absent { can_be }
        };
        Self { path, state }
    }
}

/// [byte] All that is mapped, which is what counts when all is locked.
fn own_memory() -> u64 {
    let statm = fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: Option<u64> = statm.split(' ').next().and_then(|pages| pages.parse().ok());
    pages.unwrap_or_default() * rustix::param::page_size() as u64
}

fn systemd_version() -> Option<u32> {
    let output =
        Command::new("systemctl").arg("--version").stdin(Stdio::null()).output().ok()?.stdout;
    version_in(&String::from_utf8_lossy(&output))
}

/// Of `systemd 252 (252.38-1~deb12u1)`.
fn version_in(text: &str) -> Option<u32> {
    let number = text.strip_prefix("systemd ")?;
    number.split(|letter: char| !letter.is_ascii_digit()).next()?.parse().ok()
}

fn governors() -> BTreeSet<String> {
    let entries = fs::read_dir("/sys/devices/system/cpu").into_iter().flatten().flatten();
    entries.filter_map(|entry| line(entry.path().join("cpufreq/scaling_governor"))).collect()
}

fn processors() -> BTreeSet<usize> {
    let online = line("/sys/devices/system/cpu/online").unwrap_or_default();
    let processors = numbers_in(&online);
    if !processors.is_empty() {
        return processors;
    }
    (0..std::thread::available_parallelism().map_or(1, std::num::NonZero::get)).collect()
}

/// Of the kernel's lists, `0-3,8`.
fn numbers_in(list: &str) -> BTreeSet<usize> {
    let ranges = list.split(',').filter_map(|range| {
        let (low, high) = range.split_once('-').unwrap_or((range, range));
        Some(low.trim().parse().ok()?..=high.trim().parse().ok()?)
    });
    ranges.flatten().collect()
}

fn line(path: impl AsRef<Path>) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

#[cfg(test)]
impl Machine {
    /// One that no robot has anything against.
    pub(super) fn good() -> Self {
        Self {
            user: User {
                id: 1000,
                name: "ada".to_owned(),
                groups: BTreeSet::from([20, 1000]),
                lingers: true,
                ignores_memory_lock_limit: false,
                ignores_priority_limit: false,
            },
            shared_memory: Some(Space { size: 64 << 20, free: 63 << 20 }),
            memory_lock_limit: None,
            own_memory: 8 << 20,
            priority_limit: 99,
            has_chrt: true,
            files_limit: Some(1024),
            dialout: Some(Group { id: 20, has_user: true }),
            logind_removes: true,
            systemd: Some(257),
            is_systemd_running: true,
            governors: BTreeSet::from(["performance".to_owned()]),
            clock_source: Some("tsc".to_owned()),
            processors: BTreeSet::from([0, 1, 2, 3]),
            runtime: Runtime {
                path: PathBuf::from("/run/user/1000/teseo"),
                state: RuntimeState::Present { owner: 1000, mode: 0o700 },
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_s_lists_of_processors_are_read() {
        let table: [(&str, &[usize]); 5] = [
            ("0", &[0]),
            ("0-3", &[0, 1, 2, 3]),
            ("0-1,4,6-7", &[0, 1, 4, 6, 7]),
            ("", &[]),
            ("some", &[]),
        ];
        for (list, expected) in table {
            assert_eq!(numbers_in(list), expected.iter().copied().collect(), "{list}");
        }
    }

    #[test]
    fn systemd_s_version_is_read_from_its_first_line() {
        let table = [
            ("systemd 252 (252.38-1~deb12u1)\n+PAM", Some(252)),
            ("systemd 257~rc1", Some(257)),
            ("systemctl: command not found", None),
            ("", None),
        ];
        for (text, expected) in table {
            assert_eq!(version_in(text), expected, "{text}");
        }
    }
}
