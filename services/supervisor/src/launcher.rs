//! How a node's process is started.

use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

use node::launch::Process;
use node::{Namespace, Settings};

use crate::{Options, guardian, shim, shown, sweep};

/// What all processes of the robot are started with.
#[derive(Debug)]
pub(crate) struct Launcher {
    settings: Settings,
    /// Of a managed node.
    arguments: Vec<String>,
    directory: PathBuf,
    notify: PathBuf,
    /// Where nodes write down what they have noted, where anybody wants it.
    records: Option<PathBuf>,
    /// The timeline that nodes make parts of, where anybody wants it.
    trace: Option<PathBuf>,
}

impl Launcher {
    pub(crate) fn new(settings: &Settings, options: &Options, namespace: &Namespace) -> Self {
        let log = options.log;
        let mut arguments = vec![
            format!("--config={}", options.config.display()),
            format!("--log-format={}", log.format.label()),
            format!("--log-level={}", log.level),
        ];
        arguments.extend(options.sets().into_iter().map(|set| format!("--set={set}")));
        let directory = namespace.directory().to_owned();
        let (records, trace) = (options.records().map(Path::to_owned), options.trace.clone());
        let (settings, notify) = (settings.clone(), directory.join("notify"));
        Self { settings, arguments, directory, notify, records, trace }
    }

    /// The socket on which nodes notify the supervisor.
    pub(crate) fn notify(&self) -> &PathBuf {
        &self.notify
    }

    /// For a node in a thread of this process.
    pub(crate) fn settings_of_thread(&self, name: &str, epoch: u32) -> Settings {
        self.settings.within(name).in_life(epoch, &self.notify, self.trace.as_deref())
    }

    /// Starts the process called `name` in life number `epoch`.
    pub(crate) fn start(
        &self,
        name: &str,
        epoch: u32,
        output: (Stdio, Stdio),
    ) -> Result<Child, String> {
        let process = self.settings.launch().process(name);
        let process = process.ok_or_else(|| format!("the launch file has no process '{name}'"))?;
        let (program, arguments) = self.program(process, epoch)?;
        let mut command = shim::command(process, &program, &arguments);
        command
            .stdin(Stdio::null())
            .stdout(output.0)
            .stderr(output.1)
            // Ctrl-C is not for the nodes: they are stopped in order.
            .process_group(0)
            .envs(&process.environment)
            .env(sweep::MARK, &self.directory)
            .env("TESEO_NODE", name)
            .env("TESEO_EPOCH", epoch.to_string())
            .env("NOTIFY_SOCKET", &self.notify)
            .envs(self.records.as_ref().map(|records| (node::RECORDS, records)))
            .envs(self.trace.as_ref().map(|trace| (node::trace::TRACE, trace)))
            .env_remove("WATCHDOG_PID")
            .env_remove("WATCHDOG_USEC")
            .env_remove(node::PARENT)
            .env_remove(guardian::ROLE)
            .env_remove(shown::SHOWN);
        if let Some(limit) = process.watchdog() {
            command.env("WATCHDOG_USEC", limit.as_micros().to_string());
        }
        command.spawn().map_err(|cause| format!("cannot run it: {cause}"))
    }

    /// What to run: the program and its arguments.
    fn program(&self, process: &Process, epoch: u32) -> Result<(PathBuf, Vec<String>), String> {
        let (program, mut arguments) = match process.exec.split_first() {
            Some((program, rest)) => (shim::find_program(program)?, rest.to_vec()),
            None => (shim::own_path(), vec![process.name.clone()]),
        };
        if process.is_managed() {
            arguments.push(format!("--name={}", process.name));
            arguments.push(format!("--epoch={epoch}"));
            arguments.extend_from_slice(&self.arguments);
        }
        Ok((program, arguments))
    }
}
