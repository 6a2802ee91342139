//! The lock on a robot: one supervisor's, or shared by nodes that nobody supervises.

use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::Duration;

use node::{Error, Namespace, Result, clock, control};
use rustix::fs::FlockOperation;

use crate::guardian::is_alive;

/// A robot whose guardian was killed is on its way down: this is how long that may take.
const WAY_DOWN: Duration = Duration::from_secs(10);

/// Who takes the lock writes its number into it long before this.
const MOMENT: Duration = Duration::from_millis(20);

/// Between two attempts to take the lock of a robot on its way down.
const LOCK_POLL: Duration = Duration::from_millis(5);

/// The right to run a robot, held until dropped; the kernel takes it back from the dead.
#[derive(Debug)]
pub(crate) struct Lock(File);

impl Lock {
    /// Takes it, or says who has it.
    pub(crate) fn take(namespace: &Namespace) -> Result<Self> {
        let begun = clock::now();
        loop {
            namespace.create_directory()?;
            let path = namespace.lock();
            let failed = |cause| Error::File { path: path.clone(), cause };
            let mut file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&path)
                .map_err(failed)?;
            if rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
                let mut process = String::new();
                file.read_to_string(&mut process).map_err(failed)?;
                let process = process.trim();
                let patience = match process.parse() {
                    // A dead guardian's supervisor holds it until all is down.
                    Ok(pid) if !is_alive(pid) => WAY_DOWN,
                    Ok(_) => Duration::ZERO,
                    // Shared, or taken this moment.
                    Err(_) => MOMENT,
                };
                if clock::now().since(begun) < patience {
                    clock::nap(LOCK_POLL);
                    continue;
                }
                let process = if process.is_empty() { sharers(&path) } else { process.to_owned() };
                return Err(Error::Held { robot: namespace.robot().to_owned(), process });
            }
            // The former holder may have removed the file between our opening and locking it.
            let ours = file.metadata().map_err(failed)?.ino();
            if fs::metadata(&path).is_ok_and(|present| present.ino() == ours) {
                file.set_len(0).map_err(failed)?;
                file.rewind().map_err(failed)?;
                writeln!(file, "{}", std::process::id()).map_err(failed)?;
                return Ok(Self(file));
            }
        }
    }

    /// The file itself, for a process that shall hold it too.
    pub(crate) const fn file(&self) -> &File {
        &self.0
    }
}

/// The processes that share it, as far as they can be seen.
fn sharers(lock: &Path) -> String {
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    let numbers = processes.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let other = |&pid: &u32| pid != std::process::id() && control::is_open_in(pid, lock);
    let mut sharers: Vec<u32> = numbers.filter(other).collect();
    sharers.sort_unstable();
    match sharers.as_slice() {
        [] => "of somebody else".to_owned(),
        some => some.iter().map(u32::to_string).collect::<Vec<_>>().join(", "),
    }
}
