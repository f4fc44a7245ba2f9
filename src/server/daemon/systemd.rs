//! Notifications to the service manager that started the daemon: ready, stopping, alive. Without a service manager
//! nothing is sent.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::{io, thread};

use sd_notify::{NotifyState, notify, watchdog_enabled};

use crate::api::{DaemonState, liveness_failures};
use crate::http::joined;

/// Reports that the daemon answers requests. `status` is shown as the service's status.
pub(super) fn ready(status: &str) {
    send(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// Reports that the daemon is shutting down.
pub(super) fn stopping() {
    send(&[NotifyState::Stopping, NotifyState::Status("ending")]);
}

/// Starts a thread that sends signs of life, twice in the manager's watchdog interval and only while the daemon is
/// healthy, and says when their absence has a reason. None where the manager expects none. A manager that does not read
/// holds this thread alone.
pub(super) fn keep_alive(state: &Arc<DaemonState>) -> io::Result<()> {
    let Some(interval) = watchdog_enabled().filter(|interval| !interval.is_zero()) else { return Ok(()) };
    let state = Arc::clone(state);
    let ping = move || {
        let mut before = Vec::new();
        while !state.ending.load(Ordering::SeqCst) {
            let failures = liveness_failures(&state.observed());
            if failures.is_empty() {
                send(&[NotifyState::Watchdog]);
            }
            if failures != before {
                let status = if failures.is_empty() { "healthy again".to_owned() } else { joined(&failures) };
                tracing::warn!("state reported to the service manager: {status}");
                // a line feed would begin another message
                send(&[NotifyState::Status(&status.replace(char::is_control, " "))]);
            }
            before = failures;
            thread::sleep(interval / 2);
        }
    };
    thread::Builder::new().name("alive".into()).spawn(ping).map(|_| ())
}

/// Sends a message. A failure is only logged: a service manager that does not listen must not stop the daemon.
fn send(message: &[NotifyState<'_>]) {
    if let Err(error) = notify(message) {
        tracing::warn!(%error, "could not notify the service manager");
    }
}
