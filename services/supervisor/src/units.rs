//! `teseo units`: the launch file as systemd units.

mod escape;
mod hardening;
mod one_unit;
mod per_node;
mod unit;

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use clap::Args;
use node::launch::Launch;
use node::{Error, Namespace, Result};

use crate::check::check_all;
use crate::{Check, shim};

/// What to generate.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  teseo units config/lab_robot.toml --out /etc/systemd/system")]
pub struct UnitsOptions {
    /// The launch file
    #[arg(value_name = "CONFIG", default_value = "config/simulation.toml")]
    pub config: PathBuf,

    /// Write the units into this directory [default: print them]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// For the systemd of the user, not of the system
    #[arg(long)]
    pub user: bool,

    /// A unit for each node, with systemd as the supervisor, instead of one for `teseo up`
    #[arg(long)]
    pub per_node: bool,

    /// The systemd that they are for [default: the installed one]
    #[arg(long, value_name = "VERSION")]
    pub systemd: Option<u32>,
}

/// The systemd of Debian 12: what cannot be asked is taken to be no younger.
const SYSTEMD_USUAL: u32 = 252;

/// Below systemd's runtime directory, `/run` or the user's.
const RUNTIME: &str = "teseo";

/// What all units of a robot are made of.
#[derive(Debug)]
struct Robot {
    launch: Launch,
    config: PathBuf,
    program: PathBuf,
    is_user: bool,
    systemd: u32,
}

/// One unit file.
#[derive(Debug)]
struct File {
    name: String,
    text: String,
}

/// Prints the units or writes them; exit code 78 where the launch file cannot be theirs.
pub(crate) fn units(options: &UnitsOptions, check: Check) -> ExitCode {
    node::exit_code("teseo units", make(options, check))
}

fn make(options: &UnitsOptions, check: Check) -> Result {
    check_all(&options.config, &[], check)?;
    let systemd = options.systemd.or_else(installed_systemd).unwrap_or(SYSTEMD_USUAL);
    let launch = Launch::read_and(&options.config, &[], |launch, report| {
        if options.per_node {
            per_node::check(launch, systemd, report);
        }
    })?;
    let robot = Robot {
        launch,
        config: absolute(&options.config)?,
        program: shim::own_path(),
        is_user: options.user,
        systemd,
    };
    robot.check_directory()?;
    let files =
        if options.per_node { per_node::files(&robot)? } else { vec![one_unit::file(&robot)?] };
    if options.per_node {
        for note in per_node::notes(&robot.launch, systemd) {
            // Whoever closed our standard error does not want to know.
            drop(writeln!(std::io::stderr(), "teseo units: {note}"));
        }
    }
    let said = match &options.out {
        Some(directory) => write(directory, &files, &robot, options.per_node)?,
        None => files.iter().flat_map(|file| ["# ", &file.name, "\n", &file.text, "\n"]).collect(),
    };
    drop(std::io::stdout().write_all(said.as_bytes()));
    Ok(())
}

/// As `systemctl --version` says: `systemd 252 (252.38-1~deb12u1)`.
fn installed_systemd() -> Option<u32> {
    let output = Command::new("systemctl").arg("--version").output().ok()?;
    String::from_utf8(output.stdout).ok()?.split_whitespace().nth(1)?.parse().ok()
}

fn absolute(path: &Path) -> Result<PathBuf> {
    fs::canonicalize(path).map_err(|cause| Error::File { path: path.to_owned(), cause })
}

impl Robot {
    /// What every unit file of this robot begins with, so that whoever removes them finds them.
    fn mark(&self) -> String {
        format!("# Made by `teseo units` for the robot {}", self.launch.robot)
    }

    /// The name that all others begin with.
    fn name(&self) -> String {
        format!("teseo-{}", self.launch.robot)
    }

    /// The directory above the robot's own, as a unit says it.
    fn runtime_directory(&self) -> String {
        let above = if self.is_user { "%t" } else { "/run" };
        format!("{above}/{RUNTIME}")
    }

    /// Refuses a robot's name too long for the sockets in its directory.
    fn check_directory(&self) -> Result {
        let uid = rustix::process::getuid().as_raw();
        let above = if self.is_user { format!("/run/user/{uid}") } else { "/run".to_owned() };
        Namespace::under(&Path::new(&above).join(RUNTIME), &self.launch.robot).map(drop)
    }

    /// How the directories end in which systemd looks for units.
    const fn search_path(&self) -> &'static str {
        if self.is_user { "systemd/user" } else { "systemd/system" }
    }

    /// The target that starts it with the machine, or when the user comes.
    const fn wanted_by(&self) -> &'static str {
        if self.is_user { "default.target" } else { "multi-user.target" }
    }
}

/// Writes all files, each whole or not at all, and says what to type next.
fn write(directory: &Path, files: &[File], robot: &Robot, per_node: bool) -> Result<String> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |cause| Error::File { path, cause }
    };
    fs::create_dir_all(directory).map_err(failed(directory))?;
    let mut renames = Vec::new();
    for file in files {
        let path = directory.join(&file.name);
        // Not a unit's name, so that systemd does not take it for one.
        let fresh = directory.join(format!(".{}.{}.new", file.name, std::process::id()));
        fs::write(&fresh, &file.text).map_err(failed(&fresh))?;
        renames.push((fresh, path));
    }
    let mut said = String::new();
    for (fresh, path) in renames {
        fs::rename(&fresh, &path).map_err(failed(&path))?;
        let _ = writeln!(said, "wrote {}", path.display());
    }
    said.push_str(&next(robot, per_node, directory, files)?);
    Ok(said)
}

/// The commands to type next.
fn next(robot: &Robot, per_node: bool, directory: &Path, files: &[File]) -> Result<String> {
    let (systemctl, journalctl) = if robot.is_user {
        ("systemctl --user", "journalctl --user")
    } else {
        ("systemctl", "journalctl")
    };
    let (name, user) = (robot.name(), hardening::USER);
    let mut next = String::from("next:\n");
    if !robot.is_user {
        let _ = writeln!(
            next,
            "  getent passwd {user} >/dev/null || useradd --system --no-create-home {user}"
        );
    }
    let directory = absolute(directory)?;
    if !directory.ends_with(robot.search_path()) {
        for file in files {
            let _ = writeln!(next, "  {systemctl} link {}", directory.join(&file.name).display());
        }
    }
    let start = if per_node { format!("{name}.target") } else { format!("{name}.service") };
    let _ = writeln!(next, "  {systemctl} daemon-reload");
    let _ = writeln!(next, "  {systemctl} enable --now {start}");
    let _ = writeln!(next, "  {journalctl} --follow --unit='{name}.*'");
    if per_node {
        let _ = writeln!(
            next,
            "stop the whole robot, `{systemctl} stop {start}`: a node that is stopped alone is \
             started again at once"
        );
    }
    Ok(next)
}
