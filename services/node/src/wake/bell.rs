//! A word in shared memory: a process sleeps on it, and others wake it by changing it (`futex(2)`).

use std::sync::atomic::Ordering::SeqCst;
use std::time::Duration;

use iceoryx2::prelude::{FileName, SemanticString, ZeroCopySend};
use iceoryx2_bb_concurrency::atomic::AtomicU32;
use iceoryx2_cal::dynamic_storage::posix_shared_memory::{Configuration, Storage};
use iceoryx2_cal::dynamic_storage::{DynamicStorage, DynamicStorageBuilder};
use iceoryx2_cal::named_concept::{NamedConceptBuilder, NamedConceptConfiguration};
use rustix::io::Errno;
use rustix::thread::futex;
use rustix::time::Timespec;

use crate::{Error, Result};

/// Far longer than it takes another process to make eight bytes of shared memory.
const OPEN_TIMEOUT: Duration = Duration::from_secs(1);

/// [-] All that sleep: a former life may still be on its way out.
const EVERYBODY: u32 = i32::MAX.cast_unsigned();

/// What both sides see.
#[derive(Debug, ZeroCopySend)]
#[type_name("Word/1")]
#[repr(C)]
struct Word {
    /// [-] How often it was rung.
    rings: AtomicU32,
    /// [-] 1 while its owner sleeps or is about to: else nobody needs to be woken.
    asleep: AtomicU32,
}

/// What one process is woken by.
#[derive(Debug)]
pub(super) struct Bell(Storage<Word>);

impl Bell {
    /// That of the process called `owner`, made by whoever needs it first. It stays until the whole
    /// robot's files are removed, so that a publisher rings the right one after its owner's restart.
    pub(super) fn open(prefix: &str, owner: &str) -> Result<Self> {
        let failed = |cause: &dyn std::fmt::Debug| {
            Error::shared_memory(format!("open the wake-up channel of '{owner}'"), cause)
        };
        let name = |name: &str| FileName::new(name.as_bytes()).map_err(|cause| failed(&cause));
        let config = Configuration::default().prefix(&name(prefix)?);
        <Storage<Word> as DynamicStorage<Word>>::Builder::new(&name(&format!("wake_{owner}"))?)
            .config(&config)
            .has_ownership(false)
            .timeout(OPEN_TIMEOUT)
            .initializer(|word, _| {
                word.write(Word { rings: AtomicU32::new(0), asleep: AtomicU32::new(0) });
                true
            })
            .open_or_create()
            .map(Self)
            .map_err(|cause| failed(&cause))
    }

    /// [-] How often it was rung so far, modulo 2³².
    pub(super) fn rings(&self) -> u32 {
        self.0.get().rings.load(SeqCst)
    }

    /// Wakes its owner, if it sleeps, and keeps it from falling asleep over this.
    pub(super) fn ring(&self) -> Result {
        let word = self.0.get();
        word.rings.fetch_add(1, SeqCst);
        if word.asleep.load(SeqCst) == 0 {
            return Ok(());
        }
        futex::wake(&word.rings, futex::Flags::empty(), EVERYBODY)
            .map(drop)
            .map_err(|cause| Error::shared_memory("wake a reader", cause))
    }

    /// Sleeps until it has been rung more often than `seen`, a signal arrives, or `timeout` is over.
    pub(super) fn sleep(&self, seen: u32, timeout: Duration) -> Result {
        let Ok(timeout) = Timespec::try_from(timeout) else { return Ok(()) };
        let word = self.0.get();
        // Either the kernel sees the new number of rings, or whoever rings sees that we sleep.
        word.asleep.store(1, SeqCst);
        let woken = futex::wait(&word.rings, futex::Flags::empty(), seen, Some(&timeout));
        word.asleep.store(0, SeqCst);
        match woken {
            Ok(()) | Err(Errno::AGAIN | Errno::TIMEDOUT | Errno::INTR) => Ok(()),
            Err(cause) => Err(Error::shared_memory("wait", cause)),
        }
    }
}
