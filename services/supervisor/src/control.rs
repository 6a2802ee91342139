//! The control socket: requests of people and programs, one JSON object a line each way.

mod request;

use std::collections::VecDeque;
use std::fs::{self, Permissions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::time::Duration;

use interfaces::Stamp;
use node::Error;
use node::control::Request;
use rustix::event::{PollFd, PollFlags, Timespec};
use serde_json::{Value, json};

use request::RequestLine;

/// [-] More people and programs than ever look at one robot at once.
const CLIENTS_MAX: usize = 16;

/// [-] Connections taken in one turn: whoever connects without end holds nobody up.
const ACCEPTED_MAX: usize = 2 * CLIENTS_MAX;

/// A request is written at once; whoever takes longer holds a place that another may want.
const REQUEST_PATIENCE: Duration = Duration::from_secs(1);

/// [byte] So much may wait for one who has stopped reading, as a pager does.
const WAITING_MAX: usize = 256 * 1024;

/// More than [`WAITING_MAX`] may wait only for one who reads: the history is longer than that.
const STALL_PATIENCE: Duration = Duration::from_secs(1);

/// [byte] Whoever reads or not, the supervisor's memory has an end.
const QUEUE_MAX: usize = 4 * 1024 * 1024;

/// One who has been told all has so long to read on before its place is given to another.
const LEAVING_PATIENCE: Duration = Duration::from_secs(5);

/// [byte] As much as is worth a call to the system before the next turn.
const PIECE: usize = 64 * 1024;

/// One who is connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ClientId(u64);

/// The socket and who is connected to it.
#[derive(Debug)]
pub(crate) struct Control {
    listener: UnixListener,
    /// Nobody can be let in at present: being told so again at once would help nobody.
    is_shut: bool,
    clients: Vec<Client>,
    last_id: u64,
    ignored: u64,
    /// Of the newest turn.
    now: Stamp,
}

impl Control {
    /// Listens at `path`.
    pub(crate) fn bind(path: &Path) -> node::Result<Self> {
        let failed = |cause| Error::File { path: path.to_owned(), cause };
        match fs::remove_file(path) {
            Ok(()) => tracing::debug!("removed a former run's control socket"),
            Err(cause) if cause.kind() == ErrorKind::NotFound => {}
            Err(cause) => return Err(failed(cause)),
        }
        let listener = UnixListener::bind(path).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        // Nobody else can have come in between: the directory is the user's alone.
        fs::set_permissions(path, Permissions::from_mode(0o600)).map_err(failed)?;
        Ok(Self {
            listener,
            is_shut: false,
            clients: Vec::new(),
            last_id: 0,
            ignored: 0,
            now: Stamp::ZERO,
        })
    }

    /// Accepts, reads and writes, without waiting for anybody; returns what is asked for.
    pub(crate) fn turn(&mut self, now: Stamp) -> Vec<(ClientId, Request)> {
        self.now = now;
        self.accept();
        let requests = self.read();
        // After reading: one may ask for something and not wait for the answer.
        self.forget_the_gone();
        self.clients.retain_mut(|client| client.flush(now));
        self.dismiss_the_slow();
        requests
    }

    /// Whether the client is still there.
    pub(crate) fn has(&self, client: ClientId) -> bool {
        self.clients.iter().any(|present| present.id == client)
    }

    /// What becomes ready when there is something to do in [`Control::turn`].
    pub(crate) fn fds(&self) -> Vec<PollFd<'_>> {
        let mut fds = Vec::new();
        if !self.is_shut {
            fds.push(PollFd::new(&self.listener, PollFlags::IN));
        }
        fds.extend(self.clients.iter().map(Client::fd));
        fds
    }

    /// When [`Control::turn`] has something to do at the latest: somebody is too slow.
    pub(crate) fn next_deadline(&self) -> Option<Stamp> {
        self.clients.iter().filter_map(Client::deadline).min()
    }

    /// [-] What came and was no request.
    pub(crate) const fn ignored(&self) -> u64 {
        self.ignored
    }

    /// One line for the client.
    pub(crate) fn reply(&mut self, client: ClientId, line: &Value) {
        let now = self.now;
        self.clients.retain_mut(|present| {
            if present.id == client {
                present.queue(line, now);
            }
            // What is less is written in the next turn, many lines at once.
            present.id != client || present.queued.len() < PIECE || present.flush(now)
        });
    }

    /// There will be no more lines for the client: it is let go when it has read them.
    pub(crate) fn close(&mut self, client: ClientId) {
        let now = self.now;
        self.clients.retain_mut(|present| {
            if present.id == client {
                present.leave(now);
            }
            present.id != client || present.flush(now)
        });
    }

    fn accept(&mut self) {
        self.is_shut = false;
        for _ in 0..ACCEPTED_MAX {
            match self.listener.accept() {
                Ok((stream, _)) => self.admit(stream),
                Err(cause) if cause.kind() == ErrorKind::WouldBlock => return,
                // The one who came has gone again.
                Err(cause) if cause.kind() == ErrorKind::ConnectionAborted => {}
                Err(cause) => {
                    tracing::debug!(%cause, "nobody can be let in to the control socket");
                    self.is_shut = true;
                    return;
                }
            }
        }
    }

    fn admit(&mut self, mut stream: UnixStream) {
        if stream.set_nonblocking(true).is_err() || !is_trusted(&stream) {
            self.ignored += 1;
        } else if self.clients.len() == CLIENTS_MAX {
            let full = json!({ "error": format!("{CLIENTS_MAX} are connected; try again") });
            drop(writeln!(stream, "{full}"));
        } else {
            self.last_id += 1;
            self.clients.push(Client {
                id: ClientId(self.last_id),
                stream,
                phase: Phase::Asking(RequestLine::default()),
                queued: VecDeque::new(),
                moved: self.now,
            });
        }
    }

    fn read(&mut self) -> Vec<(ClientId, Request)> {
        let mut requests = Vec::new();
        for client in &mut self.clients {
            match client.read() {
                Some(Ok(request)) => {
                    client.phase = Phase::Served;
                    requests.push((client.id, request));
                }
                Some(Err(why)) => {
                    self.ignored += 1;
                    client.refuse(&why, self.now);
                }
                None => {}
            }
        }
        requests
    }

    /// One who only closes its writing half still reads; one who is gone altogether does not.
    fn forget_the_gone(&mut self) {
        if self.clients.is_empty() {
            return;
        }
        let fd = |client| PollFd::new(client, PollFlags::empty());
        let mut fds: Vec<_> = self.clients.iter().map(|client| fd(&client.stream)).collect();
        // Where it fails nobody is known to be gone; writing to them will tell.
        let _ = rustix::event::poll(&mut fds, Some(&Timespec::default()));
        let ends = PollFlags::HUP | PollFlags::ERR;
        let are_gone: Vec<_> = fds.iter().map(|fd| fd.revents().intersects(ends)).collect();
        let mut are_gone = are_gone.into_iter();
        self.clients.retain(|_| are_gone.next() != Some(true));
    }

    fn dismiss_the_slow(&mut self) {
        let now = self.now;
        let mut slow = 0;
        self.clients.retain_mut(|client| {
            let is_late = client.deadline().is_some_and(|deadline| deadline <= now);
            if is_late && matches!(client.phase, Phase::Asking(_)) {
                slow += 1;
                client.refuse(&format!("no request came within {REQUEST_PATIENCE:?}"), now);
                return client.flush(now);
            }
            !is_late
        });
        self.ignored += slow;
    }
}

/// Whether it is the robot's own user who has connected, or root, by the kernel's word.
fn is_trusted(stream: &UnixStream) -> bool {
    let own = rustix::process::geteuid();
    rustix::net::sockopt::socket_peercred(stream)
        .is_ok_and(|peer| peer.uid == own || peer.uid.is_root())
}

/// One connection.
#[derive(Debug)]
struct Client {
    id: ClientId,
    stream: UnixStream,
    phase: Phase,
    /// What it has not read yet, beside what the kernel holds for it.
    queued: VecDeque<u8>,
    /// When it came, last read something, or began to leave.
    moved: Stamp,
}

#[derive(Debug)]
enum Phase {
    /// Its request has not come, or not all of it.
    Asking(RequestLine),
    /// It waits for answers. Whatever else it sends is never read.
    Served,
    /// It is let go when it has read what is queued.
    Leaving,
}

impl Client {
    /// Its request, if all of it has come just now, or what is wrong with it.
    fn read(&mut self) -> Option<Result<Request, String>> {
        let Phase::Asking(line) = &mut self.phase else { return None };
        let mut bytes = [0; 4096];
        loop {
            match self.stream.read(&mut bytes) {
                Ok(0) if line.is_empty() => {
                    self.phase = Phase::Leaving;
                    return None;
                }
                Ok(0) => return Some(Err("the request ends before its line does".to_owned())),
                Ok(count) => {
                    let outcome = line.push(&bytes[..count]);
                    if outcome.is_some() {
                        return outcome;
                    }
                }
                Err(cause) if cause.kind() == ErrorKind::WouldBlock => return None,
                Err(cause) if cause.kind() == ErrorKind::Interrupted => {}
                Err(cause) => return Some(Err(format!("the request was lost: {cause}"))),
            }
        }
    }

    fn queue(&mut self, line: &Value, now: Stamp) {
        if !matches!(self.phase, Phase::Served) {
            return;
        }
        let line = format!("{line}\n");
        if QUEUE_MAX < self.queued.len() + line.len() {
            self.refuse("there is too much to tell at once; ask for less", now);
        } else {
            self.queued.extend(line.as_bytes());
        }
    }

    /// The last that it is told.
    fn refuse(&mut self, why: &str, now: Stamp) {
        self.queued.extend(format!("{}\n", json!({ "error": why })).as_bytes());
        self.leave(now);
    }

    fn leave(&mut self, now: Stamp) {
        if !matches!(self.phase, Phase::Leaving) {
            self.phase = Phase::Leaving;
            self.moved = now;
        }
    }

    /// Writes what is queued, as far as there is room; false where the client is done with.
    fn flush(&mut self, now: Stamp) -> bool {
        while !self.queued.is_empty() {
            match self.stream.write(self.queued.as_slices().0) {
                Ok(count) => {
                    self.queued.drain(..count);
                    self.moved = now;
                }
                Err(cause) if cause.kind() == ErrorKind::WouldBlock => return true,
                Err(cause) if cause.kind() == ErrorKind::Interrupted => {}
                Err(_) => return false,
            }
        }
        // A burst's memory is not kept for one who follows for days.
        self.queued.shrink_to(PIECE);
        !matches!(self.phase, Phase::Leaving)
    }

    /// Until when it has to move, lest it be dropped.
    fn deadline(&self) -> Option<Stamp> {
        match self.phase {
            Phase::Asking(_) => Some(self.moved.after(REQUEST_PATIENCE)),
            Phase::Served if WAITING_MAX < self.queued.len() => {
                Some(self.moved.after(STALL_PATIENCE))
            }
            Phase::Served => None,
            Phase::Leaving => Some(self.moved.after(LEAVING_PATIENCE)),
        }
    }

    /// That it is gone is told whatever else is asked for.
    fn fd(&self) -> PollFd<'_> {
        let mut flags = PollFlags::empty();
        flags.set(PollFlags::IN, matches!(self.phase, Phase::Asking(_)));
        flags.set(PollFlags::OUT, !self.queued.is_empty());
        PollFd::new(&self.stream, flags)
    }
}

#[cfg(test)]
mod tests;
