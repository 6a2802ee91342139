//! The pairing loop: scan and odometry in, tickets for those that belong together out.

use interfaces::topics::{ODOMETRY, SCAN, SENSOR_PAIR};
use interfaces::{Header, SensorPair, Stamp};
use node::launch::PairingParameters;
use node::pairing::{ODOMETRIES, Outcome, Pairing, Reason, SCANS, SensorPairing, write_ticket};
use node::{Clock, Error, Gauge, Latency, Node, Publisher, Result, Tunable};

use crate::shim;

/// What may be changed while the robot drives: what belongs together, and how long it is waited for. The
/// algorithm and the length of its queues are what it is made of.
pub static TUNABLES: [Tunable; 4] = [
    Tunable::number("slop_ms", 1.0..=500.0),
    Tunable::number("age_penalty", 0.0..=10.0),
    Tunable::number("max_age_ms", 50.0..=5_000.0),
    Tunable::number("max_delay_ms", 0.0..=1_000.0),
];

/// Runs the pairing as a managed node: it has a loop of its own, so that starting or reaping a
/// process never delays a pair.
pub fn run(node: &mut Node<'_>) -> Result {
    let parameters: PairingParameters = node.parameters()?;
    shim::keep_to(&parameters.cpu_affinity).map_err(Error::Fault)?;
    let unfit = |cause| Error::Fault(format!("cannot pair: {cause}"));
    let mut pairing = SensorPairing::new(&parameters.config()).map_err(unfit)?;
    let mut tuning = node.tuning(parameters, &TUNABLES)?;
    let mut scans = node.subscribe(&SCAN)?;
    let mut odometry = node.subscribe(&ODOMETRY)?;
    let mut tickets = node.publish(&SENSOR_PAIR)?;
    let books = Books::new(node);
    let clock = node.clock();
    let age = (clock == Clock::Realtime).then(|| node.latency("age"));
    while let Some(tick) = node.tick()? {
        if let Some(parameters) = tuning.take(node)? {
            pairing.retune(&parameters.config()).map_err(unfit)?;
        }
        while let Some(scan) = scans.receive()? {
            let received = received(clock, tick.now, &scan.header);
            send(
                &mut tickets,
                &pairing.push(SCANS, &scan.header, received),
                received,
                age.as_ref(),
            )?;
        }
        while let Some(odometry) = odometry.receive()? {
            let received = received(clock, tick.now, &odometry.header);
            let outcome = pairing.push(ODOMETRIES, &odometry.header, received);
            send(&mut tickets, &outcome, received, age.as_ref())?;
        }
        if clock == Clock::Realtime {
            send(&mut tickets, &pairing.poll(tick.now), tick.now, age.as_ref())?;
            node.wake_by(pairing.next_deadline());
        }
        books.set(pairing.pairing());
    }
    Ok(())
}

/// In lock-step a sample is received when it is true: the wall's time must not tell.
fn received(clock: Clock, now: Stamp, header: &Header) -> Stamp {
    match clock {
        Clock::Lockstep => header.stamp,
        Clock::Realtime => now,
    }
}

fn send(
    tickets: &mut Publisher<SensorPair>,
    outcome: &Outcome<'_>,
    now: Stamp,
    age: Option<&Latency>,
) -> Result {
    for pair in outcome.pairs() {
        let mut stamp = now;
        tickets.send_with(|ticket| {
            write_ticket(&pair, now, ticket);
            stamp = ticket.header.stamp;
        })?;
        if let Some(age) = age {
            age.record(node::clock::now().since(stamp));
        }
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
