//! A pair by ticket: one process sends a payload and an odometry sample, another pairs and finds
//! both where they lie. The cost must not grow with the payload.

use std::fmt::Write;
use std::process::{Child, Command};
use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use clap::ValueEnum;
use hdrhistogram::Histogram;
use iceoryx2::prelude::ZeroCopySend;
use interfaces::topics::ODOMETRY;
use interfaces::{Header, Message, Stamp, Topic};
use node::pairing::{Bounds, Config, Entry, Pairing, Policy};
use node::{Error, Namespace, Result, Session, clock, signal};

use rustix::process::Signal;

use crate::Payload;

/// [-] Pairs of one measurement.
const PAIRS: usize = 2_000;

/// Between two pairs: the sender has time to fill the payload.
const PERIOD: Duration = Duration::from_millis(1);

/// A measurement takes some seconds; after this long the other side is not coming.
const TIMEOUT: Duration = Duration::from_secs(30);

/// As long as anybody watches.
const DEADLINE: Duration = Duration::from_secs(1);

macro_rules! payload {
    ($name:ident, $type_name:literal, $bytes:literal) => {
        #[doc = concat!("A sample of ", stringify!($bytes), " bytes and a header.")]
        #[derive(Debug, Clone, Copy, Pod, Zeroable, ZeroCopySend)]
        #[type_name($type_name)]
        #[repr(C)]
        struct $name {
            header: Header,
            /// [-] Anything.
            bytes: [u8; $bytes],
        }

        impl Default for $name {
            fn default() -> Self {
                Self::zeroed()
            }
        }

        impl Message for $name {
            fn header(&self) -> &Header {
                &self.header
            }

            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }

        impl Bytes for $name {
            fn bytes(&self) -> &[u8] {
                &self.bytes
            }

            fn bytes_mut(&mut self) -> &mut [u8] {
                &mut self.bytes
            }
        }
    };
}

/// What a payload is made of.
trait Bytes: Message {
    fn bytes(&self) -> &[u8];
    fn bytes_mut(&mut self) -> &mut [u8];
}

payload!(Small, "bench/Small/1", 1024);
payload!(Large, "bench/Large/1", 1_048_576);

const SMALL: Topic<Small> = Topic::new("payload", 4, DEADLINE, "bench");
const LARGE: Topic<Large> = Topic::new("payload", 4, DEADLINE, "bench");

/// Measures both payloads, each with a sender in a process of its own.
pub(crate) fn measure(table: &mut String) -> Result {
    signal::listen();
    let _ = writeln!(table, "\npair by ticket, us                          p50      p99    pairs");
    let figures = receive(Payload::Small, &SMALL)
        .and_then(|small| Ok((small, receive(Payload::Large, &LARGE)?)));
    // Our own node is gone: nobody else has a part in this namespace.
    Namespace::new(&robot())?.remove();
    let (small, large) = figures?;
    for (name, figures) in [("1 KiB", small), ("1 MiB", large)] {
        for (what, history) in [("found", &figures.found), ("and read", &figures.read)] {
            let us = |quantile| history.value_at_quantile(quantile) as f64 / 1e3;
            let (p50, p99) = (us(0.5), us(0.99));
            let _ = writeln!(
                table,
                "  {name:<10} {what:<24} {p50:>9.2} {p99:>8.2} {:>8}",
                history.len()
            );
        }
    }
    Ok(())
}

/// How long it took to pair and to find both samples, and to read the payload on top.
struct Figures {
    found: Histogram<u64>,
    read: Histogram<u64>,
}

/// The sender's side: what `measure` starts.
pub(crate) fn send(payload: Payload) -> Result {
    node::die_with_parent(Signal::KILL);
    match payload {
        Payload::Small => send_on(&SMALL),
        Payload::Large => send_on(&LARGE),
    }
}

fn send_on<T: Bytes>(topic: &Topic<T>) -> Result {
    let session = Session::join(&Namespace::new(&robot())?, "sender", 1)?;
    let mut payloads = session.publisher(topic)?;
    let mut odometry = session.publisher(&ODOMETRY)?;
    let begun = clock::now();
    while payloads.readers() == 0 || odometry.readers() == 0 {
        if TIMEOUT < clock::now().since(begun) {
            return Err(Error::Fault("nobody reads".to_owned()));
        }
        clock::nap(PERIOD);
    }
    for number in 0..PAIRS {
        let now = clock::now();
        payloads.send_with(|payload| {
            payload.header_mut().stamp = now;
            payload.bytes_mut().fill(number.to_le_bytes()[0]);
        })?;
        odometry.send_with(|odometry| odometry.header.stamp = now)?;
        clock::nap(PERIOD);
    }
    // The last samples stay readable until this process ends.
    clock::nap(Duration::from_millis(200));
    Ok(())
}

/// Nobody drives it; two measurements at once are two robots.
fn robot() -> String {
    let measuring = std::env::var(node::PARENT).unwrap_or_else(|_| std::process::id().to_string());
    format!("bench-{measuring}")
}

fn receive<T: Bytes + 'static>(payload: Payload, topic: &Topic<T>) -> Result<Figures> {
    let mut sender = Sender::start(payload)?;
    let session = Session::join(&Namespace::new(&robot())?, "receiver", 1)?;
    let mut payloads = session.quiet_subscriber(topic)?;
    let mut odometry = session.quiet_subscriber(&ODOMETRY)?;
    let mut pairing =
        Pairing::new(&CONFIG).map_err(|cause| Error::Fault(format!("cannot pair: {cause}")))?;
    let mut figures = Figures::new()?;
    let mut held = None;
    let mut sum = 0;
    while !sender.has_ended() && signal::stop_requests() == 0 {
        let begun = clock::now();
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
        let (Some(ticket), Some(payload)) = (ticket, &held) else { continue };
        if payload.header().sequence == ticket.sequence {
            figures.found.saturating_record(nanoseconds(clock::now().since(begun)));
            sum += payload.bytes().iter().map(|&byte| u64::from(byte)).sum::<u64>();
            figures.read.saturating_record(nanoseconds(clock::now().since(begun)));
        }
    }
    std::hint::black_box(sum);
    Ok(figures)
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

impl Figures {
    fn new() -> Result<Self> {
        let history = || {
            Histogram::new_with_max(10_000_000_000, 3)
                .map_err(|cause| Error::Fault(cause.to_string()))
        };
        Ok(Self { found: history()?, read: history()? })
    }
}

/// The sender's process; killed, and its shared memory removed, when dropped.
struct Sender(Child);

impl Sender {
    fn start(payload: Payload) -> Result<Self> {
        let failed = |cause| Error::File { path: "/proc/self/exe".into(), cause };
        let own = std::env::current_exe().map_err(failed)?;
        let payload =
            payload.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned());
        let child = Command::new(own)
            .args(["bench", "--send", &payload])
            .env(node::PARENT, std::process::id().to_string())
            .spawn()
            .map_err(failed)?;
        Ok(Self(child))
    }

    fn has_ended(&mut self) -> bool {
        !matches!(self.0.try_wait(), Ok(None))
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        // Both fail only where it has ended already.
        drop(self.0.kill());
        drop(self.0.wait());
    }
}
