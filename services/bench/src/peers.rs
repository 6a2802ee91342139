//! The processes that measure: this executable again, in roles of its own, each pinned to a core.

use std::fs;
use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use hdrhistogram::Histogram;
use node::{Error, Namespace, Result, clock, signal};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::Signal;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde::{Deserialize, Serialize};

use crate::hop::{self, Hop, Place};
use crate::measured::history;
use crate::ticket::{self, Payload};

/// Names the robot whose shared memory the measuring processes use.
const NAMESPACE: &str = "TESEO_BENCH_ROBOT";

/// What this process is to do where it is one that measures.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    pub(crate) task: Task,
    pub(crate) role: Role,
    /// [-] Samples that count.
    pub(crate) samples: u64,
}

/// What is measured.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Task {
    /// One hop.
    Hop(Hop),
    /// A pair by ticket.
    Ticket(Payload),
}

/// Which side of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Role {
    /// Sends.
    Sender,
    /// Reads, as number so and so.
    Reader(usize),
}

impl Role {
    pub(crate) fn name(self) -> String {
        match self {
            Self::Sender => "sender".to_owned(),
            Self::Reader(index) => format!("reader{index}"),
        }
    }
}

/// The processors that this process may run on.
pub(crate) fn cores() -> Vec<usize> {
    let set = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
    let cores: Vec<_> = (0..CpuSet::MAX_CPU).filter(|&core| set.is_set(core)).collect();
    if cores.is_empty() { vec![0] } else { cores }
}

impl Part {
    /// The sender has a core to itself where the sides are to lie apart.
    fn core(&self, cores: &[usize]) -> usize {
        let place = match &self.task {
            Task::Hop(hop) => hop.place,
            Task::Ticket(_) => Place::Across,
        };
        match (place, self.role) {
            (Place::One, _) | (_, Role::Sender) => cores[0],
            (Place::Across, Role::Reader(index)) => match cores.len() {
                1 => cores[0],
                count => cores[1 + index % (count - 1)],
            },
        }
    }

    fn encoded(&self) -> Result<String> {
        serde_json::to_string(self).map_err(|cause| Error::Fault(cause.to_string()))
    }
}

impl std::str::FromStr for Part {
    type Err = serde_json::Error;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        serde_json::from_str(text)
    }
}

/// What a process does that [`Peers::start`] has started.
pub(crate) fn play(part: &Part) -> Result {
    node::die_with_parent(Signal::KILL);
    let robot = std::env::var(NAMESPACE)
        .map_err(|_| Error::Fault("only `teseo bench` starts this".to_owned()))?;
    let namespace = Namespace::new(&robot)?;
    let mut set = CpuSet::new();
    set.set(part.core(&cores()));
    sched_setaffinity(None, &set)
        .map_err(|cause| Error::Fault(format!("cannot keep to one core: {cause}")))?;
    let histograms = match &part.task {
        Task::Hop(hop) => vec![hop::play(hop, part, &namespace)?],
        Task::Ticket(payload) => ticket::play(*payload, part, &namespace)?,
    };
    let counts: Vec<Vec<[u64; 2]>> = histograms.iter().map(counts).collect();
    let text = serde_json::to_string(&counts).map_err(|cause| Error::Fault(cause.to_string()))?;
    let path = result_file(&namespace, part.role);
    fs::write(&path, text).map_err(|cause| Error::File { path, cause })?;
    let said = std::io::stdout().write_all(b".").and_then(|()| std::io::stdout().flush());
    said.map_err(|cause| Error::File { path: "standard output".into(), cause })?;
    // What was sent last stays readable until all have read it.
    let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
    Ok(())
}

/// Each value and how often it came.
fn counts(histogram: &Histogram<u64>) -> Vec<[u64; 2]> {
    let values = histogram.iter_recorded();
    values.map(|value| [value.value_iterated_to(), value.count_at_value()]).collect()
}

fn result_file(namespace: &Namespace, role: Role) -> PathBuf {
    namespace.directory().join(format!("{}.json", role.name()))
}

/// How long a measurement may take altogether.
const TIMEOUT: Duration = Duration::from_secs(90);

/// The processes of one measurement. Killed, and their shared memory removed, when dropped.
pub(crate) struct Peers<'a> {
    namespace: &'a Namespace,
    peers: Vec<Peer>,
}

struct Peer {
    role: Role,
    child: Child,
    has_measured: bool,
}

impl<'a> Peers<'a> {
    pub(crate) fn start(namespace: &'a Namespace, parts: &[Part]) -> Result<Self> {
        namespace.create_directory()?;
        let mut peers = Self { namespace, peers: Vec::new() };
        for part in parts {
            let mut command = own()?;
            command.args(["bench", "--part", &part.encoded()?]);
            command.env(NAMESPACE, namespace.robot());
            command.stdin(Stdio::piped()).stdout(Stdio::piped());
            let failed = |cause| Error::File { path: "/proc/self/exe".into(), cause };
            let child = command.spawn().map_err(failed)?;
            peers.peers.push(Peer { role: part.role, child, has_measured: false });
        }
        Ok(peers)
    }

    /// What each has measured, in the order of the parts. Nothing wakes this process meanwhile: a
    /// look each few milliseconds would show in what is measured.
    pub(crate) fn wait(mut self) -> Result<Vec<Vec<Histogram<u64>>>> {
        let until = clock::now().after(TIMEOUT);
        while self.peers.iter().any(|peer| !peer.has_measured) {
            self.sleep(until.since(clock::now()));
            if 0 < signal::stop_requests() {
                return Err(Error::Fault("asked to stop".to_owned()));
            }
            if until < clock::now() {
                return Err(Error::Fault("a measurement does not come to its end".to_owned()));
            }
            for peer in &mut self.peers {
                peer.look()?;
            }
        }
        for peer in &mut self.peers {
            drop(peer.child.stdin.take());
            drop(peer.child.wait());
        }
        self.peers.iter().map(|peer| read_results(self.namespace, peer.role)).collect()
    }

    /// Until one of them has something to say, or this process is asked to stop.
    fn sleep(&self, timeout: Duration) {
        let silent = self.peers.iter().filter(|peer| !peer.has_measured);
        let outputs = silent.filter_map(|peer| peer.child.stdout.as_ref());
        let outputs = outputs.map(|output| PollFd::new(output, PollFlags::IN));
        let wake = signal::wake().map(|wake| PollFd::new(wake, PollFlags::IN));
        let mut polled: Vec<_> = outputs.chain(wake).collect();
        let Ok(timeout) = rustix::time::Timespec::try_from(timeout) else { return };
        let _ = poll(&mut polled, Some(&timeout));
    }
}

impl Peer {
    /// Whether it has measured: it says so with one byte, and says nothing where it has failed.
    fn look(&mut self) -> Result {
        let Some(output) = self.child.stdout.as_mut().filter(|_| !self.has_measured) else {
            return Ok(());
        };
        let mut polled = [PollFd::new(output, PollFlags::IN)];
        let now = rustix::time::Timespec { tv_sec: 0, tv_nsec: 0 };
        if !matches!(poll(&mut polled, Some(&now)), Ok(1..)) {
            return Ok(());
        }
        if output.read(&mut [0]).is_ok_and(|length| length == 1) {
            self.has_measured = true;
            return Ok(());
        }
        Err(Error::Fault(format!("the {} has failed", self.role.name())))
    }
}

impl Drop for Peers<'_> {
    fn drop(&mut self) {
        for peer in &mut self.peers {
            // Both fail only where it has ended already.
            drop(peer.child.kill());
            drop(peer.child.wait());
        }
        self.namespace.remove();
    }
}

fn read_results(namespace: &Namespace, role: Role) -> Result<Vec<Histogram<u64>>> {
    let path = result_file(namespace, role);
    let text = fs::read_to_string(&path).map_err(|cause| Error::File { path, cause })?;
    let counts: Vec<Vec<[u64; 2]>> =
        serde_json::from_str(&text).map_err(|cause| Error::Fault(cause.to_string()))?;
    let filled = counts.into_iter().map(|counts| {
        let mut histogram = history()?;
        for [value, count] in counts {
            histogram.record_n(value, count).map_err(|cause| Error::Fault(cause.to_string()))?;
        }
        Ok(histogram)
    });
    filled.collect()
}

/// This executable again, which ends when this process does.
pub(crate) fn own() -> Result<Command> {
    let failed = |cause| Error::File { path: "/proc/self/exe".into(), cause };
    let mut command = Command::new(std::env::current_exe().map_err(failed)?);
    command.env(node::PARENT, std::process::id().to_string());
    Ok(command)
}
