//! A pair by ticket: one process sends a payload and an odometry sample, another pairs and finds
//! both where they lie. The cost must not grow with the payload.

use std::time::Duration;

use hdrhistogram::Histogram;
use interfaces::topics::{ODOMETRY, SENSOR_PAIR};
use interfaces::{Header, Stamp, Topic};
use node::pairing::{Bounds, Config, Entry, Pairing, Policy};
use node::{Error, Namespace, Result, Session, clock};
use serde::{Deserialize, Serialize};

use crate::Effort;
use crate::measured::{Values, history};
use crate::payload::{Large, Medium, Small, Words, expected, sum, word};
use crate::peers::{Part, Peers, Role, Task};

/// [-] Pairs of one measurement.
const PAIRS: u64 = 500;

/// [-] The same, for a quick look.
const PAIRS_QUICK: u64 = 20;

/// Between two pairs: the sender has time to fill the payload.
const PERIOD: Duration = Duration::from_millis(1);

/// A measurement takes some seconds; after this long the other side is not coming.
const TIMEOUT: Duration = Duration::from_secs(30);

/// As long as anybody watches.
const DEADLINE: Duration = Duration::from_secs(1);

const SMALL: Topic<Small> = Topic::new("payload", 4, DEADLINE, "bench");
const MEDIUM: Topic<Medium> = Topic::new("payload", 4, DEADLINE, "bench");
const LARGE: Topic<Large> = Topic::new("payload", 4, DEADLINE, "bench");

/// How large a sample is that nobody copies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Payload {
    /// 1 KiB, about a scan.
    Small,
    /// 64 KiB.
    Medium,
    /// 1 MiB, about an image.
    Large,
}

impl Payload {
    /// Every one.
    pub(crate) const ALL: [Self; 3] = [Self::Small, Self::Medium, Self::Large];

    /// What is measured with it: until both samples were found, and until the payload was read.
    pub(crate) fn names(self) -> [String; 2] {
        let size = match self {
            Self::Small => "1 KiB",
            Self::Medium => "64 KiB",
            Self::Large => "1 MiB",
        };
        ["found", "found and read"].map(|what| format!("a pair by ticket, {size}, {what}"))
    }

    /// One round, in processes of its own.
    pub(crate) fn measure(self, namespace: &Namespace, effort: Effort) -> Result<[Values; 2]> {
        let samples = match effort {
            Effort::Whole => PAIRS,
            Effort::Quick => PAIRS_QUICK,
        };
        let part = |role| Part { task: Task::Ticket(self), role, samples };
        let parts = [part(Role::Reader(0)), part(Role::Sender)];
        let results = Peers::start(namespace, &parts)?.wait()?;
        let mut results = results.into_iter().flatten();
        match (results.next(), results.next()) {
            (Some(found), Some(read)) => Ok([Values::Many(found), Values::Many(read)]),
            _ => Err(Error::Fault("nobody paired".to_owned())),
        }
    }
}

/// Plays one part, and returns what it has measured, if that is its part.
pub(crate) fn play(
    payload: Payload,
    part: &Part,
    namespace: &Namespace,
) -> Result<Vec<Histogram<u64>>> {
    match payload {
        Payload::Small => play_on(&SMALL, part, namespace),
        Payload::Medium => play_on(&MEDIUM, part, namespace),
        Payload::Large => play_on(&LARGE, part, namespace),
    }
}

fn play_on<T: Words + 'static>(
    topic: &Topic<T>,
    part: &Part,
    namespace: &Namespace,
) -> Result<Vec<Histogram<u64>>> {
    match part.role {
        Role::Sender => send(topic, part.samples, namespace).map(|()| Vec::new()),
        Role::Reader(_) => receive(topic, part.samples, namespace),
    }
}

fn send<T: Words>(topic: &Topic<T>, samples: u64, namespace: &Namespace) -> Result {
    let session = Session::join(namespace, "sender", 1)?;
    let mut payloads = session.publisher(topic)?;
    let mut odometry = session.publisher(&ODOMETRY)?;
    // The reader answers each pair, so that none is lost however late it comes.
    let mut answers = session.quiet_subscriber(&SENSOR_PAIR)?;
    let until = clock::now().after(TIMEOUT);
    while payloads.readers() == 0 || odometry.readers() == 0 || !answers.has_publisher() {
        check(until)?;
        clock::nap(PERIOD);
    }
    for number in 0..samples {
        let now = clock::now();
        payloads.send_with(|payload| {
            payload.header_mut().stamp = now;
            payload.words_mut().fill(word(number));
        })?;
        odometry.send_with(|odometry| odometry.header.stamp = now)?;
        while answers.receive()?.is_none() {
            check(until)?;
            clock::nap(PERIOD);
        }
    }
    Ok(())
}

fn check(until: Stamp) -> Result {
    if until < clock::now() {
        return Err(Error::Fault("the other side is silent".to_owned()));
    }
    Ok(())
}

/// How long it took to pair and to find both samples, and to read the payload on top.
fn receive<T: Words + 'static>(
    topic: &Topic<T>,
    samples: u64,
    namespace: &Namespace,
) -> Result<Vec<Histogram<u64>>> {
    let session = Session::join(namespace, "receiver", 1)?;
    let mut payloads = session.quiet_subscriber(topic)?;
    let mut odometry = session.quiet_subscriber(&ODOMETRY)?;
    let mut answers = session.publisher(&SENSOR_PAIR)?;
    let mut pairing =
        Pairing::new(&CONFIG).map_err(|cause| Error::Fault(format!("cannot pair: {cause}")))?;
    let (mut found, mut read) = (history()?, history()?);
    let mut held = None;
    let until = clock::now().after(TIMEOUT);
    while found.len() < samples {
        let begun = clock::now();
        if until < begun {
            return Err(Error::Fault("the other side is silent".to_owned()));
        }
        if let Some(sample) = payloads.receive()? {
            pairing.push(0, entry(sample.header(), begun));
            held = Some(sample);
        }
        let Some(sample) = odometry.receive()? else {
            std::thread::yield_now();
            continue;
        };
        let ticket = pairing
            .push(1, entry(&sample.header, begun))
            .pairs()
            .next()
            .map(|pair| pair.members[0]);
        let payload = held.as_ref().zip(ticket);
        let payload = payload.filter(|(held, ticket)| held.header().sequence == ticket.sequence);
        let Some((payload, ticket)) = payload else {
            return Err(Error::Fault("a pair was not found".to_owned()));
        };
        found.saturating_record(nanoseconds(clock::now().since(begun)));
        let is_whole = sum(payload.words()) == expected(payload.words().len(), ticket.sequence);
        read.saturating_record(nanoseconds(clock::now().since(begun)));
        if !is_whole {
            return Err(Error::Fault("a payload is damaged".to_owned()));
        }
        answers.send_with(|answer| answer.header.stamp = begun)?;
    }
    Ok(vec![found, read])
}

const CONFIG: Config = Config {
    policy: Policy::Nearest,
    topics: 2,
    queue_size: 10,
    slop: Duration::from_millis(50),
    bounds: Bounds::Limited {
        max_age: Duration::from_millis(500),
        max_delay: Duration::from_millis(100),
    },
};

fn entry(header: &Header, received: Stamp) -> Entry {
    Entry { stamp: header.stamp, sequence: header.sequence, epoch: header.epoch, received }
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
