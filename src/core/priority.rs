//! Which threads go first when there are more of them than cores: those that drive a plate.
//!
//! All is against the niceness that the process was started with, which its first thread keeps. Only on Linux a thread has
//! one of its own; elsewhere, and where it may not be set, a thread stays as it is.

/// What threads have more of that wait for others.
const BACK: i32 = 5;

/// What a thread has less of that has a clock to keep up with.
const FIRST: i32 = -10;

/// Lets the threads that drive plates go before this one, and before those that it starts.
pub fn step_back() {
    put(BACK);
}

/// Lets this thread, which drives a plate, go before all others of the machine while it has a clock to keep up with; without
/// one it would keep those who answer from the processor. Mostly that takes a right that the daemon has only where the service
/// manager gives it (`LimitNICE`, `CAP_SYS_NICE`); without it the thread stays as it is.
pub fn go_first(has_clock: bool) {
    put(if has_clock { FIRST } else { 0 });
}

#[cfg(target_os = "linux")]
fn put(by: i32) {
    use rustix::process::{getpid, getpriority_process, setpriority_process};

    let started_with = getpriority_process(Some(getpid())).unwrap_or(0);
    setpriority_process(None, started_with + by).ok();
}

#[cfg(not(target_os = "linux"))]
fn put(_: i32) {}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use rustix::process::{getpid, getpriority_process};

    use super::*;

    #[test]
    fn niceness_is_counted_from_that_of_the_process() {
        let started_with = getpriority_process(Some(getpid())).unwrap();
        std::thread::spawn(move || {
            let mine = || getpriority_process(None).unwrap();
            step_back();
            assert_eq!(mine(), (started_with + BACK).min(19));
            // a second time is no further back
            step_back();
            assert_eq!(mine(), (started_with + BACK).min(19));
            std::thread::spawn(step_back).join().unwrap();
            assert_eq!(getpriority_process(Some(getpid())).unwrap(), started_with);
        })
        .join()
        .unwrap();
    }
}
