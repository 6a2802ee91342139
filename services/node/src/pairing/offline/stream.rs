//! One recorded stream: which topics, which parameters, what arrived in which order.

use std::time::Duration;

use serde::Deserialize;

use super::super::{Config, ConfigError, Policy, TOPICS_MAX, slop_from_seconds};
use super::{Algorithm, Options, StreamError};

/// [-] As deep as the lab's queues.
const QUEUE_SIZE: usize = 10;

/// One period of the lab's 20 Hz.
const SLOP: Duration = Duration::from_millis(50);

/// ROS 2's default for `max_interval_duration`, 68 years.
const MAX_INTERVAL: Duration = Duration::from_secs(1 << 31);

/// [-] ROS 2's default.
const AGE_PENALTY: f64 = 0.1;

/// What one line of a stream file says.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Stream {
    /// What the stream is called.
    #[serde(default)]
    pub id: String,
    /// The names of the topics, in the order of a match.
    pub topics: Vec<String>,
    /// [-] Samples that wait, per topic.
    pub queue_size: Option<usize>,
    /// [s] For `nearest`.
    pub slop: Option<f64>,
    /// [ns] The same, if it is there; it then counts.
    pub slop_ns: Option<u64>,
    /// [-] For `adaptive`.
    pub age_penalty: Option<f64>,
    /// [ns] For `adaptive`: a set spans at most this.
    pub max_interval_ns: Option<u64>,
    /// [ns] For `adaptive`, by topic.
    pub inter_message_lower_bound_ns: Option<Vec<u64>>,
    /// What arrived.
    pub events: Vec<Event>,
}

/// One sample's arrival.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Event {
    /// The name of its topic.
    pub topic: String,
    /// [ns] When its data was true.
    pub stamp_ns: i64,
    /// [ns] When it was received, if that is known.
    pub received_ns: Option<u64>,
}

impl Stream {
    /// From one line of a file.
    pub fn parse(line: &str) -> Result<Self, StreamError> {
        let stream: Self = serde_json::from_str(line).map_err(StreamError::Json)?;
        let mut names = stream.topics.iter().enumerate();
        if let Some((_, twice)) = names.find(|(at, name)| stream.topics[..*at].contains(name)) {
            return Err(StreamError::TwiceTopic(twice.clone()));
        }
        Ok(stream)
    }

    /// Which algorithm its fields are for.
    pub fn algorithm(&self) -> Algorithm {
        let adaptive = self.age_penalty.is_some()
            || self.max_interval_ns.is_some()
            || self.inter_message_lower_bound_ns.is_some();
        if adaptive { Algorithm::Adaptive } else { Algorithm::Nearest }
    }

    /// How to pair it.
    pub fn config(&self, options: &Options) -> Result<Config, StreamError> {
        let algorithm = options.algorithm.unwrap_or_else(|| self.algorithm());
        let policy = match algorithm {
            Algorithm::Nearest => Policy::Nearest,
            Algorithm::Adaptive => Policy::Adaptive {
                age_penalty: self.age_penalty.unwrap_or(AGE_PENALTY),
                period_min: self.period_min()?,
            },
        };
        let slop = match options.slop {
            Some(slop) => slop,
            None => self.slop(algorithm).map_err(StreamError::Config)?,
        };
        Ok(Config {
            policy,
            topics: self.topics.len(),
            queue_size: options.queue_size.or(self.queue_size).unwrap_or(QUEUE_SIZE),
            slop,
            bounds: options.bounds,
        })
    }

    fn slop(&self, algorithm: Algorithm) -> Result<Duration, ConfigError> {
        // An interval may be as long as `max_interval_ns`; stamps are less than the slop apart.
        let inclusive = |interval: Duration| interval.saturating_add(Duration::from_nanos(1));
        match (self.slop_ns, self.slop, self.max_interval_ns) {
            (Some(slop), _, _) => Ok(Duration::from_nanos(slop)),
            (None, Some(slop), _) => slop_from_seconds(slop),
            (None, None, Some(interval)) => Ok(inclusive(Duration::from_nanos(interval))),
            (None, None, None) => Ok(match algorithm {
                Algorithm::Nearest => SLOP,
                Algorithm::Adaptive => inclusive(MAX_INTERVAL),
            }),
        }
    }

    fn period_min(&self) -> Result<[Duration; TOPICS_MAX], StreamError> {
        let mut period_min = [Duration::ZERO; TOPICS_MAX];
        if let Some(bounds) = &self.inter_message_lower_bound_ns {
            if bounds.len() != self.topics.len() {
                return Err(StreamError::LowerBounds);
            }
            for (period_min, bound) in period_min.iter_mut().zip(bounds) {
                *period_min = Duration::from_nanos(*bound);
            }
        }
        Ok(period_min)
    }
}
