//! `teseo completions` and `teseo man`: what can be made of the command line itself.

use std::process::ExitCode;

use clap::{Args, CommandFactory, ValueEnum};
use clap_complete::Shell;
use node::control::Failure;
use node::say;

use crate::Command;

/// For which shell.
#[derive(Args)]
#[command(after_help = "Examples:\n  source <(teseo completions bash)\n  \
                        teseo completions zsh > ~/.zfunc/_teseo\n  \
                        teseo completions fish > ~/.config/fish/completions/teseo.fish")]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_enum)]
    shell: Known,
}

/// The shells that people have.
#[derive(Clone, Copy, ValueEnum)]
enum Known {
    Bash,
    Zsh,
    Fish,
}

/// Of which verb.
#[derive(Args)]
#[command(after_help = "Examples:\n  teseo man | man -l -\n  teseo man topic echo | man -l -\n  \
                        teseo man > ~/.local/share/man/man1/teseo.1")]
pub(crate) struct Man {
    /// The verb [default: the program itself]
    #[arg(value_name = "VERB")]
    verb: Vec<String>,
}

/// Prints what makes the shell complete the program's words.
pub(crate) fn complete(options: &Completions) -> ExitCode {
    let shell = match options.shell {
        Known::Bash => Shell::Bash,
        Known::Zsh => Shell::Zsh,
        Known::Fish => Shell::Fish,
    };
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Command::command(), "teseo", &mut text);
    told(Ok(text))
}

/// Prints a page of the manual.
pub(crate) fn manual(options: &Man) -> ExitCode {
    told(page(&options.verb))
}

fn page(verb: &[String]) -> Result<Vec<u8>, Failure> {
    let mut command = Command::command();
    command.build();
    for word in verb {
        let found = command.find_subcommand(word).cloned();
        command = found.ok_or_else(|| {
            let words: Vec<_> = command
                .get_subcommands()
                .filter(|verb| !verb.is_hide_set())
                .map(clap::Command::get_name)
                .collect();
            let help = node::config::suggestion(word, &words);
            Failure::Refused(format!("there is no verb `{word}`; {help}"))
        })?;
    }
    let mut text = Vec::new();
    clap_mangen::Man::new(command)
        .render(&mut text)
        .map_err(|cause| Failure::Refused(cause.to_string()))?;
    Ok(text)
}

fn told(text: Result<Vec<u8>, Failure>) -> ExitCode {
    let said = text.and_then(|text| say::say(&String::from_utf8_lossy(&text)));
    let Err(failure) = said else { return ExitCode::SUCCESS };
    say::complain(&failure);
    ExitCode::from(failure.code())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every verb, with its way from the top.
    fn walk(command: &clap::Command, way: &str, visit: &mut impl FnMut(&clap::Command, &str)) {
        visit(command, way);
        let below = command.get_subcommands().filter(|command| !command.is_hide_set());
        for command in below.filter(|command| command.get_name() != "help") {
            walk(command, &format!("{way} {}", command.get_name()), visit);
        }
    }

    #[test]
    fn the_help_of_every_verb_has_an_example_of_that_verb() {
        let mut verbs = 0;
        let mut command = Command::command();
        command.build();
        walk(&command, "teseo", &mut |command, way| {
            verbs += 1;
            let help = command.clone().render_help().to_string();
            let (_, example) = help.split_once("Example").unwrap_or_else(|| {
                panic!("`{way} --help` has no example: give it an `after_help`\n{help}")
            });
            assert!(example.contains(way), "`{way} --help` has an example of something else");
        });
        assert!(30 < verbs, "only {verbs} verbs were found");
    }

    #[test]
    fn no_line_of_any_help_is_too_long() {
        let mut command = Command::command();
        command.build();
        walk(&command, "teseo", &mut |command, way| {
            let mut command = command.clone();
            for help in [command.render_help(), command.render_long_help()] {
                for line in help.to_string().lines() {
                    assert!(line.chars().count() <= say::WIDTH, "{way}: {line}");
                }
            }
        });
    }

    #[test]
    fn every_verb_has_a_page_and_is_completed() {
        let mut verbs = Vec::new();
        walk(&Command::command(), "", &mut |_, way| verbs.push(way.trim().to_owned()));
        let mut bash = Vec::new();
        clap_complete::generate(Shell::Bash, &mut Command::command(), "teseo", &mut bash);
        let bash = String::from_utf8(bash).unwrap();
        for verb in verbs {
            let words: Vec<_> = verb.split_whitespace().map(str::to_owned).collect();
            let page = String::from_utf8(page(&words).unwrap()).unwrap();
            assert!(page.contains(".SH SYNOPSIS") && page.contains("Example"), "{verb}\n{page}");
            assert!(words.iter().all(|word| bash.contains(word.as_str())), "{verb}");
        }
        assert!(page(&["tpoic".to_owned()]).is_err_and(|failure| failure.code() == 1));
    }
}
