//! Which threads go first when there are more of them than cores: those that drive a plate.

/// Lets the threads that drive plates go before this one, and before those that it starts. Only on Linux a thread has a
/// niceness of its own; elsewhere, and where it may not be set, the thread stays as it is.
pub fn step_back() {
    #[cfg(target_os = "linux")]
    rustix::process::setpriority_process(None, 5).ok();
}

/// Lets this thread, which drives a plate, go before all others of the machine. Mostly that takes a right that the daemon has
/// only where the service manager gives it (`LimitNICE`, `CAP_SYS_NICE`); without it the thread stays as it is.
pub fn go_first() {
    #[cfg(target_os = "linux")]
    rustix::process::setpriority_process(None, -10).ok();
}
