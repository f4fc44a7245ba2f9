//! Signals, answered by a thread that waits for them while all others block them.

use std::{io, thread};

use nix::sys::signal::{SigSet, Signal};

/// Signals that ask the process to end: by Ctrl-C, by a service manager and by a terminal that closes. Those that its
/// parent ignores, as `nohup` does, are left out: a blocked signal arrives even so.
pub(super) fn ending() -> SigSet {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    let is_heard = |signal: &Signal| (ignored.unwrap_or(0) >> (*signal as i32 - 1)) & 1 == 0;
    [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP].into_iter().filter(is_heard).collect()
}

/// Blocks `signals` in this thread and in those that it starts from now on, and calls `answer` for each of them on a
/// thread of its own. A thread that was there before must block them, too, or they would end the process.
pub(super) fn attend(signals: SigSet, mut answer: impl FnMut() + Send + 'static) {
    let wait = move || {
        while signals.wait().is_ok() {
            answer();
        }
    };
    let start = |()| thread::Builder::new().name("signals".into()).spawn(wait);
    if let Err(error) = signals.thread_block().map_err(io::Error::from).and_then(start) {
        signals.thread_unblock().ok();
        tracing::error!("signals will not be answered: {error}");
    }
}
