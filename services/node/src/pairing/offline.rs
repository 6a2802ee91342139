//! The same pairing on recorded streams, for whoever asks "why do my topics not pair?".
//!
//! A file holds one stream a line, in JSON, with the fields of ROS 2's reference vectors:
//!
//! ```json
//! {"topics": ["scan", "odom"], "queue_size": 10, "slop": 0.05,
//!  "events": [{"topic": "scan", "stamp_ns": 0}, {"topic": "odom", "stamp_ns": 1000000}]}
//! ```
//!
//! Only `topics` and `events` are needed. `age_penalty`, `max_interval_ns` and
//! `inter_message_lower_bound_ns` instead of `slop` make it a stream for `adaptive`; fields with
//! other names are ignored. An event may carry `received_ns`. Where it does not, it counts as
//! received when its stamp or any stamp before it was true, whichever is later: the newest stamp so
//! far is the stream's clock, and delays are told on that.

mod hints;
mod replay;
mod report;
mod stream;

use std::fmt;
use std::io::{self, Write};
use std::time::Duration;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use super::{Bounds, ConfigError};
pub use replay::{Loss, Replay, TopicBooks, replay};
pub use stream::{Event, Stream};

/// Which algorithm, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Algorithm {
    /// `nearest`, of ROS 2's Python.
    Nearest,
    /// `adaptive`, of ROS 2's C++.
    Adaptive,
}

impl Algorithm {
    /// Its name.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Nearest => "nearest",
            Self::Adaptive => "adaptive",
        }
    }
}

/// What the caller wants otherwise than the file says.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Instead of the algorithm that the stream's fields tell.
    pub algorithm: Option<Algorithm>,
    /// Instead of the stream's slop or `max_interval_ns`; stamps are less than this apart.
    pub slop: Option<Duration>,
    /// [-] Instead of the stream's queue size.
    pub queue_size: Option<usize>,
    /// As in ROS 2, or as on a robot.
    pub bounds: Bounds,
    /// One JSON object per stream instead of text.
    pub json: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            algorithm: None,
            slop: None,
            queue_size: None,
            bounds: Bounds::Unlimited,
            json: false,
        }
    }
}

/// Replays every stream of `text` and writes what came of it.
pub fn pair_streams(
    text: &str,
    options: &Options,
    output: &mut impl Write,
) -> Result<(), OfflineError> {
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let mut lines = lines.map(|(index, line)| (index + 1, line)).peekable();
    if lines.peek().is_none() {
        return Err(OfflineError::Empty);
    }
    for (number, line) in lines {
        let in_line = |problem| OfflineError::Line { number, problem };
        let stream = Stream::parse(line).map_err(in_line)?;
        let replay = replay(&stream, options).map_err(in_line)?;
        let written = if options.json {
            report::write_json(&replay, output)
        } else {
            report::write_text(&replay, number, output)
        };
        written.map_err(OfflineError::Write)?;
    }
    Ok(())
}

/// Why streams cannot be replayed.
#[derive(Debug)]
pub enum OfflineError {
    /// There is no stream in the text.
    Empty,
    /// A line is no stream.
    Line {
        /// [-] Counted from 1.
        number: usize,
        /// What is wrong with it.
        problem: StreamError,
    },
    /// The output does not take any more.
    Write(io::Error),
}

/// Why a line is no stream.
#[derive(Debug)]
pub enum StreamError {
    /// It is not JSON, or a field is missing or of the wrong type.
    Json(serde_json::Error),
    /// Two topics have one name.
    TwiceTopic(String),
    /// An event names a topic that the stream does not have.
    UnknownTopic {
        /// [-] Which event, counted from 0.
        event: usize,
        /// What it names.
        topic: String,
    },
    /// An event's stamp is before the clock's start, which ROS 2 refuses too.
    NegativeStamp {
        /// [-] Which event, counted from 0.
        event: usize,
    },
    /// There is not one `inter_message_lower_bound_ns` for each topic.
    LowerBounds,
    /// No pairing can be made with these parameters.
    Config(ConfigError),
}

impl fmt::Display for OfflineError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => {
                formatter.write_str("there is no stream: expected one JSON object a line")
            }
            Self::Line { number, problem: StreamError::Json(error) } => {
                // The parser has seen one line only, and would call it the first.
                let place = format!(" at line {} column {}", error.line(), error.column());
                let problem = error.to_string();
                let problem = problem.strip_suffix(&place).unwrap_or(&problem);
                write!(formatter, "line {number}, column {}: {problem}", error.column())
            }
            Self::Line { number, problem } => write!(formatter, "line {number}: {problem}"),
            Self::Write(error) => write!(formatter, "cannot write: {error}"),
        }
    }
}

impl fmt::Display for StreamError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Json(error) => error.fmt(formatter),
            Self::TwiceTopic(topic) => write!(formatter, "topic `{topic}` is listed twice"),
            Self::UnknownTopic { event, topic } => {
                write!(formatter, "event {event} is on `{topic}`, which is not among the topics")
            }
            Self::NegativeStamp { event } => {
                write!(formatter, "event {event} has a negative stamp")
            }
            Self::LowerBounds => {
                formatter.write_str("inter_message_lower_bound_ns needs one number for each topic")
            }
            Self::Config(error) => error.fmt(formatter),
        }
    }
}

impl std::error::Error for OfflineError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Empty => None,
            Self::Line { problem, .. } => Some(problem),
            Self::Write(error) => Some(error),
        }
    }
}

impl std::error::Error for StreamError {}
