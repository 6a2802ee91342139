//! One hop: from one process to another, by each way there is, and what the machine itself takes.

mod bytes;
mod ours;
mod plain;
mod raw;
mod side;

use std::fmt::Write;

use hdrhistogram::Histogram;
use node::{Error, Namespace, Result, Wait};
use serde::{Deserialize, Serialize};

use crate::Effort;
use crate::measured::Values;
use crate::payload;
use crate::peers::{Part, Peers, Role, Task};

pub(crate) use side::play;

/// By which way a sample goes, and how its reader waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Way {
    /// Through `node`'s ports, polled.
    Poll,
    /// Through `node`'s ports, polled for a while and then blocking.
    Hybrid,
    /// Through `node`'s ports, polled, and the core given away in between.
    Yield,
    /// Through `node`'s ports, blocking.
    Block,
    /// iceoryx2 as its users have it, polled.
    PlainPoll,
    /// The same, and the core given away in between.
    PlainYield,
    /// iceoryx2 as its users have it: a listener in a wait set.
    PlainBlock,
    /// The same with a payload that nobody initialises, polled.
    PlainBare,
    /// A word in shared memory, looked at again and again, and the payload beside it.
    Flag,
    /// The same, and the core given away in between.
    FlagYield,
    /// A word in shared memory, slept on, and the payload beside it.
    Futex,
    /// Two named pipes.
    Pipe,
    /// A Unix domain socket.
    Socket,
}

impl Way {
    const fn label(self) -> &'static str {
        match self {
            Self::Poll => "teseo poll",
            Self::Hybrid => "teseo hybrid",
            Self::Yield => "teseo yield",
            Self::Block => "teseo block",
            Self::PlainPoll => "iceoryx2 poll",
            Self::PlainYield => "iceoryx2 yield",
            Self::PlainBlock => "iceoryx2 block",
            Self::PlainBare => "iceoryx2 bare",
            Self::Flag => "flag",
            Self::FlagYield => "flag yield",
            Self::Futex => "futex",
            Self::Pipe => "pipe",
            Self::Socket => "unix socket",
        }
    }

    const fn wait(self) -> Option<Wait> {
        match self {
            Self::Poll => Some(Wait::Poll),
            Self::Hybrid => Some(Wait::Hybrid),
            Self::Yield => Some(Wait::Yield),
            Self::Block => Some(Wait::Block),
            _ => None,
        }
    }

    /// Whether its reader looks without giving its core away: where both have one, that is no use.
    const fn keeps_its_core(self) -> bool {
        matches!(self, Self::Poll | Self::Hybrid | Self::PlainPoll | Self::PlainBare | Self::Flag)
    }
}

/// How large a sample is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Size {
    /// 64 bytes, a header and little else.
    Line,
    /// `interfaces::LaserScan` with two thirds of the beams that fit, 3,896 bytes.
    Scan,
    /// 64 KiB.
    Medium,
    /// 1 MiB, about an image.
    Large,
}

impl Size {
    const ALL: [Self; 4] = [Self::Line, Self::Scan, Self::Medium, Self::Large];

    /// [byte] With its header.
    const fn bytes(self) -> usize {
        match self {
            Self::Line => 64,
            Self::Scan => payload::SCAN,
            Self::Medium => 64 * 1024,
            Self::Large => 1024 * 1024,
        }
    }

    const fn label(self) -> &'static str {
        match self {
            Self::Line => "64 B",
            Self::Scan => "a scan",
            Self::Medium => "64 KiB",
            Self::Large => "1 MiB",
        }
    }
}

/// On which cores the two sides run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Place {
    /// Sender and readers on different ones.
    Across,
    /// All on one.
    One,
}

/// When the next sample is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Pace {
    /// As soon as the last one was answered: half of a round trip is told.
    BackToBack,
    /// Each millisecond: the time from before it was written until it was read is told.
    Millisecond,
    /// Each 25 ms, as a slow sensor does; likewise.
    Slow,
}

impl Pace {
    /// [ns] Between two samples.
    pub(crate) const fn period(self) -> Option<u64> {
        match self {
            Self::BackToBack => None,
            Self::Millisecond => Some(1_000_000),
            Self::Slow => Some(25_000_000),
        }
    }

    const fn label(self) -> &'static str {
        match self {
            Self::BackToBack => "back to back",
            Self::Millisecond => "1 kHz",
            Self::Slow => "40 Hz",
        }
    }
}

/// One configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Hop {
    pub(crate) way: Way,
    pub(crate) size: Size,
    pub(crate) place: Place,
    pub(crate) pace: Pace,
    /// [-] How many read each sample, and answer.
    pub(crate) readers: usize,
    /// Whether the payload is written in full and read in full.
    pub(crate) touched: bool,
}

impl Hop {
    const fn new(way: Way, size: Size, place: Place, when: Pace) -> Self {
        Self { way, size, place, pace: when, readers: 1, touched: true }
    }

    /// What it is called everywhere.
    pub(crate) fn name(&self) -> String {
        let place = match self.place {
            Place::Across => "across cores",
            Place::One => "one core",
        };
        let mut name =
            format!("{}, {}, {place}, {}", self.way.label(), self.size.label(), self.pace.label());
        if 1 < self.readers {
            let _ = write!(name, ", {} readers", self.readers);
        }
        if !self.touched {
            name.push_str(", not touched");
        }
        name
    }

    /// [-] Samples of one round.
    fn samples(&self, effort: Effort) -> u64 {
        let polled = self.way.keeps_its_core()
            || matches!(self.way, Way::Yield | Way::PlainYield | Way::FlagYield);
        let samples = match (self.pace, self.size) {
            (Pace::BackToBack, Size::Line | Size::Scan) if polled => 20_000,
            (Pace::BackToBack, Size::Medium) if polled => 2_000,
            (Pace::BackToBack, Size::Large) if !self.touched => 1_000,
            (Pace::BackToBack, Size::Large) => 150,
            (Pace::BackToBack, _) => 800,
            (Pace::Millisecond, _) => 250,
            (Pace::Slow, _) => 15,
        };
        match effort {
            Effort::Whole => samples,
            Effort::Quick => (samples / 20).max(10),
        }
    }

    fn part(&self, role: Role, effort: Effort) -> Part {
        Part { task: Task::Hop(*self), role, samples: self.samples(effort) }
    }

    /// One round of it, in processes of its own.
    pub(crate) fn measure(&self, namespace: &Namespace, effort: Effort) -> Result<Values> {
        let roles = (0..self.readers).map(Role::Reader).chain([Role::Sender]);
        let parts: Vec<_> = roles.map(|role| self.part(role, effort)).collect();
        let mut all: Option<Histogram<u64>> = None;
        for histogram in Peers::start(namespace, &parts)?.wait()?.into_iter().flatten() {
            match &mut all {
                Some(all) => all.add(histogram).map_err(|cause| Error::Fault(cause.to_string()))?,
                None => all = Some(histogram),
            }
        }
        let all = all.ok_or_else(|| Error::Fault("nobody measured".to_owned()))?;
        Ok(Values::Many(all))
    }
}

/// Every configuration that `cores` can bear, and what is left out, with the reason.
pub(crate) fn configurations(cores: usize) -> (Vec<Hop>, Vec<String>) {
    let mut hops = Vec::new();
    back_to_back(&mut hops);
    paced(&mut hops);
    several_readers(&mut hops);
    untouched(&mut hops);
    let mut absent = Vec::new();
    if cores < 2 {
        hops.retain(|hop| hop.place == Place::One);
        absent.push("hops across cores: this process may run on one only".to_owned());
    }
    absent.push(
        "hops on one core with poll and hybrid: who looks keeps the core from whom he waits for"
            .to_owned(),
    );
    (hops, absent)
}

/// How far it is from one core to another: of what lock-step does in a step, most is on this way.
pub(crate) const FLAG: Hop = Hop::new(Way::Flag, Size::Line, Place::Across, Pace::BackToBack);

/// What a futex wake-up takes at the paces of a robot: what its whole loop is compared with.
pub(crate) fn floors() -> [Hop; 2] {
    [Pace::Millisecond, Pace::Slow]
        .map(|pace| Hop::new(Way::Futex, Size::Line, Place::Across, pace))
}

fn back_to_back(hops: &mut Vec<Hop>) {
    let across = [
        Way::Flag,
        Way::PlainPoll,
        Way::Poll,
        Way::Hybrid,
        Way::Futex,
        Way::PlainBlock,
        Way::Block,
        Way::Socket,
        Way::Pipe,
    ];
    let one = [
        Way::Futex,
        Way::FlagYield,
        Way::PlainYield,
        Way::Yield,
        Way::PlainBlock,
        Way::Block,
        Way::Socket,
        Way::Pipe,
    ];
    for size in Size::ALL {
        hops.extend(across.map(|way| Hop::new(way, size, Place::Across, Pace::BackToBack)));
    }
    for size in [Size::Line, Size::Scan] {
        hops.extend(one.map(|way| Hop::new(way, size, Place::One, Pace::BackToBack)));
    }
}

fn paced(hops: &mut Vec<Hop>) {
    let ways = [Way::Futex, Way::PlainBlock, Way::Block, Way::Hybrid, Way::Poll, Way::Socket];
    for pace in [Pace::Millisecond, Pace::Slow] {
        hops.extend(ways.map(|way| Hop::new(way, Size::Line, Place::Across, pace)));
    }
}

fn several_readers(hops: &mut Vec<Hop>) {
    for readers in [2, 4] {
        let hop =
            |way, place| Hop { readers, ..Hop::new(way, Size::Scan, place, Pace::BackToBack) };
        hops.push(hop(Way::PlainBlock, Place::Across));
        hops.push(hop(Way::Block, Place::Across));
        hops.push(hop(Way::PlainYield, Place::One));
        hops.push(hop(Way::Yield, Place::One));
    }
}

fn untouched(hops: &mut Vec<Hop>) {
    for way in [Way::PlainBare, Way::PlainPoll, Way::Poll] {
        for size in [Size::Line, Size::Medium, Size::Large] {
            let hop = Hop::new(way, size, Place::Across, Pace::BackToBack);
            hops.push(Hop { touched: false, ..hop });
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn no_two_configurations_have_one_name() {
        let (hops, _) = configurations(2);
        let names: BTreeSet<_> = hops.iter().map(Hop::name).collect();
        assert_eq!(names.len(), hops.len());
    }

    #[test]
    fn one_core_leaves_out_what_needs_two_and_says_so() {
        let (hops, absent) = configurations(1);
        assert!(hops.iter().all(|hop| hop.place == Place::One && !hop.way.keeps_its_core()));
        assert_eq!(absent.len(), 2);
    }
}
