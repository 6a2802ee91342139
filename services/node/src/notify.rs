//! What a process tells whoever started it: `sd_notify(3)`'s protocol, as systemd and `teseo up`
//! understand it.

use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::Path;
use std::time::Duration;

use crate::clock;

/// [-] Attempts to say what must not get lost; a listener that reads is done with its queue before.
const ATTEMPTS: u32 = 20;

/// Between two of them.
const PAUSE: Duration = Duration::from_millis(5);

/// [-] Of the watchdog's limit, so that one ping may come late.
const PINGS_PER_WATCHDOG: u32 = 3;

/// The way to whoever started this process; says nothing where nobody listens.
#[derive(Debug, Default)]
pub struct Notifier {
    socket: Option<UnixDatagram>,
}

impl Notifier {
    /// As `NOTIFY_SOCKET` says.
    pub fn from_environment() -> Self {
        let Ok(address) = std::env::var("NOTIFY_SOCKET") else { return Self::default() };
        match address.strip_prefix('@') {
            Some(name) => Self::connect(SocketAddr::from_abstract_name(name)),
            None => Self::to(Path::new(&address)),
        }
    }

    /// To the socket at `path`.
    pub fn to(path: &Path) -> Self {
        Self::connect(SocketAddr::from_pathname(path))
    }

    fn connect(address: std::io::Result<SocketAddr>) -> Self {
        let connect = || {
            let socket = UnixDatagram::unbound()?;
            socket.connect_addr(&address?)?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        };
        let connected: std::io::Result<_> = connect();
        match connected {
            Ok(socket) => Self { socket: Some(socket) },
            Err(cause) => {
                tracing::warn!(%cause, "nobody will hear how this process is");
                Self::default()
            }
        }
    }

    /// It does what it was started for.
    pub fn ready(&self) {
        self.insist("READY=1");
    }

    /// It is on its way to the end.
    pub fn stopping(&self) {
        self.insist("STOPPING=1");
    }

    /// In one line, what it is doing.
    pub fn status(&self, text: &str) {
        let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        self.say(&format!("STATUS={text}"));
    }

    /// Its loop turns.
    pub fn watchdog(&self) {
        self.say("WATCHDOG=1");
    }

    /// What it is doing now may take so much longer, from now.
    pub fn extend_timeout(&self, more: Duration) {
        self.insist(&format!("EXTEND_TIMEOUT_USEC={}", more.as_micros()));
    }

    /// That there is something new to see elsewhere, for one who sleeps; `name` is an `X_` of ours.
    pub(crate) fn hint(&self, name: &str, value: &str) {
        self.say(&format!("X_{name}={value}"));
    }

    /// Once; a listener whose queue is full must not hold anybody up.
    fn say(&self, what: &str) -> bool {
        self.socket.as_ref().is_none_or(|socket| socket.send(what.as_bytes()).is_ok())
    }

    fn insist(&self, what: &str) {
        for _ in 0..ATTEMPTS {
            if self.say(what) {
                return;
            }
            clock::nap(PAUSE);
        }
    }
}

/// How often whoever started this process wants to hear that its loop turns (`WATCHDOG_USEC`).
pub fn watchdog_period() -> Option<Duration> {
    let limit: u64 = std::env::var("WATCHDOG_USEC").ok()?.parse().ok()?;
    Some(Duration::from_micros(limit) / PINGS_PER_WATCHDOG)
}
