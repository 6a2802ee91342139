//! A replay in words, or in JSON.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::time::Duration;

use super::{Loss, Replay};

pub(super) fn write_json(replay: &Replay, output: &mut impl Write) -> io::Result<()> {
    serde_json::to_writer(&mut *output, replay)?;
    writeln!(output)
}

pub(super) fn write_text(replay: &Replay, line: usize, output: &mut impl Write) -> io::Result<()> {
    let name = if replay.id.is_empty() { format!("line {line}") } else { replay.id.clone() };
    let slop = Duration::from_nanos(replay.slop_ns);
    writeln!(
        output,
        "{name}: {}, queue {}, slop {slop:?}, topics {}, {} events, {} pairs",
        replay.policy,
        replay.queue_size,
        replay.topics.join(" "),
        replay.events,
        replay.matches.len(),
    )?;
    write_log(replay, output)?;
    write_books(replay, output)?;
    write_delays(replay, output)?;
    for hint in &replay.hints {
        writeln!(output, "  hint: {hint}")?;
    }
    writeln!(output)
}

/// What happened, event by event.
fn write_log(replay: &Replay, output: &mut impl Write) -> io::Result<()> {
    let mut dropped = replay.dropped.iter().peekable();
    for (number, at) in replay.match_at.iter().enumerate() {
        while let Some(loss) = dropped.next_if(|loss| loss.at <= *at) {
            write_loss(loss, output)?;
        }
        let mut members = String::new();
        let stamps = replay.matches[number].iter().zip(&replay.match_events[number]);
        for (topic, (stamp, event)) in replay.topics.iter().zip(stamps) {
            // Writing to a string cannot fail.
            let _ = write!(members, "{topic} {stamp} (event {event})  ");
        }
        writeln!(
            output,
            "  at {at:>5}  {:<13} {members}spread {:?}  delay {:?}",
            "pair",
            Duration::from_nanos(replay.spreads_ns[number]),
            Duration::from_nanos(replay.delays_ns[number]),
        )?;
    }
    dropped.try_for_each(|loss| write_loss(loss, output))
}

fn write_loss(loss: &Loss, output: &mut impl Write) -> io::Result<()> {
    let Loss { event, topic, stamp_ns, reason, at } = loss;
    writeln!(output, "  at {at:>5}  {reason:<13} {topic} {stamp_ns} (event {event})")
}

fn write_books(replay: &Replay, output: &mut impl Write) -> io::Result<()> {
    for topic in &replay.topics {
        let books = &replay.books[topic];
        write!(
            output,
            "  {topic}: received {} = paired {} + queued {}",
            books.received, books.paired, books.queued,
        )?;
        for (reason, count) in &books.dropped {
            write!(output, " + {reason} {count}")?;
        }
        writeln!(output)?;
    }
    Ok(())
}

fn write_delays(replay: &Replay, output: &mut impl Write) -> io::Result<()> {
    for (name, values) in [("spread", &replay.spreads_ns), ("delay", &replay.delays_ns)] {
        let mut sorted = values.clone();
        sorted.sort_unstable();
        if let (Some(median), Some(max)) = (sorted.get(sorted.len() / 2), sorted.last()) {
            let (median, max) = (Duration::from_nanos(*median), Duration::from_nanos(*max));
            writeln!(output, "  {name}: median {median:?}, greatest {max:?}")?;
        }
    }
    if 0 < replay.resets + replay.forced {
        writeln!(output, "  resets {}, forced out by delay {}", replay.resets, replay.forced)?;
    }
    Ok(())
}
