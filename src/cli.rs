//! The `upm` command: arguments in, exit status out. Results go to stdout, everything else to stderr.

/// A line on stdout, as a `Result`. A reader that has gone away (`| head`) has seen enough and is no error.
macro_rules! say {
    ($($text:tt)*) => { $crate::cli::put(format_args!($($text)*)) };
}

/// A line on stderr; where that cannot be written, nobody can be told.
macro_rules! complain {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        writeln!(std::io::stderr(), $($text)*).ok();
    }};
}

mod args;
mod calibrate;
mod check;
mod client_args;
#[cfg(feature = "daemon")]
mod daemon;
#[cfg(not(feature = "daemon"))]
#[path = "cli/without_daemon.rs"]
mod daemon;
mod failure;
mod features;
#[cfg(feature = "lab")]
mod lab;
#[cfg(not(feature = "lab"))]
#[path = "cli/without_lab.rs"]
mod lab;
mod locate;
#[cfg(test)]
mod log_page;
mod log_writer;
mod logs;
mod man;
mod panics;
mod progress;
mod recording;
mod render;
mod replay;
mod run;
mod simulate;
mod summary;
mod verify;

use std::io::{ErrorKind, Write};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{CommandFactory, Parser};

use args::{Cli, Command};
use failure::Failure;

/// The job ran and did not reach its goal.
const NOT_REACHED: u8 = 1;
/// Bad usage or a bad file.
const BAD_INPUT: u8 = 2;
/// Ended by Ctrl-C.
const INTERRUPTED: u8 = 130;

/// Parses the command line and does what it says. Exit status: 0 done, 1 goal not reached, 2 bad usage or a bad
/// file, 130 ended by Ctrl-C.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    if let Command::Serve(_) = cli.command {
        daemon::hold_back_signals();
    }
    let last_words = logs::start(cli.common, cli.command.log());
    let done = dispatch(cli);
    drop(last_words);
    match done {
        Ok(status) => ExitCode::from(status),
        Err(failure) => ExitCode::from(failure.complain()),
    }
}

fn dispatch(cli: Cli) -> Result<u8, Failure> {
    let common = cli.common;
    match cli.command {
        Command::Run(args) => run::run(&args, common),
        Command::Calibrate(args) => calibrate::calibrate(&args, common),
        Command::Render(args) => render::render(&args, common),
        Command::Locate(args) => locate::locate(&args, common),
        Command::Simulate(args) => simulate::simulate(&args, common),
        Command::Lab(args) => lab::lab(&args, common),
        Command::Replay(args) => replay::replay(&args),
        Command::Verify(args) => verify::verify(&args, common),
        Command::Serve(args) => daemon::serve(&args, common),
        Command::Check(args) => check::check(&args, common),
        Command::Schema(args) => check::schema(&args),
        Command::Client(command) => daemon::client(&command, common),
        Command::SupportBundle(args) => daemon::support_bundle(&args, common),
        Command::Man(args) => man::man(&args),
        Command::Completions(args) => {
            let mut script = Vec::new();
            clap_complete::generate(args.shell, &mut Cli::command(), "upm", &mut script);
            say!("{}", String::from_utf8_lossy(&script).trim_end())?;
            Ok(0)
        }
    }
}

/// A flag that Ctrl-C sets; a second Ctrl-C ends the process at once.
fn stop_on_interrupt() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    let handler = move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(INTERRUPTED));
        }
    };
    if let Err(error) = ctrlc::set_handler(handler) {
        tracing::warn!("Ctrl-C will not stop cleanly: {error}");
    }
    stop
}

/// Prints a result as one JSON document.
fn print_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(|error| Failure::failed(error.to_string()))?;
    say!("{text}")
}

/// Writes a line to stdout.
fn put(text: std::fmt::Arguments<'_>) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::failed(format!("stdout: {error}"))),
        _ => Ok(()),
    }
}
