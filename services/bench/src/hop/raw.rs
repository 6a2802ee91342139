//! The floor of this machine: a word in shared memory and the payload beside it, looked at or slept
//! on.

use std::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use std::time::Duration;

use hdrhistogram::Histogram;
use iceoryx2::prelude::{FileName, SemanticString, ZeroCopySend};
use iceoryx2_bb_concurrency::atomic::{AtomicU32, AtomicU64};
use iceoryx2_cal::dynamic_storage::posix_shared_memory::{Configuration, Storage};
use iceoryx2_cal::dynamic_storage::{DynamicStorage, DynamicStorageBuilder};
use iceoryx2_cal::named_concept::{NamedConceptBuilder, NamedConceptConfiguration};
use interfaces::Stamp;
use node::{Error, Namespace, Result, clock};
use rustix::io::Errno;
use rustix::thread::futex;

use super::side::{Arrival, Body, End, LIFE_MAX, Link, check_time, look};
use super::{Size, Way};
use crate::peers::Role;

/// Long enough for the other side to fill two mebibytes.
const OPEN_TIMEOUT: Duration = Duration::from_secs(5);

/// However long nothing comes, a wait ends.
const WAIT_SECONDS: i64 = 1;

/// [-] Words of the largest payload.
const WORDS_MAX: usize = Size::Large.bytes() / 8;

/// What both sides have in common.
#[derive(Debug, ZeroCopySend)]
#[type_name("bench/Board/1")]
#[repr(C)]
struct Board {
    /// From the sender, and from the reader.
    lane: [Lane; 2],
}

/// One direction. The word that is waited for has a pair of cache lines to itself.
#[derive(Debug, ZeroCopySend)]
#[type_name("bench/Lane/1")]
#[repr(C)]
#[repr(align(128))]
struct Lane {
    /// [-] Samples sent so far.
    sent: AtomicU32,
    /// [-] Nothing.
    reserved: [AtomicU32; 31],
    /// [ns] The newest one's stamp.
    stamp: AtomicU64,
    /// [-] The newest one.
    words: [AtomicU64; WORDS_MAX],
}

impl Board {
    #[expect(clippy::large_stack_arrays, reason = "two mebibytes, once; a box cannot be shared")]
    const fn new() -> Self {
        Self { lane: [const { Lane::new() }; 2] }
    }
}

impl Lane {
    #[expect(clippy::large_stack_arrays, reason = "see above")]
    const fn new() -> Self {
        Self {
            sent: AtomicU32::new(0),
            reserved: [const { AtomicU32::new(0) }; 31],
            stamp: AtomicU64::new(0),
            words: [const { AtomicU64::new(0) }; WORDS_MAX],
        }
    }
}

pub(super) fn with_link(
    end: &End<'_>,
    namespace: &Namespace,
    body: Body<'_>,
) -> Result<Histogram<u64>> {
    let board = open(namespace)?;
    let [from_sender, from_reader] = &board.get().lane;
    let (read, written) = match end.role {
        Role::Sender => (from_reader, from_sender),
        Role::Reader(_) => (from_sender, from_reader),
    };
    // The stamp stands for the header.
    let words = (end.hop.size.bytes() / 8).saturating_sub(4);
    let until = clock::now().after(LIFE_MAX);
    body(&mut Raw { read, written, words, received: 0, way: end.hop.way, until })
}

/// Made by whoever comes first; removed with everything else in the namespace.
fn open(namespace: &Namespace) -> Result<Storage<Board>> {
    let failed = |cause: &dyn std::fmt::Debug| {
        Error::Fault(format!("cannot share memory with the other side: {cause:?}"))
    };
    let name = |name: &str| FileName::new(name.as_bytes()).map_err(|cause| failed(&cause));
    let config = Configuration::default().prefix(&name(namespace.prefix())?);
    <Storage<Board> as DynamicStorage<Board>>::Builder::new(&name("board")?)
        .config(&config)
        .has_ownership(false)
        .timeout(OPEN_TIMEOUT)
        .initializer(|board, _| {
            board.write(Board::new());
            true
        })
        .open_or_create()
        .map_err(|cause| failed(&cause))
}

struct Raw<'a> {
    read: &'a Lane,
    written: &'a Lane,
    words: usize,
    received: u32,
    way: Way,
    until: Stamp,
}

impl Raw<'_> {
    fn await_next(&self) -> Result {
        let has_come = || Ok((self.read.sent.load(Acquire) != self.received).then_some(()));
        match self.way {
            Way::Futex => self.sleep(),
            Way::FlagYield => look(self.until, rustix::thread::sched_yield, has_come),
            _ => look(self.until, std::hint::spin_loop, has_come),
        }
    }

    fn sleep(&self) -> Result {
        let limit = rustix::time::Timespec { tv_sec: WAIT_SECONDS, tv_nsec: 0 };
        while self.read.sent.load(Acquire) == self.received {
            match futex::wait(&self.read.sent, futex::Flags::empty(), self.received, Some(&limit)) {
                // Woken, or it has come before the sleep began.
                Ok(()) | Err(Errno::AGAIN | Errno::INTR) => {}
                Err(Errno::TIMEDOUT) => check_time(self.until)?,
                Err(cause) => return Err(Error::Fault(format!("cannot sleep: {cause}"))),
            }
        }
        Ok(())
    }
}

impl Link for Raw<'_> {
    fn send(&mut self, number: u64, stamp: Stamp) -> Result {
        self.written.stamp.store(stamp.nanoseconds, Relaxed);
        for word in &self.written.words[..self.words] {
            word.store(number, Relaxed);
        }
        self.written.sent.fetch_add(1, Release);
        if self.way == Way::Futex {
            futex::wake(&self.written.sent, futex::Flags::empty(), 1)
                .map_err(|cause| Error::Fault(format!("cannot wake: {cause}")))?;
        }
        Ok(())
    }

    fn receive(&mut self) -> Result<Arrival> {
        self.await_next()?;
        let number = u64::from(self.received);
        self.received += 1;
        let words = &self.read.words[..self.words];
        let sum = words.iter().fold(0_u64, |sum, word| sum.wrapping_add(word.load(Relaxed)));
        let stamp = Stamp::from_nanoseconds(self.read.stamp.load(Relaxed));
        Ok(Arrival { number, stamp, intact: sum == number.wrapping_mul(self.words as u64) })
    }
}
