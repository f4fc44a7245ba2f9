//! The `upm` command: everything it does is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    upm::cli::main()
}
