//! Waking and being woken: every process has one channel, and every publisher knows its readers'.

mod patience;

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::rc::Rc;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::{CallbackProgression, SignalHandlingMode, WaitSet, WaitSetBuilder, ipc};
use interfaces::Stamp;
use serde::Deserialize;

use crate::session::open_wake_service;
use crate::{Error, Result, Session, clock};
use patience::Patience;

/// Shorter than this a time-out of the transport is none: it counts whole milliseconds.
const TIMEOUT_MIN: Duration = Duration::from_millis(1);

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

type Notifier = iceoryx2::port::notifier::Notifier<ipc::Service>;

/// The notifiers of every reader that this process wakes, by name; one for all its publishers.
#[derive(Debug)]
pub(crate) struct Wakers {
    node: iceoryx2::node::Node<ipc::Service>,
    notifiers: RefCell<BTreeMap<String, Rc<Notifier>>>,
}

/// What wakes one reader.
#[derive(Debug)]
pub(crate) struct Waker {
    owner: String,
    notifier: Option<Rc<Notifier>>,
}

impl Wakers {
    pub(crate) fn new(node: iceoryx2::node::Node<ipc::Service>) -> Self {
        Self { node, notifiers: RefCell::default() }
    }

    pub(crate) const fn node(&self) -> &iceoryx2::node::Node<ipc::Service> {
        &self.node
    }

    /// Wakes the reader. An event is a hint: one that cannot be given is no failure, since every wait
    /// ends by itself.
    pub(crate) fn wake(&self, reader: &mut Waker) {
        if reader.notifier.is_none() {
            match self.notifier(&reader.owner) {
                Ok(notifier) => reader.notifier = Some(notifier),
                Err(cause) => tracing::debug!(%cause, "a reader will wake late"),
            }
        }
        if let Some(notifier) = &reader.notifier
            && let Err(cause) = notifier.notify()
        {
            tracing::debug!(?cause, owner = reader.owner, "a reader will wake late");
        }
    }

    fn notifier(&self, owner: &str) -> Result<Rc<Notifier>> {
        if let Some(notifier) = self.notifiers.borrow().get(owner) {
            return Ok(Rc::clone(notifier));
        }
        let notifier = open_wake_service(&self.node, owner)?
            .notifier_builder()
            .create()
            .map_err(|cause| Error::shared_memory(format!("wake '{owner}'"), cause))?;
        let notifier = Rc::new(notifier);
        self.notifiers.borrow_mut().insert(owner.to_owned(), Rc::clone(&notifier));
        Ok(notifier)
    }
}

impl Waker {
    /// Of the reader called `owner`.
    pub(crate) const fn new(owner: String) -> Self {
        Self { owner, notifier: None }
    }
}

/// One process's way to wait.
#[derive(Debug)]
pub struct Waiter<'a> {
    mode: Wait,
    listener: &'a Listener<ipc::Service>,
    waitset: &'a WaitSet<ipc::Service>,
    patience: Cell<Patience>,
}

impl Waiter<'_> {
    /// Waits until somebody wakes this process, a signal arrives, or it is `until`. Where the process
    /// looks for itself instead of being woken, `has_come` tells whether there is something.
    pub fn wait(&self, until: Stamp, has_come: impl Fn() -> Result<bool>) -> Result {
        match self.mode {
            Wait::Block => self.block(until),
            Wait::Yield => look(until, has_come, rustix::thread::sched_yield).map(drop),
            Wait::Poll => look(until, has_come, std::hint::spin_loop).map(drop),
            Wait::Hybrid => {
                let patience = self.patience.get();
                let enough = until.min(clock::now().after(patience.length()));
                let found = look(enough, &has_come, std::hint::spin_loop)?;
                self.patience.set(patience.after(found));
                if found || until <= clock::now() {
                    return Ok(());
                }
                // What was sent before this is seen by the last look, what is sent after it wakes.
                self.drain()?;
                if has_come()? { Ok(()) } else { self.block(until) }
            }
        }
    }

    /// Sleeps until somebody wakes this process, a signal arrives, or it is `until`.
    pub(crate) fn block(&self, until: Stamp) -> Result {
        let timeout = until.since(clock::now());
        if timeout < TIMEOUT_MIN {
            clock::nap(timeout);
            return Ok(());
        }
        // Whole milliseconds, rounded down: the rest is napped away just before the moment comes.
        let timeout = Duration::from_millis(u64::try_from(timeout.as_millis()).unwrap_or(0));
        // An interrupt is a short wait: the caller looks at the stop flag.
        self.waitset
            .wait_and_process_once_with_timeout(|_| CallbackProgression::Continue, timeout)
            .map_err(|cause| Error::shared_memory("wait", cause))?;
        self.drain()
    }

    /// Down to zero, and on time-outs too: iceoryx2 0.10.0 can otherwise lose a wake-up for good.
    fn drain(&self) -> Result {
        let pending = || {
            self.listener
                .try_wait(|_| {})
                .map_err(|cause| Error::shared_memory("drain the wake-up channel", cause))
        };
        while 0 < pending()? {}
        Ok(())
    }
}

impl Session {
    /// Calls `body` with the one way of this process to wait for whatever its readers are sent.
    pub fn with_waiter<T>(
        &self,
        mode: Wait,
        body: impl FnOnce(&Waiter<'_>) -> Result<T>,
    ) -> Result<T> {
        let failed = |cause: String| Error::shared_memory("open the wake-up channel", cause);
        let listener = self
            .wake_service(self.name())?
            .listener_builder()
            .create()
            .map_err(|cause| failed(format!("{cause:?}")))?;
        let waitset = WaitSetBuilder::new()
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|cause| failed(format!("{cause:?}")))?;
        // Attached once: attaching anew for each wait would cost ten system calls a message.
        let _attached =
            waitset.attach_notification(&listener).map_err(|cause| failed(format!("{cause:?}")))?;
        let patience = Cell::default();
        body(&Waiter { mode, listener: &listener, waitset: &waitset, patience })
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
