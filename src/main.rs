//! The `upm` command: everything it does is in the library.

use std::process::ExitCode;

/// A daemon runs for months, and its threads hand memory to each other: with the system's allocator what it holds
/// grows with the number of threads there ever were.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    upm::cli::main()
}
