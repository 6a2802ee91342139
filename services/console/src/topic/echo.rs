//! `teseo topic echo`: samples as they come.

use std::time::Duration;

use clap::Args;
use interfaces::Field;
use node::config::suggestion;
use node::control::Failure;
use node::observe::{Observer, Row, Seen};
use node::say::{mention, say};
use node::{clock, signal};

use super::show::{all_fields, cells, json_of, object, text, value};
use super::{check_presence, join, open, row};
use crate::{Which, refused};

/// Between two looks at what has come: half a queue of a topic at 1 kHz.
const POLL: Duration = Duration::from_millis(5);

/// The same until the first has come, which somebody waits for.
const POLL_FIRST: Duration = Duration::from_millis(1);

/// What to print of which topic.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  teseo topic echo odom --once\n  \
                        teseo topic echo odom --field x -n 10\n  \
                        teseo topic echo scan --json | head -1")]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag on the command line")]
pub(crate) struct Options {
    #[command(flatten)]
    robot: Which,
    /// The topic
    topic: String,
    /// Print only this field
    #[arg(long, value_name = "NAME")]
    field: Option<String>,
    /// End after so many samples
    #[arg(short = 'n', long, value_name = "NUMBER")]
    count: Option<u64>,
    /// End after one sample
    #[arg(long, conflicts_with = "count")]
    once: bool,
    /// Print long lists to their end
    #[arg(short, long)]
    full_length: bool,
    /// Print one JSON object a line
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print a table with commas, under a line of titles
    #[arg(long)]
    csv: bool,
}

/// Prints samples until there were enough, Ctrl-C, or the robot goes away.
pub(super) fn echo(options: &Options) -> Result<u8, Failure> {
    let robot = options.robot.find()?;
    let row = row(&robot, &options.topic)?;
    check_field(options, &row)?;
    signal::listen();
    let session = join(&robot)?;
    let mut observer = open(&session, &robot, &row)?;
    if observer.publishers().is_empty() {
        mention(&format!("nobody publishes {} ({}) yet; waiting", row.name, row.publisher));
    }
    let count = if options.once { Some(1) } else { options.count };
    let mut printer = Printer { options, printed: 0, columns: 0 };
    loop {
        while let Some(sample) = next(&mut *observer)? {
            printer.print(&*sample)?;
            if count.is_some_and(|count| count <= printer.printed) {
                return Ok(0);
            }
        }
        check_presence(&robot)?;
        clock::nap(if printer.printed == 0 { POLL_FIRST } else { POLL });
    }
}

fn next(observer: &mut dyn Observer) -> Result<Option<Box<dyn Seen>>, Failure> {
    observer.receive().map_err(|error| refused(&error))
}

fn check_field(options: &Options, row: &Row) -> Result<(), Failure> {
    let Some(name) = &options.field else { return Ok(()) };
    let names: Vec<_> = all_fields(&interfaces::Header::default(), row.fields.clone())
        .iter()
        .map(|f| f.name)
        .collect();
    if names.contains(&name.as_str()) {
        return Ok(());
    }
    let help = suggestion(name, &names);
    Err(Failure::Refused(format!("{} has no field `{name}`; {help}", row.name)))
}

/// Prints one sample after the other.
struct Printer<'a> {
    options: &'a Options,
    printed: u64,
    /// [-] Of the table, by its first row.
    columns: usize,
}

impl Printer<'_> {
    fn print(&mut self, sample: &dyn Seen) -> Result<(), Failure> {
        let header = sample.header();
        let fields = all_fields(&header, sample.fields());
        let wanted: Vec<Field> = match &self.options.field {
            Some(name) => fields.into_iter().filter(|field| field.name == name).collect(),
            None => fields,
        };
        let line = match (&self.options.field, wanted.first()) {
            _ if self.options.csv => self.row(&wanted),
            (Some(_), Some(field)) if self.options.json => json_of(&field.value).to_string(),
            (Some(_), Some(field)) => value(&field.value),
            _ if self.options.json => object(&wanted).to_string(),
            _ => format!("{}\n---", text(&header, &sample.fields(), self.options.full_length)),
        };
        self.printed += 1;
        say(&line)
    }

    /// A row of the table, after its titles where it is the first.
    fn row(&mut self, fields: &[Field]) -> String {
        let cells = cells(fields);
        let join = |part: fn(&(String, String)) -> &str| {
            cells.iter().map(part).collect::<Vec<_>>().join(",")
        };
        let row = join(|cell| &cell.1);
        if self.columns == cells.len() {
            return row;
        }
        // Of another length than before, as a scan with fewer beams: it has titles of its own.
        self.columns = cells.len();
        format!("{}\n{row}", join(|cell| &cell.0))
    }
}
