//! Waking and being woken: every process has one channel, and every publisher knows its readers'.

mod bell;
mod files;
mod patience;

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::BTreeMap;
use std::os::fd::AsFd;
use std::rc::Rc;

use iceoryx2::prelude::ipc;
use interfaces::Stamp;
use serde::Deserialize;

use crate::{Namespace, Result, Session, clock};
use bell::Bell;
use files::Files;
use patience::Patience;

/// How a process waits for the next sample: the choice between latency and a core.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Wait {
    /// Sleeps until somebody wakes it.
    Block,
    /// Looks for as long as that has paid off lately, then sleeps: for a process that has a core to
    /// itself while others think.
    Hybrid,
    /// Looks again and again, giving its core away in between: for a chain of processes in step.
    Yield,
    /// Looks again and again: only for a process that has a core to itself.
    Poll,
}

impl Wait {
    /// Every way, the most patient first.
    pub const ALL: [Self; 4] = [Self::Block, Self::Hybrid, Self::Yield, Self::Poll];

    /// Its name.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Block => "block",
            Self::Hybrid => "hybrid",
            Self::Yield => "yield",
            Self::Poll => "poll",
        }
    }
}

/// The bells of every reader that this process wakes, by name; one for all its publishers.
#[derive(Debug)]
pub(crate) struct Wakers {
    node: iceoryx2::node::Node<ipc::Service>,
    prefix: String,
    bells: RefCell<BTreeMap<String, Rc<Bell>>>,
}

/// What wakes one reader.
#[derive(Debug)]
pub(crate) struct Waker {
    owner: String,
    bell: Option<Rc<Bell>>,
}

impl Wakers {
    pub(crate) fn new(node: iceoryx2::node::Node<ipc::Service>, namespace: &Namespace) -> Self {
        Self { node, prefix: namespace.prefix().to_owned(), bells: RefCell::default() }
    }

    pub(crate) fn prefix(&self) -> &str {
        &self.prefix
    }

    pub(crate) const fn node(&self) -> &iceoryx2::node::Node<ipc::Service> {
        &self.node
    }

    /// Wakes the reader. An event is a hint: one that cannot be given is no failure, since every wait
    /// ends by itself.
    pub(crate) fn wake(&self, reader: &mut Waker) {
        if reader.bell.is_none() {
            match self.bell(&reader.owner) {
                Ok(bell) => reader.bell = Some(bell),
                Err(cause) => tracing::debug!(%cause, "a reader will wake late"),
            }
        }
        if let Some(bell) = &reader.bell
            && let Err(cause) = bell.ring()
        {
            tracing::debug!(%cause, owner = reader.owner, "a reader will wake late");
        }
    }

    fn bell(&self, owner: &str) -> Result<Rc<Bell>> {
        if let Some(bell) = self.bells.borrow().get(owner) {
            return Ok(Rc::clone(bell));
        }
        let bell = Rc::new(Bell::open(&self.prefix, owner)?);
        self.bells.borrow_mut().insert(owner.to_owned(), Rc::clone(&bell));
        Ok(bell)
    }
}

impl Waker {
    /// Of the reader called `owner`.
    pub(crate) const fn new(owner: String) -> Self {
        Self { owner, bell: None }
    }
}

/// One process's way to wait.
#[derive(Debug)]
pub struct Waiter<'a> {
    mode: Wait,
    bell: &'a Bell,
    /// [-] Rings that this process has risen for.
    seen: Cell<u32>,
    patience: Cell<Patience>,
    session: &'a Session,
    files: OnceCell<Files>,
}

impl Waiter<'_> {
    /// Waits until somebody wakes this process, a signal arrives, or it is `until`. Where the process
    /// looks for itself instead of being woken, `has_come` tells whether there is something.
    pub fn wait(&self, until: Stamp, has_come: impl Fn() -> Result<bool>) -> Result {
        let has_come = || Ok(self.files.get().is_some_and(Files::have_come) || has_come()?);
        match self.mode {
            Wait::Block => self.block(until),
            Wait::Yield => look(until, has_come, rustix::thread::sched_yield).map(drop),
            Wait::Poll => look(until, has_come, std::hint::spin_loop).map(drop),
            Wait::Hybrid => {
                let patience = self.patience.get();
                let enough = until.min(clock::now().after(patience.length()));
                let found = look(enough, has_come, std::hint::spin_loop)?;
                self.patience.set(patience.after(found));
                if found || until <= clock::now() {
                    return Ok(());
                }
                // What was sent before this is seen by the last look, what is sent after it wakes.
                self.rise();
                if has_come()? { Ok(()) } else { self.block(until) }
            }
        }
    }

    /// From now on the process wakes whenever more can be read from `file`, until that is closed.
    /// Like every event, that is a hint: what was there before is told once, if at all.
    pub(crate) fn watch(&self, file: impl AsFd) -> std::io::Result<()> {
        if self.files.get().is_none() {
            let _ = self.files.set(Files::new(self.session)?);
        }
        self.files.get().map_or(Ok(()), |files| files.add(file))
    }

    /// Sleeps until somebody wakes this process, a signal arrives, or it is `until`. Whoever was woken
    /// since the last wait, and has not looked at what came since, does not sleep.
    pub(crate) fn block(&self, until: Stamp) -> Result {
        let timeout = until.since(clock::now());
        if self.bell.rings() == self.seen.get() && !timeout.is_zero() {
            // An interrupt is a short wait: the caller looks at the stop flag.
            self.bell.sleep(self.seen.get(), timeout)?;
        }
        self.rise();
        Ok(())
    }

    /// What was rung for until now is looked at next.
    fn rise(&self) {
        self.seen.set(self.bell.rings());
    }
}

impl Session {
    /// Calls `body` with the one way of this process to wait for whatever its readers are sent.
    pub fn with_waiter<T>(
        &self,
        mode: Wait,
        body: impl FnOnce(&Waiter<'_>) -> Result<T>,
    ) -> Result<T> {
        let bell = &Bell::open(self.prefix(), self.name())?;
        // What has come before is looked at first.
        let seen = Cell::new(bell.rings().wrapping_sub(1));
        body(&Waiter {
            mode,
            bell,
            seen,
            patience: Cell::default(),
            session: self,
            files: OnceCell::new(),
        })
    }
}

/// Looks until something `has_come`, or it is `until`; says which.
fn look(until: Stamp, has_come: impl Fn() -> Result<bool>, pause: impl Fn()) -> Result<bool> {
    loop {
        if has_come()? {
            return Ok(true);
        }
        if until <= clock::now() {
            return Ok(false);
        }
        pause();
    }
}
