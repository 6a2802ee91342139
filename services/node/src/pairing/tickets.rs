//! Tickets: what is told about a scan and an odometry sample that belong together.

use interfaces::{Header, SensorPair, Stamp};

use super::{Config, ConfigError, Entry, Outcome, Pair, Pairing};

/// [-] The scans' place among the topics that are paired.
pub const SCANS: usize = 0;

/// [-] The odometry's.
pub const ODOMETRIES: usize = 1;

/// Pairs scans with odometry, each of the newest life of its publisher.
#[derive(Debug)]
pub struct SensorPairing {
    pairing: Pairing,
    lives: [u32; 2],
}

impl SensorPairing {
    /// All the memory that it will ever need; `config` is for two topics.
    pub fn new(config: &Config) -> Result<Self, ConfigError> {
        Ok(Self { pairing: Pairing::new(config)?, lives: [0; 2] })
    }

    /// See [`Pairing::retune`].
    pub fn retune(&mut self, config: &Config) -> Result<(), ConfigError> {
        self.pairing.retune(config)
    }

    /// Takes one sample, as it was received, and says what comes of it.
    pub fn push(&mut self, topic: usize, header: &Header, received: Stamp) -> Outcome<'_> {
        let &Header { stamp, sequence, epoch, .. } = header;
        let before = std::mem::replace(&mut self.lives[topic], epoch);
        if before != 0 && before != epoch {
            // What a publisher's former life measured belongs to nothing that its new one does.
            self.pairing.reset();
        }
        self.pairing.push(topic, Entry { stamp, sequence, epoch, received })
    }

    /// What time alone brings about.
    pub fn poll(&mut self, now: Stamp) -> Outcome<'_> {
        self.pairing.poll(now)
    }

    /// When to poll, if nothing arrives before.
    pub fn next_deadline(&self) -> Option<Stamp> {
        self.pairing.next_deadline()
    }

    /// The pairing itself, to read its books.
    pub fn pairing(&self) -> &Pairing {
        &self.pairing
    }
}

/// Writes what is told about `pair`, all but the header's number and life.
pub fn write_ticket(pair: &Pair<'_>, formed: Stamp, ticket: &mut SensorPair) {
    let (scan, odometry) = (pair.members[SCANS], pair.members[ODOMETRIES]);
    ticket.header.stamp = pair.stamp();
    ticket.scan_stamp = scan.stamp;
    ticket.odometry_stamp = odometry.stamp;
    ticket.scan_sequence = scan.sequence;
    ticket.odometry_sequence = odometry.sequence;
    ticket.scan_epoch = scan.epoch;
    ticket.odometry_epoch = odometry.epoch;
    ticket.spread_ns = u64::try_from(pair.spread().as_nanos()).unwrap_or(u64::MAX);
    ticket.formed = formed;
}
