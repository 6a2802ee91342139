//! Measures the runtime on the machine at hand, so that a sceptic may believe it: separate
//! processes, payloads written and read in full, every value counted, and beside each figure what the
//! machine itself takes.

#![forbid(unsafe_code)]

mod advice;
mod bridge;
mod busy;
mod card;
mod chain;
mod compare;
mod cost;
mod headline;
mod hop;
mod lockstep;
mod measured;
mod pairing;
mod payload;
mod peers;
mod robot;
mod table;
mod ticket;
mod work;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, ValueEnum};
use node::{Error, Namespace, Result, signal};

use busy::Watch;
use card::Card;
use headline::{CONTAMINATED_MAX, Headline};
use measured::{Book, Figure, VERSION};
use peers::Part;
use work::Work;

/// What to measure, and what becomes of it.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:\n  teseo bench\n  teseo bench hop --json > old.json\n  \
    teseo bench hop --compare old.json\n  teseo bench --from old.json")]
pub struct Options {
    /// What to measure; everything where nothing is named
    #[arg(value_name = "ROW")]
    pub rows: Vec<Row>,

    /// [-] Rounds; in each, everything is measured once, so that all meet the same machine
    #[arg(long, value_name = "NUMBER", default_value_t = 5)]
    pub rounds: u32,

    /// A quick look: two rounds of a few samples each
    #[arg(long)]
    pub quick: bool,

    /// Only figures whose name contains this
    #[arg(long, value_name = "TEXT")]
    pub only: Option<String>,

    /// Print everything as JSON
    #[arg(long, conflicts_with = "csv")]
    pub json: bool,

    /// Print every round of every figure as CSV
    #[arg(long)]
    pub csv: bool,

    /// Say what has become faster or slower since the run of this file, made by --json
    #[arg(long, value_name = "OLD.json")]
    pub compare: Option<PathBuf>,

    /// Measure nothing: take the figures of this file, made by --json
    #[arg(long, value_name = "FILE", conflicts_with_all = ["rows", "quick"])]
    pub from: Option<PathBuf>,

    /// [-] Share of contaminated rounds past which there is no headline
    #[arg(long, value_name = "SHARE", default_value_t = CONTAMINATED_MAX)]
    pub contaminated_max: f64,

    /// Be one of the processes that measure
    #[arg(long, hide = true, value_name = "JSON")]
    pub part: Option<Part>,
}

/// A part of the bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Row {
    /// One hop between processes: every way there is, and the floor of this machine
    Hop,
    /// Pairing, and a pair by ticket with payloads of growing size
    Pair,
    /// The whole loop in real time: from scan to wheel, segment by segment
    Loop,
    /// The bridge before an emulated TurtleBot3: to and from its ports, and its share of a processor
    Bridge,
    /// Lock-step: steps a second, and how they grow with beams, walls and robots
    Lockstep,
    /// What a robot at 20 Hz takes of processors and memory, and how long it takes to start
    Cost,
}

/// How much is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Effort {
    /// Enough for figures that can be believed.
    Whole,
    /// Enough to see that it works.
    Quick,
}

/// [-] Rounds of a quick look.
const ROUNDS_QUICK: u32 = 2;

/// What is driven in one process.
#[derive(Debug, Clone, Copy)]
pub struct Course {
    /// [-] Of each robot's LiDAR.
    pub beams: usize,
    /// [-] Walls that stand around the lab's maze.
    pub more_walls: usize,
    /// [-] Robots in this one world, who see and stop each other.
    pub robots: usize,
}

/// What came of it.
#[derive(Debug, Clone, Copy)]
pub struct Driven {
    /// [m] All robots together.
    pub distance: f64,
    /// How long it took, once everything was there.
    pub took: Duration,
}

/// Drives so many steps of the lab's loop in this process. The binary tells it, since no service knows
/// the others.
pub type Drive = fn(u64, &Course) -> Result<Driven>;

/// Measures, and prints what was found.
pub fn run(options: &Options, drive: Drive) -> Result {
    if let Some(part) = &options.part {
        return peers::play(part);
    }
    if options.rounds == 0 {
        return Err(Error::Fault("--rounds 0 measures nothing; give 1 or more".to_owned()));
    }
    let old = options.compare.as_deref().map(read).transpose()?;
    let mut book = match &options.from {
        Some(path) => read(path)?,
        None => measure(options, drive)?,
    };
    book.headline = Headline::of(&book.figures, options.contaminated_max);
    let mut text = if options.json {
        serde_json::to_string_pretty(&book).map_err(|cause| Error::Fault(cause.to_string()))?
    } else if options.csv {
        table::csv(&book)
    } else {
        table::text(&book)
    };
    if options.json {
        text.push('\n');
    }
    if let Some(old) = &old {
        let mut verdicts = String::new();
        compare::write(&book, old, &mut verdicts);
        if options.json || options.csv {
            say(&verdicts);
        } else {
            text.push_str(&verdicts);
        }
    }
    std::io::stdout()
        .write_all(text.as_bytes())
        .map_err(|cause| Error::File { path: "standard output".into(), cause })
}

fn read(path: &Path) -> Result<Book> {
    let failed = |cause| Error::File { path: path.to_owned(), cause };
    let text = std::fs::read_to_string(path).map_err(failed)?;
    serde_json::from_str(&text).map_err(|cause| {
        let path = path.display();
        Error::Fault(format!(
            "{path} is not what this version's `teseo bench --json` prints: {cause}"
        ))
    })
}

/// Every configuration once in each round, so that all of them meet the same machine.
fn measure(options: &Options, drive: Drive) -> Result<Book> {
    signal::listen();
    clear_after_the_dead();
    let cores = peers::cores();
    let mut card = Card::of_this_machine(cores.len());
    let (effort, rounds) =
        if options.quick { (Effort::Quick, ROUNDS_QUICK) } else { (Effort::Whole, options.rounds) };
    let (mut works, absent) = work::configurations(&options.rows, cores.len(), drive);
    if let Some(only) = &options.only {
        works.retain(|work| work.collected().iter().any(|figure| figure.is_called(only)));
        if works.is_empty() {
            return Err(Error::Fault(format!("nothing that is measured is called '{only}'")));
        }
    }
    let mut collected: Vec<_> = works.iter().map(Work::collected).collect();
    let namespace = Namespace::new(&format!("bench-{}", std::process::id()))?;
    let all = Watch::start();
    for round in 0..rounds {
        for (index, (work, collected)) in works.iter().zip(&mut collected).enumerate() {
            progress(round, rounds, index, works.len());
            let watch = Watch::start();
            let values = work.measure(&namespace, effort)?;
            let others = watch.others();
            for (collected, values) in collected.iter_mut().zip(values) {
                collected.add(values, others)?;
            }
        }
    }
    progress(rounds, rounds, 0, works.len());
    let others = all.others();
    (card.foreign, card.steal) = (others.foreign, others.steal);
    card.note_load_after();
    let figures: Vec<Figure> =
        collected.into_iter().flatten().filter_map(measured::Collected::figure).collect();
    Ok(Book { version: VERSION, card, figures, absent, headline: Headline::default() })
}

/// Removes what benches left that were killed: nobody else ever uses their names.
fn clear_after_the_dead() {
    for namespace in Namespace::all_under(&Namespace::runtime_directory()) {
        let process =
            namespace.robot().strip_prefix("bench-").and_then(|id| id.parse::<u32>().ok());
        if process.is_some_and(|id| !Path::new(&format!("/proc/{id}")).exists()) {
            namespace.remove();
        }
    }
}

/// On a terminal a line that is written over; else a line for each round.
fn progress(round: u32, rounds: u32, index: usize, count: usize) {
    use std::io::IsTerminal;
    let is_over = round == rounds;
    if std::io::stderr().is_terminal() {
        let line = format!("\rround {} of {rounds}, {} of {count} ", round + 1, index + 1);
        say(if is_over { "\r\x1b[K" } else { &line });
    } else if index == 0 && !is_over {
        say(&format!("round {} of {rounds}, {count} measurements\n", round + 1));
    }
}

fn say(text: &str) {
    // Whoever closed our standard error does not want to know.
    drop(std::io::stderr().write_all(text.as_bytes()));
}
