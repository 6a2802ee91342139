//! The LiDAR's port: opened, listened to, and found out.

use std::time::Duration;

use interfaces::topics::SCAN;
use interfaces::{LaserScan, Stamp};
use node::{Gauge, Latency, Node, Publisher, Result};

use super::PIECE;
use super::told::Told;
use crate::config::{Config, LidarChoice};
use crate::lidar::{Heard, Lidar, Model};
use crate::serial::{Line, Refusal};

/// Longer than the pauses of a busy machine; an LDS-01 says something every 3 ms.
const SILENCE_MAX: Duration = Duration::from_millis(600);

/// [byte] A LiDAR of the model that is listened for has said ten packets by then.
const BYTES_ENOUGH: u64 = 512;

/// After the port was opened the motor has to come up to speed first.
const START_MAX: Duration = Duration::from_secs(2);

/// One's dealings with the LiDAR.
pub(super) struct LidarDesk {
    line: Line,
    told: Told,
    lidar: Lidar,
    choice: LidarChoice,
    near_filter: bool,
    range_min: Option<f32>,
    scans: Publisher<LaserScan>,
    /// When the LiDAR is missed, if it says nothing before.
    silent_at: Stamp,
    /// [byte] Come since the port was opened, or since the last packet.
    bytes: u64,
    /// Whether the LiDAR is none of the two that we know, as far as we know.
    has_tried_both: bool,
    /// Whether any of it was a packet.
    is_heard: bool,
    garbage: Gauge,
    way: Latency,
}

impl LidarDesk {
    pub(super) fn new(node: &mut Node<'_>, config: &Config) -> Result<Self> {
        let model = config.lidar.model();
        Ok(Self {
            line: Line::new(&config.lidar_port, "lidar_port"),
            told: Told::new(node, "LiDAR", "lidar_losses"),
            lidar: Lidar::new(model.unwrap_or(Model::Lds02), config.near_filter),
            choice: config.lidar,
            near_filter: config.near_filter,
            range_min: config.lidar_range_min_m,
            scans: node.publish(&SCAN)?,
            silent_at: Stamp::ZERO,
            bytes: 0,
            has_tried_both: false,
            is_heard: false,
            garbage: node.gauge("lidar_garbage"),
            way: node.latency("bytes_to_scan"),
        })
    }

    /// Opens the port, if it is time to try.
    fn open(&mut self, node: &Node<'_>, now: Stamp) -> std::result::Result<(), Refusal> {
        let model = self.lidar.model();
        match self.line.open(now, model.baud_rate()) {
            None => return Ok(()),
            Some(Err(refusal)) => return Err(refusal),
            Some(Ok(file)) => {
                if let Err(cause) = node.watch(file) {
                    tracing::debug!(%cause, "reads the LiDAR by the clock");
                }
            }
        }
        // It may have gone again already, which reading will tell.
        let _ = self.line.write(model.start_command());
        self.lidar = Lidar::new(model, self.near_filter);
        self.bytes = 0;
        self.is_heard = false;
        self.silent_at = now.after(START_MAX);
        Ok(())
    }

    /// From now on believes these of the returns.
    pub(super) fn retune(&mut self, config: &Config) {
        self.near_filter = config.near_filter;
        self.range_min = config.lidar_range_min_m;
        self.lidar.set_near_filter(config.near_filter);
    }

    /// Nobody has listened for a while.
    pub(super) fn restart(&mut self) {
        self.line.close(Stamp::ZERO);
    }

    /// Publishes the turns that have come whole.
    pub(super) fn turn(&mut self, node: &mut Node<'_>, now: Stamp) -> Result {
        if let Err(refusal) = self.open(node, now) {
            self.told.closed(node, &refusal);
        }
        let mut piece = [0; PIECE];
        loop {
            match self.line.read(&mut piece) {
                Ok(0) => break,
                Ok(count) => {
                    self.bytes += count as u64;
                    self.lidar.hear(now, &piece[..count]);
                    self.publish(node, now)?;
                }
                Err(gone) => {
                    self.lose(node, now, &gone.to_string());
                    break;
                }
            }
        }
        if self.finds_out() && !self.is_heard && BYTES_ENOUGH < self.bytes {
            self.try_the_other(node, now);
        } else if self.line.is_open() && self.silent_at < now {
            let why = self.why_silent();
            self.lose(node, now, &why);
        }
        Ok(())
    }

    pub(super) fn due(&self) -> Option<Stamp> {
        self.line.due()
    }

    fn publish(&mut self, node: &mut Node<'_>, now: Stamp) -> Result {
        let model = self.lidar.model();
        let range_min = self.range_min.unwrap_or(model.range().0);
        let mut has_packets = false;
        while let Some(heard) = self.lidar.decode() {
            match heard {
                Heard::Garbage => self.garbage.count(),
                Heard::Packet => has_packets = true,
                Heard::Turn(turn) => {
                    has_packets = true;
                    let beams = model.beams(turn);
                    self.scans.send_with(|scan| turn.fill(model, range_min, beams, scan))?;
                    self.way.record(node::clock::now().since(now));
                }
            }
        }
        if has_packets {
            self.silent_at = now.after(SILENCE_MAX);
            self.bytes = 0;
            if !std::mem::replace(&mut self.is_heard, true) {
                self.told.well(node, model.label());
            }
        }
        Ok(())
    }

    /// Whether nobody has said which LiDAR it is.
    fn finds_out(&self) -> bool {
        self.choice == LidarChoice::Auto
    }

    fn why_silent(&self) -> String {
        let label = self.lidar.model().label();
        match (self.bytes, self.is_heard) {
            (0, false) => "it is silent: does it turn, and is `lidar_port` its port?".to_owned(),
            (0, true) => "it fell silent: does it still turn?".to_owned(),
            (_, true) => format!(
                "what comes is no whole {label} packet any more: is its cable sound, and does no \
                 other program use its port?"
            ),
            (_, false) if self.finds_out() => {
                "what comes is neither an LDS-01's nor an LDS-02's: is `lidar_port` its port?"
                    .to_owned()
            }
            (_, false) => {
                format!(
                    "what comes is no {label}'s: set `lidar` to auto, or `lidar_port` to its port"
                )
            }
        }
    }

    fn lose(&mut self, node: &mut Node<'_>, now: Stamp, why: &str) {
        self.line.close(now);
        self.told.lost(node, why);
    }

    /// What comes is not this LiDAR's: listens for the other one, at once if that was not tried yet.
    fn try_the_other(&mut self, node: &mut Node<'_>, now: Stamp) {
        let other = match self.lidar.model() {
            Model::Lds01 => Model::Lds02,
            Model::Lds02 => Model::Lds01,
        };
        let is_neither = self.has_tried_both;
        self.has_tried_both = !is_neither;
        if is_neither {
            let why = self.why_silent();
            self.lose(node, now, &why);
        } else {
            self.line.close(Stamp::ZERO);
        }
        self.bytes = 0;
        self.lidar = Lidar::new(other, self.near_filter);
    }
}
