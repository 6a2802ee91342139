//! Publishers and subscribers that stamp, count and refuse.

use std::cell::{Cell, RefCell};
use std::fmt;
use std::ops::Deref;
use std::rc::Rc;
use std::sync::Arc;

use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{CallbackProgression, PortFactory as _, ipc};
use interfaces::{Loss, Message, PortStatus, Stamp, Text};

use crate::arrivals::{Arrival, Arrivals};
use crate::digest::Digest;
use crate::faults::{FaultCounts, FaultyLink};
use crate::session::{Service, is_woken, owner_of};
use crate::wake::{Waker, Wakers};
use crate::{Error, Result, clock, trace};

/// What a node asks of its own ports.
pub(crate) trait Port {
    /// Its counters.
    fn status(&self) -> PortStatus;

    /// Drops what is queued, unless it is latched, and counts it as unread, or what is under way, as
    /// lost.
    fn drain(&self) -> Result<()>;

    /// Whether a topic that it publishes has carried something.
    fn has_flowed(&self) -> bool;

    /// Whether something is queued that the node is to be woken for.
    fn has_samples(&self) -> Result<bool> {
        Ok(false)
    }

    /// Sends what is due by now; only a port with faults has anything to send late.
    fn flush(&self, _now: Stamp) -> Result<()> {
        Ok(())
    }

    /// When something will be due.
    fn due(&self) -> Option<Stamp> {
        None
    }

    /// What went wrong on purpose.
    fn faults(&self) -> FaultCounts {
        FaultCounts::default()
    }
}

/// The one publisher of a topic.
pub struct Publisher<T: Message> {
    state: Rc<Sent<T>>,
}

/// A publisher's port, and what it has sent so far.
struct Sent<T: Message> {
    topic: String,
    /// The next sample, zeroed: made ready while the readers are at work on the last one.
    ready: Cell<Option<Loan<T>>>,
    port: iceoryx2::port::publisher::Publisher<ipc::Service, T, ()>,
    service: Arc<Service<T>>,
    wakers: Rc<Wakers>,
    readers: RefCell<Readers>,
    epoch: u32,
    samples: Cell<u64>,
    digest: Option<RefCell<Digest>>,
    faults: Option<RefCell<FaultyLink<T>>>,
}

/// A sample that nobody has yet.
type Loan<T> = iceoryx2::sample_mut::SampleMut<ipc::Service, T, ()>;

/// The readers of a topic.
#[derive(Default)]
struct Readers {
    count: usize,
    wakers: Vec<Waker>,
}

impl<T: Message> Publisher<T> {
    pub(crate) fn new(
        topic: String,
        epoch: u32,
        service: Arc<Service<T>>,
        port: iceoryx2::port::publisher::Publisher<ipc::Service, T, ()>,
        wakers: Rc<Wakers>,
        digests: bool,
    ) -> Self {
        let state = Sent {
            topic,
            ready: Cell::default(),
            port,
            service,
            wakers,
            readers: RefCell::default(),
            epoch,
            samples: Cell::new(0),
            digest: digests.then(RefCell::default),
            faults: None,
        };
        Self { state: Rc::new(state) }
    }

    /// From now on samples fare as `link` has it.
    pub(crate) fn with_faults(mut self, link: FaultyLink<T>) -> Self {
        let state = Rc::get_mut(&mut self.state);
        let state = state.unwrap_or_else(|| unreachable!("nobody else has it before it is used"));
        state.faults = Some(RefCell::new(link));
        self
    }

    /// Sends one sample, written by `fill` where it lies in shared memory. `fill` sees a zeroed
    /// sample and sets its stamp; sequence number and epoch are the port's.
    pub fn send_with(&mut self, fill: impl FnOnce(&mut T)) -> Result<()> {
        let state = &self.state;
        match &state.faults {
            None => state.send_with(|sample| {
                fill(sample);
                state.sign(sample);
            })?,
            Some(link) => {
                let mut sample = T::default();
                fill(&mut sample);
                state.sign(&mut sample);
                let now = clock::now();
                link.borrow_mut().push(now, sample);
                state.flush(now)?;
            }
        }
        state.samples.set(state.samples.get() + 1);
        Ok(())
    }

    /// Sends one small sample.
    pub fn send(&mut self, message: T) -> Result<()> {
        self.send_with(|sample| *sample = message)
    }

    /// Hands the newest sample of a latched topic to whoever has come since the last one was sent:
    /// nobody else does.
    pub(crate) fn greet(&self) -> Result {
        let greeted = self.state.port.update_connections();
        greeted.map_err(|cause| self.state.failed("greet the readers of", cause))
    }

    /// How many readers there are.
    pub fn readers(&self) -> usize {
        self.state.count_readers()
    }

    pub(crate) fn port(&self) -> Rc<dyn Port> {
        Rc::clone(&self.state) as Rc<dyn Port>
    }
}

impl<T: Message> fmt::Debug for Publisher<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Publisher({})", self.state.topic)
    }
}

impl<T: Message> Sent<T> {
    /// A lost sample has used up its number too, so that its readers can miss it.
    fn sign(&self, sample: &mut T) {
        let header = sample.header_mut();
        header.sequence = self.samples.get();
        header.epoch = self.epoch;
    }

    fn send_with(&self, fill: impl FnOnce(&mut T)) -> Result<()> {
        let mut sample = match self.ready.take() {
            Some(sample) => sample,
            None => self.loan()?,
        };
        let message = sample.payload_mut();
        fill(message);
        trace::sent(&self.topic, message.header());
        if let Some(digest) = &self.digest {
            digest.borrow_mut().update(bytemuck::bytes_of(message));
        }
        sample.send().map_err(|cause| self.failed("send on", cause))?;
        self.wake_readers();
        self.ready.set(Some(self.loan()?));
        Ok(())
    }

    fn loan(&self) -> Result<Loan<T>> {
        self.port.loan().map_err(|cause| self.failed("take shared memory for", cause))
    }

    fn count_readers(&self) -> usize {
        self.service.dynamic_config().number_of_subscribers()
    }

    fn wake_readers(&self) {
        let mut readers = self.readers.borrow_mut();
        // A reader that restarts under its old name keeps its channel, so counting is enough.
        let count = self.count_readers();
        if count != readers.count {
            let mut names = Vec::new();
            self.service.dynamic_config().list_subscribers(|reader| {
                let name = reader.subscriber_name.to_string();
                if is_woken(&name) {
                    names.push(name);
                }
                CallbackProgression::Continue
            });
            names.sort();
            names.dedup();
            *readers = Readers { count, wakers: names.into_iter().map(Waker::new).collect() };
        }
        readers.wakers.iter_mut().for_each(|reader| self.wakers.wake(reader));
    }

    fn failed(&self, action: &str, cause: impl fmt::Debug) -> Error {
        Error::shared_memory(format!("{action} topic '{}'", self.topic), cause)
    }
}

impl<T: Message> Port for Sent<T> {
    fn status(&self) -> PortStatus {
        PortStatus {
            topic: Text::new(&self.topic),
            publishes: 1,
            samples: self.samples.get(),
            digest: self.digest.as_ref().map_or(0, |digest| digest.borrow().value()),
            ..PortStatus::default()
        }
    }

    fn drain(&self) -> Result<()> {
        if let Some(link) = &self.faults {
            link.borrow_mut().abandon();
        }
        Ok(())
    }

    fn has_flowed(&self) -> bool {
        0 < self.samples.get()
    }

    fn flush(&self, now: Stamp) -> Result<()> {
        let Some(link) = &self.faults else { return Ok(()) };
        let mut link = link.borrow_mut();
        while let Some(sample) = link.pop(now) {
            self.send_with(|loan| *loan = sample)?;
        }
        Ok(())
    }

    fn due(&self) -> Option<Stamp> {
        self.faults.as_ref().and_then(|link| link.borrow().due())
    }

    fn faults(&self) -> FaultCounts {
        self.faults.as_ref().map(|link| *link.borrow().counts()).unwrap_or_default()
    }
}

/// One reader of a topic.
pub struct Subscriber<T: Message> {
    state: Rc<Received<T>>,
}

/// A reader's port, and what came through it so far.
struct Received<T: Message> {
    topic: String,
    loss: Loss,
    port: iceoryx2::port::subscriber::Subscriber<ipc::Service, T, ()>,
    service: Service<T>,
    epoch: Cell<u32>,
    arrivals: Cell<Arrivals>,
    wakes: bool,
    samples: Cell<u64>,
    lost: Cell<u64>,
    unread: Cell<u64>,
    stale: Cell<u64>,
}

impl<T: Message> Subscriber<T> {
    pub(crate) fn new(
        topic: String,
        loss: Loss,
        service: Service<T>,
        port: iceoryx2::port::subscriber::Subscriber<ipc::Service, T, ()>,
        wakes: bool,
    ) -> Self {
        let state = Received {
            topic,
            loss,
            port,
            service,
            epoch: Cell::new(0),
            arrivals: Cell::default(),
            wakes,
            samples: Cell::new(0),
            lost: Cell::new(0),
            unread: Cell::new(0),
            stale: Cell::new(0),
        };
        Self { state: Rc::new(state) }
    }

    /// The oldest sample that is queued, borrowed where it lies in shared memory.
    pub fn receive(&mut self) -> Result<Option<Sample<T>>> {
        self.state.next(&self.state.samples)
    }

    /// The newest sample that is queued; the older ones are received too, and dropped.
    pub fn latest(&mut self) -> Result<Option<Sample<T>>> {
        let mut latest = None;
        while let Some(sample) = self.receive()? {
            latest = Some(sample);
        }
        Ok(latest)
    }

    /// Whether somebody publishes the topic. One who was killed counts until others clear it away.
    pub fn has_publisher(&self) -> bool {
        0 < self.state.service.dynamic_config().number_of_publishers()
    }

    /// Who publishes the topic, by name; see [`Subscriber::has_publisher`].
    pub fn publishers(&self) -> Vec<String> {
        let mut names = Vec::new();
        self.state.service.dynamic_config().list_publishers(|publisher| {
            names.push(publisher.publisher_name.to_string());
            CallbackProgression::Continue
        });
        names
    }

    /// Who reads the topic, by name and each once; those who only look on are left out.
    pub fn readers(&self) -> Vec<String> {
        let mut names = Vec::new();
        self.state.service.dynamic_config().list_subscribers(|reader| {
            names.extend(owner_of(&reader.subscriber_name.to_string()).map(str::to_owned));
            CallbackProgression::Continue
        });
        names.sort();
        names.dedup();
        names
    }

    /// [-] Samples that were sent and have not come: gaps in the sequence.
    pub fn lost(&self) -> u64 {
        self.state.lost.get()
    }

    /// Whether something is queued.
    pub fn has_samples(&self) -> Result<bool> {
        self.state.has_samples()
    }

    pub(crate) fn port(&self) -> Rc<dyn Port>
    where
        T: 'static,
    {
        Rc::clone(&self.state) as Rc<dyn Port>
    }
}

impl<T: Message> fmt::Debug for Subscriber<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Subscriber({})", self.state.topic)
    }
}

impl<T: Message> Received<T> {
    /// The next sample of the publisher's newest life, counted by `counter` unless it was before.
    fn next(&self, counter: &Cell<u64>) -> Result<Option<Sample<T>>> {
        loop {
            let received = self.port.receive().map_err(|cause| {
                Error::shared_memory(format!("receive from topic '{}'", self.topic), cause)
            })?;
            let Some(sample) = received else { return Ok(None) };
            let header = *sample.payload().header();
            trace::received(&self.topic, &header);
            if header.epoch < self.epoch.get() {
                self.stale.set(self.stale.get() + 1);
                continue;
            }
            if header.epoch == self.epoch.get() {
                self.count(header.sequence, counter);
            } else {
                self.epoch.set(header.epoch);
                self.arrivals.set(Arrivals::from(header.sequence));
                counter.set(counter.get() + 1);
            }
            return Ok(Some(Sample(sample)));
        }
    }

    /// Sent is what is received and what is lost, in whatever order and however often it comes.
    fn count(&self, sequence: u64, counter: &Cell<u64>) {
        let mut arrivals = self.arrivals.get();
        let lost = self.lost.get();
        match arrivals.note(sequence) {
            Arrival::Newest { missing } => self.lost.set(lost.saturating_add(missing)),
            Arrival::Late => self.lost.set(lost.saturating_sub(1)),
            Arrival::Again => return,
        }
        self.arrivals.set(arrivals);
        counter.set(counter.get() + 1);
    }
}

impl<T: Message> Port for Received<T> {
    fn status(&self) -> PortStatus {
        PortStatus {
            topic: Text::new(&self.topic),
            samples: self.samples.get(),
            lost: self.lost.get(),
            unread: self.unread.get(),
            stale: self.stale.get(),
            ..PortStatus::default()
        }
    }

    fn has_flowed(&self) -> bool {
        true
    }

    fn has_samples(&self) -> Result<bool> {
        let looked = if self.wakes { self.port.has_samples() } else { Ok(false) };
        looked
            .map_err(|cause| Error::shared_memory(format!("look at topic '{}'", self.topic), cause))
    }

    fn drain(&self) -> Result<()> {
        if self.loss == Loss::Latched {
            // How things stand is worth knowing however long ago they came to stand so.
            return Ok(());
        }
        while self.next(&self.unread)?.is_some() {}
        Ok(())
    }
}

/// A sample, borrowed from shared memory for as long as it is held.
pub struct Sample<T: Message>(iceoryx2::sample::Sample<ipc::Service, T, ()>);

impl<T: Message> Deref for Sample<T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.0.payload()
    }
}

impl<T: Message> fmt::Debug for Sample<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.payload().fmt(formatter)
    }
}
