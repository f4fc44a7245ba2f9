//! The `upm` command: everything it does is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    keep_memory_together();
    upm::cli::main()
}

/// Threads come and go with every run. Left alone, glibc makes up to eight arenas for each core and holds on to what is
/// free in each: tens of MB after some hundred runs of a daemon, more or less by chance. With an arena for each core, and
/// large blocks given back at once, what the process holds is what it uses.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code)]
fn keep_memory_together() {
    const LARGE_BYTES: i32 = 128 << 10;
    let cores = std::thread::available_parallelism().map_or(2, |cores| cores.get().clamp(2, 64)) as i32;
    for (option, value) in
        [(libc::M_ARENA_MAX, cores), (libc::M_MMAP_THRESHOLD, LARGE_BYTES), (libc::M_TRIM_THRESHOLD, LARGE_BYTES)]
    {
        // SAFETY: glibc's own options, set before there is a second thread; one that it refuses stays as it was
        unsafe { libc::mallopt(option, value) };
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn keep_memory_together() {}
