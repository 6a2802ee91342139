//! What this machine must have for a robot before anything of it is started: what is missing later
//! ends a process in motion.

use node::launch::Launch;
use node::{Error, Namespace, Result, Settings};
use rustix::process::{Resource, getrlimit, setrlimit};

/// [-] Files and sockets that a supervisor has open for the robot as a whole, and for those who look
/// at it: some 90, and a few more while it starts.
const FILES: u64 = 112;

/// [-] And for each of its nodes. A node itself needs fewer than all of this.
const FILES_PER_NODE: u64 = 24;

/// [byte] Of addresses, beside those of shared memory: a supervisor reserves some 210 MB, most of it
/// for the C library's heaps, and never uses them. With fewer an allocation fails some time, or a
/// stack cannot grow, for which the kernel has no other word than SIGSEGV.
const ADDRESSES: u64 = 256 << 20;

/// Refuses the robot of `settings` where it could come up, but not to the end; says with what it
/// would.
pub(crate) fn check(settings: &Settings) -> Result {
    let launch = settings.launch();
    check_files(launch)?;
    check_addresses(launch)?;
    check_memory(settings)
}

/// Up to the hard limit, nobody has to be asked.
fn check_files(launch: &Launch) -> Result {
    // The pairing is a node too.
    let nodes = launch.process.len() as u64 + 1;
    let need = FILES + FILES_PER_NODE * nodes;
    let mut limit = getrlimit(Resource::Nofile);
    if limit.current.is_none_or(|limit| need <= limit) {
        return Ok(());
    }
    if limit.maximum.is_none_or(|limit| need <= limit) {
        limit.current = Some(need);
        let raised = setrlimit(Resource::Nofile, limit);
        return raised.map_err(|cause| Error::Fault(format!("cannot open {need} files: {cause}")));
    }
    let may = limit.maximum.unwrap_or_default();
    Err(Error::Fault(format!(
        "a process may open {may} files, and the robot's need {need}: ulimit -n {need}"
    )))
}

fn check_addresses(launch: &Launch) -> Result {
    let need = ADDRESSES + Namespace::need(launch);
    let Some(may) = getrlimit(Resource::As).current.filter(|may| *may < need) else {
        return Ok(());
    };
    let kibibytes = need.div_ceil(1024);
    Err(Error::Fault(format!(
        "a process may have {:.1} MiB of addresses, and the robot's need {:.1} MiB: \
         ulimit -v {kibibytes}",
        mebibytes(may),
        mebibytes(need)
    )))
}

/// What there is no room for in shared memory would kill its process in motion.
fn check_memory(settings: &Settings) -> Result {
    let (need, free) = (Namespace::need(settings.launch()), Namespace::free()?);
    if need <= free {
        return Ok(());
    }
    Err(Error::Fault(format!(
        "/dev/shm has {:.1} MiB free, and the robot needs {:.1} MiB; free some, or enlarge it: \
         mount -o remount,size=64M /dev/shm",
        mebibytes(free),
        mebibytes(need)
    )))
}

fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}
