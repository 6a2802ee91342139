//! How a run ended: the one line and the exit code.

use crate::machine::{Cause, Ending};
use crate::member::Member;

/// The exit code of a configuration that will not get better by itself.
const CONFIGURATION: i32 = 78;

/// How a run ended.
#[derive(Debug, Clone)]
pub(crate) struct Verdict {
    /// What happened, in one line.
    pub(crate) cause: String,
    /// The same, to be printed.
    pub(crate) line: String,
    /// [-] The exit code: 0 where the end was reached or somebody asked for it, 1 where the run
    /// failed, 3 where a node was given up, 4 where one did not come up, 6 where one had to be
    /// killed on the way down, 78 for the configuration.
    pub(crate) code: u8,
}

impl Verdict {
    pub(crate) fn new(ending: &Ending, members: &[Member], had_to_kill: bool) -> Self {
        let name = |node: usize| members[node].name.as_str();
        let (cause, code) = match ending {
            Ending::Done(why) => (why.clone(), 0),
            Ending::Failed(why) => (why.clone(), 1),
            Ending::Asked => ("asked to stop".to_owned(), 0),
            Ending::NotStarted { node, cause } => {
                let is_configuration = members[*node].exit_code == Some(CONFIGURATION);
                let code = if is_configuration { 78 } else { 4 };
                (format!("{} did not come up: {cause}", name(*node)), code)
            }
            Ending::GaveUp { node, cause, failures } => (gave_up(name(*node), cause, *failures), 3),
        };
        let (cause, code) = match code {
            0 if had_to_kill => (format!("{cause}; a node had to be killed"), 6),
            code => (cause, code),
        };
        let line = format!("{cause}\n");
        Self { cause, line, code }
    }
}

fn gave_up(name: &str, cause: &Cause, failures: u32) -> String {
    if failures <= 1 {
        return format!("{name} {cause}");
    }
    format!("gave up on {name} after {failures} failures, the last: it {cause}")
}
