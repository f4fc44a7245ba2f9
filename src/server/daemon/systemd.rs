//! Notifications to the service manager that started the daemon: ready, stopping, alive. Without a service manager
//! nothing is sent.

use std::io;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread;

use sd_notify::{NotifyState, notify, watchdog_enabled};

/// Holds the thread that sends signs of life; dropping it ends them.
#[derive(Debug)]
pub(super) struct WatchdogPing(#[allow(dead_code)] SyncSender<()>);

/// Reports that the daemon answers requests. `status` is shown as the service's status.
pub(super) fn ready(status: &str) {
    send(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// Reports that the daemon is shutting down.
pub(super) fn stopping() {
    send(&[NotifyState::Stopping, NotifyState::Status("ending")]);
}

/// Starts a thread that sends signs of life, twice in the manager's watchdog interval and only while `healthy` returns
/// `Ok`. `None` where the manager expects none.
pub(super) fn keep_alive(
    healthy: impl Fn() -> Result<(), String> + Send + 'static,
) -> io::Result<Option<WatchdogPing>> {
    let Some(interval) = watchdog_enabled().filter(|interval| !interval.is_zero()) else { return Ok(None) };
    let (held, dropped) = sync_channel(0);
    let ping = move || {
        let mut before = Ok(());
        loop {
            let now = healthy();
            if now.is_ok() {
                send(&[NotifyState::Watchdog]);
            }
            if now != before {
                // a line feed would begin another message
                let status = now.as_ref().err().map_or("healthy again", String::as_str).replace(char::is_control, " ");
                tracing::warn!("state reported to the service manager: {status}");
                send(&[NotifyState::Status(&status)]);
            }
            before = now;
            if dropped.recv_timeout(interval / 2) != Err(RecvTimeoutError::Timeout) {
                return;
            }
        }
    };
    thread::Builder::new().name("alive".into()).spawn(ping)?;
    Ok(Some(WatchdogPing(held)))
}

/// Sends a message. A failure is only logged: a service manager that does not listen must not stop the daemon.
fn send(message: &[NotifyState<'_>]) {
    if let Err(error) = notify(message) {
        tracing::warn!(%error, "could not notify the service manager");
    }
}
