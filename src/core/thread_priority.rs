//! Scheduling priorities of threads: those that drive a plate precede all others when there are more threads than
//! cores.
//!
//! Niceness is relative to that of the process, which its first thread keeps. Only Linux has a niceness per thread;
//! elsewhere, and where it may not be set, the priority is unchanged.

/// Niceness added for background threads.
const BACKGROUND_NICE: i32 = 5;

/// Niceness added (negative) for threads that drive a plate in real time.
const REALTIME_NICE: i32 = -10;

/// Lowers the priority of this thread, and of those it starts, below that of threads that drive plates.
pub fn lower_thread_priority() {
    set_niceness(BACKGROUND_NICE);
}

/// Raises this thread, which drives a plate, above all others of the machine if it `has_clock`. Without a clock it gets
/// the process's priority, because it runs unthrottled and would keep other threads from the processor. Raising usually
/// requires a privilege that the daemon has only if the service manager grants it (`LimitNICE`, `CAP_SYS_NICE`);
/// without it the priority is unchanged.
pub fn raise_thread_priority(has_clock: bool) {
    set_niceness(if has_clock { REALTIME_NICE } else { 0 });
}

#[cfg(target_os = "linux")]
fn set_niceness(by: i32) {
    use rustix::process::{getpid, getpriority_process, setpriority_process};

    let started_with = getpriority_process(Some(getpid())).unwrap_or(0);
    setpriority_process(None, started_with + by).ok();
}

#[cfg(not(target_os = "linux"))]
fn set_niceness(_: i32) {}
