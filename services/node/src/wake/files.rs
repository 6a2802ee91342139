//! Files of a process's own that wake it too: a thread sleeps on them and rings its bell.

use std::io::{self, PipeWriter};
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use rustix::event::epoll;

use crate::Session;
use crate::wake::bell::Bell;

/// [-] What comes from the pipe by which the thread is told to end.
const END: u64 = u64::MAX;

/// The files, and the thread that sleeps on them: nobody can sleep on a word and on a file at once.
#[derive(Debug)]
pub(super) struct Files {
    epoll: Arc<OwnedFd>,
    have_come: Arc<AtomicBool>,
    /// Closed when this is dropped, which ends the thread.
    _alive: PipeWriter,
}

impl Files {
    pub(super) fn new(session: &Session) -> io::Result<Self> {
        let epoll = Arc::new(epoll::create(epoll::CreateFlags::CLOEXEC)?);
        let (end, alive) = io::pipe()?;
        epoll::add(&epoll, &end, epoll::EventData::new_u64(END), epoll::EventFlags::HUP)?;
        let have_come = Arc::new(AtomicBool::new(false));
        let bell = Bell::open(session.prefix(), session.name()).map_err(io::Error::other)?;
        let watch = {
            let (epoll, have_come) = (Arc::clone(&epoll), Arc::clone(&have_come));
            move || {
                let _end = end;
                while sleep_on(&epoll) {
                    have_come.store(true, Ordering::Release);
                    // A ring that fails costs a late wake-up, and no more.
                    let _ = bell.ring();
                }
            }
        };
        thread::Builder::new().name("files".to_owned()).spawn(watch)?;
        Ok(Self { epoll, have_come, _alive: alive })
    }

    pub(super) fn add(&self, file: impl AsFd) -> io::Result<()> {
        let flags = epoll::EventFlags::IN | epoll::EventFlags::ET;
        epoll::add(&self.epoll, file, epoll::EventData::new_u64(0), flags)?;
        Ok(())
    }

    /// Whether something has come since this was last asked.
    pub(super) fn have_come(&self) -> bool {
        self.have_come.swap(false, Ordering::Acquire)
    }
}

/// Sleeps until there is something to read; false where there is nobody left to tell.
fn sleep_on(epoll: &OwnedFd) -> bool {
    let nothing =
        epoll::Event { flags: epoll::EventFlags::empty(), data: epoll::EventData::new_u64(0) };
    let mut events = [nothing; 8];
    loop {
        match epoll::wait(epoll, &mut events, None) {
            Ok(count) => return events[..count].iter().all(|event| event.data.u64() != END),
            Err(rustix::io::Errno::INTR) => {}
            Err(_) => return false,
        }
    }
}
