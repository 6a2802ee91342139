//! SIGINT and SIGTERM: asked to stop.

use std::sync::Once;
use std::sync::atomic::{AtomicU32, Ordering};

static REQUESTS: AtomicU32 = AtomicU32::new(0);
static INSTALLED: Once = Once::new();

/// From now on SIGINT, SIGTERM and SIGHUP only count; see [`stop_requests`].
pub fn listen() {
    INSTALLED.call_once(|| {
        let installed = ctrlc::set_handler(|| {
            REQUESTS.fetch_add(1, Ordering::Relaxed);
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
