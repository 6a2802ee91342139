//! The pairing loop: scan and odometry in, tickets for those that belong together out.

use interfaces::topics::{ODOMETRY, SCAN, SENSOR_PAIR};
use interfaces::{Header, SensorPair, Stamp};
use node::pairing::{Entry, Outcome, Pairing, Reason};
use node::{Clock, Error, Gauge, Node, Publisher, Result};

const SCANS: usize = 0;
const ODOMETRIES: usize = 1;

/// Runs the pairing as a managed node: it has a loop of its own, so that starting or reaping a
/// process never delays a pair.
pub fn run(node: &mut Node<'_>) -> Result {
    let config = node.settings().launch().pairing.config();
    let mut pairing =
        Pairing::new(&config).map_err(|cause| Error::Fault(format!("cannot pair: {cause}")))?;
    let mut scans = node.subscribe(&SCAN)?;
    let mut odometry = node.subscribe(&ODOMETRY)?;
    let mut tickets = node.publish(&SENSOR_PAIR)?;
    let books = Books::new(node);
    let clock = node.clock();
    let mut lives = Lives::default();
    while let Some(tick) = node.tick()? {
        while let Some(scan) = scans.receive()? {
            let entry = entry(clock, tick.now, &scan.header);
            lives.notice(SCANS, entry.epoch, &mut pairing);
            send(&mut tickets, &pairing.push(SCANS, entry), entry.received)?;
        }
        while let Some(odometry) = odometry.receive()? {
            let entry = entry(clock, tick.now, &odometry.header);
            lives.notice(ODOMETRIES, entry.epoch, &mut pairing);
            send(&mut tickets, &pairing.push(ODOMETRIES, entry), entry.received)?;
        }
        if clock == Clock::Realtime {
            send(&mut tickets, &pairing.poll(tick.now), tick.now)?;
            node.wake_by(pairing.next_deadline());
        }
        books.set(&pairing);
    }
    Ok(())
}

/// Which life of each publisher the samples are from.
#[derive(Default)]
struct Lives([u32; 2]);

impl Lives {
    /// What a publisher's former life measured belongs to nothing that its new one does.
    fn notice(&mut self, topic: usize, epoch: u32, pairing: &mut Pairing) {
        let before = std::mem::replace(&mut self.0[topic], epoch);
        if before != 0 && before != epoch {
            pairing.reset();
        }
    }
}

/// In lock-step a sample is received when it is true: the wall's time must not tell.
fn entry(clock: Clock, now: Stamp, header: &Header) -> Entry {
    let received = match clock {
        Clock::Lockstep => header.stamp,
        Clock::Realtime => now,
    };
    Entry { stamp: header.stamp, sequence: header.sequence, epoch: header.epoch, received }
}

fn send(tickets: &mut Publisher<SensorPair>, outcome: &Outcome<'_>, now: Stamp) -> Result {
    for pair in outcome.pairs() {
        let (scan, odometry) = (pair.members[SCANS], pair.members[ODOMETRIES]);
        let spread = pair.spread();
        tickets.send_with(|ticket| {
            ticket.header.stamp = pair.stamp();
            ticket.scan_stamp = scan.stamp;
            ticket.odometry_stamp = odometry.stamp;
            ticket.scan_sequence = scan.sequence;
            ticket.odometry_sequence = odometry.sequence;
            ticket.scan_epoch = scan.epoch;
            ticket.odometry_epoch = odometry.epoch;
            ticket.spread_ns = u64::try_from(spread.as_nanos()).unwrap_or(u64::MAX);
            ticket.formed = now;
        })?;
    }
    Ok(())
}

/// Where every sample went, for whoever looks at the node's status.
struct Books {
    pairs: Gauge,
    resets: Gauge,
    topics: [TopicBooks; 2],
}

struct TopicBooks {
    received: Gauge,
    queued: Gauge,
    dropped: [Gauge; Reason::COUNT],
}

impl Books {
    fn new(node: &mut Node<'_>) -> Self {
        let pairs = node.gauge("pairs");
        let resets = node.gauge("resets");
        let topics = ["scan", "odom"].map(|topic| TopicBooks {
            received: node.gauge(&format!("{topic}_received")),
            queued: node.gauge(&format!("{topic}_queued")),
            dropped: Reason::ALL.map(|reason| node.gauge(&format!("{topic}_{}", reason.label()))),
        });
        Self { pairs, resets, topics }
    }

    fn set(&self, pairing: &Pairing) {
        self.pairs.set(pairing.books(SCANS).paired as f64);
        self.resets.set(pairing.resets() as f64);
        for (index, gauges) in self.topics.iter().enumerate() {
            let books = pairing.books(index);
            gauges.received.set(books.received as f64);
            gauges.queued.set(books.queued as f64);
            for (gauge, reason) in gauges.dropped.iter().zip(Reason::ALL) {
                gauge.set(books.dropped(reason) as f64);
            }
        }
    }
}
