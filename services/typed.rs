//! The command line as it was typed, and what was meant where it has a verb that there is not.

use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Error, Parser};
use node::config::likely;

use crate::Command;

/// Words of ROS 2 and of other programs, and what does the same here.
const ELSEWHERE: [(&str, &str); 23] = [
    ("run", "`teseo up FILE`"),
    ("bag", "`teseo up FILE --report DIR`"),
    ("record", "`teseo up FILE --report DIR`"),
    ("interface", "`teseo topic info TOPIC`"),
    ("echo", "`teseo topic echo TOPIC`"),
    ("hz", "`teseo topic hz TOPIC`"),
    ("pub", "`teseo topic pub TOPIC FIELD=VALUE`"),
    ("list", "`teseo node list` or `teseo topic list`"),
    ("ps", "`teseo status`"),
    ("info", "`teseo status`"),
    ("rviz", "`teseo view`"),
    ("rviz2", "`teseo view`"),
    ("top", "`teseo view`"),
    ("rqt_graph", "`teseo graph`"),
    ("kill", "`teseo stop NODE` or `teseo down`"),
    ("shutdown", "`teseo down`"),
    ("quit", "`teseo down`"),
    ("clean", "`teseo clear`"),
    ("service", "`teseo param`, `arm`, `estop`: there are no services"),
    ("action", "`teseo up FILE --until round-trip`: there are no actions"),
    ("tf", "`teseo topic echo odom`: a topic has one frame"),
    ("wtf", "`teseo doctor`"),
    ("version", "`teseo --version`"),
];

/// What was typed; where that cannot be understood, says so and ends.
pub(crate) fn command() -> Command {
    Command::try_parse().unwrap_or_else(|error| explained(error).exit())
}

/// The same mistake, with what was probably meant instead of what merely has the same letters.
fn explained(mut error: Error) -> Error {
    if error.kind() != ErrorKind::InvalidSubcommand {
        return error;
    }
    let Some(ContextValue::String(word)) = error.get(ContextKind::InvalidSubcommand).cloned()
    else {
        return error;
    };
    error.remove(ContextKind::SuggestedSubcommand);
    let words: Vec<_> = std::env::args().skip(1).collect();
    let (names, is_top) = siblings(&words);
    let likely: Vec<_> = likely(&word, &names).into_iter().map(str::to_owned).collect();
    let elsewhere = ELSEWHERE.iter().find(|(other, _)| is_top && *other == word);
    if let Some((_, here)) = elsewhere {
        let tip = vec![StyledStr::from(format!("here that is {here}"))];
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(tip));
    } else if !likely.is_empty() {
        error.insert(ContextKind::SuggestedSubcommand, ContextValue::Strings(likely));
    }
    error
}

/// The verbs where the first unknown one stands in `words`, and whether that is at the top.
fn siblings(words: &[String]) -> (Vec<String>, bool) {
    let mut command = Command::command();
    let mut is_top = true;
    for word in words {
        let Some(found) = command.find_subcommand(word) else { break };
        command = found.clone();
        is_top = false;
    }
    let known = command.get_subcommands().filter(|known| !known.is_hide_set());
    (known.map(|known| known.get_name().to_owned()).collect(), is_top)
}
