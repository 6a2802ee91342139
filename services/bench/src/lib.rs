//! Measures the runtime on the machine at hand: what pairing costs, and that a pair is never copied.

#![forbid(unsafe_code)]

mod pairing;
mod ticket;

use std::fmt::Write as _;
use std::io::Write as _;

use clap::{Args, ValueEnum};
use node::{Error, Result};

/// What to measure.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  teseo bench")]
pub struct Options {
    /// [-] Rounds of each measurement; the best and the median are told
    #[arg(long, value_name = "NUMBER", default_value_t = 5)]
    pub rounds: u32,

    /// Be the sender of the ticket measurement
    #[arg(long, hide = true, value_name = "PAYLOAD")]
    pub send: Option<Payload>,
}

/// How large a sample is that nobody copies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Payload {
    /// 1 KiB, about a scan.
    Small,
    /// 1 MiB, about an image.
    Large,
}

/// Measures everything, and prints a table.
pub fn run(options: &Options) -> Result {
    if let Some(payload) = options.send {
        return ticket::send(payload);
    }
    if options.rounds == 0 {
        return Err(Error::Fault("--rounds 0 measures nothing; give 1 or more".to_owned()));
    }
    let mut table = String::new();
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load: Vec<_> = load.split_whitespace().take(1).collect();
    let _ = writeln!(table, "load before        {}", load.join(" "));
    pairing::measure(options.rounds, &mut table);
    ticket::measure(&mut table)?;
    std::io::stdout()
        .write_all(table.as_bytes())
        .map_err(|cause| Error::File { path: "standard output".into(), cause })
}
