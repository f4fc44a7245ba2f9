//! Notifications to the service manager that started the daemon: ready, stopping, alive. Without a service manager
//! nothing is sent.

use sd_notify::{NotifyState, notify, watchdog_enabled};

/// Reports that the daemon answers requests. `status` is shown as the service's status.
pub(super) fn ready(status: &str) {
    send(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// Reports that the daemon is shutting down.
pub(super) fn stopping() {
    send(&[NotifyState::Stopping, NotifyState::Status("ending")]);
}

/// Sends signs of life where the manager expects them, and says when their absence has a reason.
#[derive(Debug)]
pub(super) struct WatchdogPing(Result<(), String>);

impl WatchdogPing {
    /// `None` where the manager expects no signs of life.
    pub fn new() -> Option<Self> {
        watchdog_enabled().map(|_| Self(Ok(())))
    }

    /// Sends one, unless the daemon is not healthy.
    pub fn send(&mut self, health: Result<(), String>) {
        if health.is_ok() {
            send(&[NotifyState::Watchdog]);
        }
        if health != self.0 {
            // a line feed would begin another message
            let status = health.as_ref().err().map_or("healthy again", String::as_str).replace(char::is_control, " ");
            tracing::warn!("state reported to the service manager: {status}");
            send(&[NotifyState::Status(&status)]);
        }
        self.0 = health;
    }
}

/// Sends a message. A failure is only logged: a service manager that does not listen must not stop the daemon.
fn send(message: &[NotifyState<'_>]) {
    if let Err(error) = notify(message) {
        tracing::warn!(%error, "could not notify the service manager");
    }
}
