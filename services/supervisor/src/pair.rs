//! `teseo pair`: the robot's pairing on recorded streams, for one who asks why topics do not pair.

use std::io::{BufWriter, ErrorKind, Read, Write};
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use node::pairing::offline::{Algorithm, OfflineError, Options, pair_streams};
use node::pairing::{Bounds, slop_from_seconds};
use node::{Error, Result};

/// Which streams, and how to pair them.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  teseo pair streams.jsonl --policy adaptive --slop 0.05")]
pub struct PairOptions {
    /// Streams, one JSON object a line; - for standard input
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// The algorithm, instead of the one that the stream's fields tell
    #[arg(long, value_name = "POLICY")]
    pub policy: Option<Algorithm>,

    /// Stamps of a pair are less than this apart, instead of what the stream says
    #[arg(long, value_name = "SECONDS")]
    pub slop: Option<f64>,

    /// Samples of a topic that wait, instead of what the stream says
    #[arg(long, value_name = "NUMBER")]
    pub queue: Option<usize>,

    /// Drop what was received longer ago than this, as a robot does
    #[arg(long, value_name = "SECONDS")]
    pub max_age: Option<f64>,

    /// Give out the best pair so far after this, as a robot does
    #[arg(long, value_name = "SECONDS", requires = "max_age")]
    pub max_delay: Option<f64>,

    /// One JSON object per stream instead of text
    #[arg(long)]
    pub json: bool,
}

/// Replays the streams and prints what came of each.
pub(crate) fn pair(options: &PairOptions) -> Result {
    let text = read(&options.file)?;
    let replay = Options {
        algorithm: options.policy,
        slop: options.slop.map(|slop| seconds("--slop", slop)).transpose()?,
        queue_size: options.queue,
        bounds: bounds(options)?,
        json: options.json,
    };
    let mut output = BufWriter::new(std::io::stdout().lock());
    match pair_streams(&text, &replay, &mut output) {
        // Whoever reads only the first lines has seen enough.
        Err(OfflineError::Write(cause)) if cause.kind() == ErrorKind::BrokenPipe => return Ok(()),
        Err(cause) => {
            return Err(Error::Fault(format!("{}: {cause}", options.file.display())));
        }
        Ok(()) => {}
    }
    output.flush().map_err(|cause| Error::File { path: "standard output".into(), cause })
}

fn read(file: &PathBuf) -> Result<String> {
    let failed = |cause| Error::File { path: file.clone(), cause };
    if file.as_os_str() == "-" {
        let mut text = String::new();
        std::io::stdin().read_to_string(&mut text).map_err(failed)?;
        Ok(text)
    } else {
        std::fs::read_to_string(file).map_err(failed)
    }
}

fn bounds(options: &PairOptions) -> Result<Bounds> {
    let Some(max_age) = options.max_age else { return Ok(Bounds::Unlimited) };
    let max_age = seconds("--max-age", max_age)?;
    let max_delay = options.max_delay.map(|delay| seconds("--max-delay", delay)).transpose()?;
    Ok(Bounds::Limited { max_age, max_delay: max_delay.unwrap_or(max_age) })
}

fn seconds(option: &str, value: f64) -> Result<Duration> {
    slop_from_seconds(value)
        .map_err(|_| Error::Fault(format!("{option} {value} is no length of time in seconds")))
}
