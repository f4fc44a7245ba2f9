//! Which threads go first when there are more of them than cores: those that drive a plate.

/// Lets the threads that drive plates go before this one, and before those that it starts. Only on Linux a thread has a
/// niceness of its own; elsewhere, and where it may not be set, the thread stays as it is.
pub fn step_back() {
    #[cfg(target_os = "linux")]
    rustix::process::setpriority_process(None, 5).ok();
}

/// Lets this thread, which drives a plate, go before all others of the machine while it has a clock to keep up with; without
/// one it would keep those who answer from the processor. Mostly that takes a right that the daemon has only where the service
/// manager gives it (`LimitNICE`, `CAP_SYS_NICE`); without it the thread stays as it is.
pub fn go_first(has_clock: bool) {
    #[cfg(target_os = "linux")]
    rustix::process::setpriority_process(None, if has_clock { -10 } else { 0 }).ok();
    #[cfg(not(target_os = "linux"))]
    let _ = has_clock;
}
