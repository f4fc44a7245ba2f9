//! The `upm` command; all of its code is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    keep_memory_together();
    ExitCode::from(upm::cli::main())
}

/// Sets glibc's allocator to one arena per core and to return large blocks at once, so that the memory held is about
/// the memory in use. By default glibc creates up to eight arenas per core and keeps the free memory of each. Since
/// threads start and end with every run, a daemon would then hold tens of MB more after some hundred runs.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code)]
fn keep_memory_together() {
    const LARGE_BYTES: i32 = 128 << 10;
    let cores = std::thread::available_parallelism().map_or(2, |cores| cores.get().clamp(2, 64)) as i32;
    for (option, value) in
        [(libc::M_ARENA_MAX, cores), (libc::M_MMAP_THRESHOLD, LARGE_BYTES), (libc::M_TRIM_THRESHOLD, LARGE_BYTES)]
    {
        // SAFETY: documented glibc options, set before a second thread exists; a rejected option keeps its value
        unsafe { libc::mallopt(option, value) };
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
fn keep_memory_together() {}
