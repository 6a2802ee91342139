//! Logs: events with fields on standard error, as text or as JSON, one line each.

use clap::{Args, ValueEnum};
use tracing::Level;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{Layer, fmt};

/// How a log line is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Format {
    /// For people.
    #[default]
    Text,
    /// For machines: one object a line.
    Json,
}

impl Format {
    /// Its name on the command line.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Text => "text",
            Self::Json => "json",
        }
    }
}

/// What is logged, and how.
#[derive(Debug, Clone, Copy, Args)]
#[group(skip)]
pub struct Options {
    /// How log lines are written
    #[arg(long = "log-format", value_name = "FORMAT", default_value = "text")]
    pub format: Format,

    /// What is logged: error, warn, info, debug or trace
    #[arg(long = "log-level", value_name = "LEVEL", default_value = "warn")]
    pub level: Level,
}

/// Sends this process's log lines to standard error; a second call changes nothing.
pub fn start(options: Options) {
    iceoryx2::prelude::set_log_level(iceoryx2::prelude::LogLevel::Error);
    let filter = Targets::new()
        .with_default(options.level)
        // The transport's own errors come back to us as values; each is told once.
        .with_target("iceoryx2_bb_loggers", LevelFilter::OFF);
    let lines = fmt::layer().with_writer(std::io::stderr).with_target(false);
    let started = match options.format {
        Format::Text => {
            tracing_subscriber::registry().with(lines.compact().with_filter(filter)).try_init()
        }
        Format::Json => tracing_subscriber::registry()
            .with(lines.json().flatten_event(true).with_filter(filter))
            .try_init(),
    };
    // Somebody who embeds a node may have a subscriber of their own already.
    drop(started);
}
