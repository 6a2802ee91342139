//! SIGINT and SIGTERM: asked to stop.

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Once, OnceLock};

use rustix::event::{EventfdFlags, eventfd};

static REQUESTS: AtomicU32 = AtomicU32::new(0);
static INSTALLED: Once = Once::new();
static WAKE: OnceLock<OwnedFd> = OnceLock::new();

/// From now on SIGINT, SIGTERM and SIGHUP only count; see [`stop_requests`].
pub fn listen() {
    INSTALLED.call_once(|| {
        let installed = ctrlc::set_handler(|| {
            REQUESTS.fetch_add(1, Ordering::Relaxed);
            if let Some(wake) = wake() {
                // Full means that nobody has looked since the last one, and will be woken anyway.
                let _ = rustix::io::write(wake, &1_u64.to_ne_bytes());
            }
        });
        if let Err(cause) = installed {
            tracing::warn!(%cause, "signals will end this process at once");
        }
    });
}

/// [-] How often this process was asked to stop.
pub fn stop_requests() -> u32 {
    REQUESTS.load(Ordering::Relaxed)
}

/// Readable once a signal has come, until [`sleep_again`]; for one who waits for more than that.
pub fn wake() -> Option<&'static OwnedFd> {
    if WAKE.get().is_none() {
        let flags = EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK;
        drop(eventfd(0, flags).map(|fd| WAKE.set(fd)));
    }
    WAKE.get()
}

/// Whoever was woken looks at [`stop_requests`] next.
pub fn sleep_again() {
    if let Some(wake) = wake() {
        let _ = rustix::io::read(wake, &mut [0; 8]);
    }
}
