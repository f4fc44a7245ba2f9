//! The signals of `upm serve` that do not end it: SIGUSR1 stops every plate, SIGHUP has the tokens
//! read again.

use std::thread;

use nix::sys::signal::{SigSet, Signal};

use upm_server::daemon::{EmergencyStops, TokenReload};

/// Keeps these signals from this thread and from those that it starts. Called before there is a second thread, so that
/// none of them ends the process; one that comes early waits for [`attend`].
pub(in crate::cli) fn hold_back() {
    if let Err(error) = signals().thread_block() {
        complain!("upm: SIGUSR1 will not stop the plates, SIGHUP ends the daemon: {error}");
    }
}

fn signals() -> SigSet {
    [Signal::SIGHUP, Signal::SIGUSR1].into_iter().collect()
}

/// Does what the signals ask for from now on, on a thread of its own.
pub(super) fn attend(stop: EmergencyStops, tokens: TokenReload) {
    let started = thread::Builder::new().name("signals".into()).spawn(move || {
        while let Ok(signal) = signals().wait() {
            match signal {
                Signal::SIGUSR1 => stop_all(&stop),
                Signal::SIGHUP => tokens.reload(),
                _ => {}
            }
        }
    });
    if let Err(error) = started {
        tracing::error!("SIGUSR1 will not stop the plates: {error}");
    }
}

fn stop_all(stop: &EmergencyStops) {
    for stopped in stop.stop_all("SIGUSR1") {
        let (silent, persisted) = stopped.answer.map_or((false, false), |answer| (answer.silent, answer.persisted));
        if silent && persisted {
            tracing::warn!(plate = stopped.plate, "stopped by SIGUSR1: motors silent, on the disk");
        } else {
            tracing::error!(plate = stopped.plate, silent, persisted, "stopped by SIGUSR1, not whole yet");
        }
    }
}
