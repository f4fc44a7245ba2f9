//! Entry point of the `upm` command: parses arguments and returns the exit status. Results go to stdout, everything
//! else to stderr.

/// Writes a line to stdout and yields a `Result`. A closed pipe (`| head`) is not an error.
macro_rules! outln {
    ($($text:tt)*) => { $crate::cli::output::put(format_args!($($text)*)) };
}

/// Writes a line to stderr; a failed write is ignored.
macro_rules! errln {
    ($($text:tt)*) => {{
        $crate::cli::output::put_error(format_args!($($text)*));
    }};
}

mod args;
mod benchmark;
mod calibrate;
mod campaign;
mod check;
#[cfg(feature = "daemon")]
mod client_args;
#[cfg(feature = "daemon")]
mod daemon;
mod examples;
mod export;
mod features;
mod init;
mod job_changes;
mod job_list;
mod locate;
mod logs;
mod output;
mod panics;
mod progress;
mod render;
mod replay;
mod run;
mod run_args;
mod run_folder;
mod shipped;
mod signals;
mod simulate;
mod summary;
#[cfg(test)]
mod test_buffer;
mod timeline;
mod usage;
mod verify;

use std::ffi::OsString;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::{CommandFactory, FromArgMatches};

use args::{Cli, Command};
use output::{Failure, print_json};

/// Runs the process's command line. Returns its exit status: 0 done, 1 task not completed, 2 bad usage or a bad file,
/// 130 ended by Ctrl-C.
pub fn main() -> u8 {
    main_with(std::env::args_os())
}

/// As [`main`], for the command line that `args` are, the program's name first.
pub fn main_with(args: impl IntoIterator<Item = OsString>) -> u8 {
    let mut command = examples::command();
    let parsed = command.try_get_matches_from_mut(args);
    let cli = match parsed.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) => return usage::answer(&error.format(&mut command)),
    };
    let log = cli.command.log();
    #[cfg(feature = "daemon")]
    if log.is_some() {
        daemon::hold_back_sigusr1();
    }
    let timeline = match cli.command.trace().map(timeline::create).transpose() {
        Ok(timeline) => timeline.unzip(),
        Err(failure) => return failure.report(),
    };
    let flush_guard = logs::start(cli.common, log, timeline.0);
    let done = dispatch(cli);
    drop((flush_guard, timeline.1));
    done.unwrap_or_else(|failure| failure.report())
}

/// Runs a command that prints one JSON document, without printing; returns that document. The flag `stop` takes the
/// place of Ctrl-C.
///
/// # Errors
/// The lines that a command without a document prints on stderr.
pub fn answer(args: impl IntoIterator<Item = OsString>, stop: &Arc<AtomicBool>) -> Result<String, Vec<String>> {
    let mut command = examples::command();
    let parsed = command.try_get_matches_from_mut(args).and_then(|matches| Cli::from_arg_matches(&matches));
    let mut cli = parsed.map_err(|error| vec![usage::line(&error.format(&mut command))])?;
    (cli.common.json, cli.common.quiet) = (true, true);
    let captured = output::captured(stop, || dispatch(cli).map_err(|failure| failure.report()));
    if captured.document.is_empty() { Err(captured.errors) } else { Ok(captured.document) }
}

/// Path and text of each shipped file: jobs, rigs, libraries, examples. They name each other by these paths.
pub fn shipped_files() -> &'static [(&'static str, &'static str)] {
    shipped::FILES
}

fn dispatch(cli: Cli) -> Result<u8, Failure> {
    let common = cli.common;
    match cli.command {
        Command::Init(args) => init::init(&args, common),
        Command::Run(args) => match (&args.seeds, &args.job) {
            (Some(seeds), Some(file)) => campaign::of_seeds(file, seeds, &args, common),
            _ => run::run(&args, common),
        },
        Command::Campaign(args) => campaign::campaign(&args, common),
        Command::Calibrate(args) => calibrate::calibrate(&args, common),
        Command::Render(args) => render::render(&args, common),
        Command::Locate(args) => locate::locate(&args, common),
        Command::Simulate { experiment } => simulate::simulate(&experiment, common),
        Command::Replay(args) => replay::replay(&args),
        Command::Benchmark(args) => benchmark::benchmark(&args, common),
        Command::Verify(args) => verify::verify(&args, common),
        Command::Export(args) => export::export(&args, common),
        #[cfg(feature = "daemon")]
        Command::Serve(args) => daemon::serve(&args, common),
        #[cfg(feature = "daemon")]
        Command::Client(command) => daemon::client_command(&command, common),
        Command::Check(args) => check::check(&args, common),
        Command::Schema { name } => schema(&name),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "upm", &mut script);
            outln!("{}", String::from_utf8_lossy(&script).trim_end())?;
            Ok(0)
        }
    }
}

/// Prints the JSON Schema of a file.
fn schema(name: &str) -> Result<u8, Failure> {
    print_json(&match name {
        "journal" => Some(upm_recording::journal_schema()),
        "report" => Some(upm_recording::report_schema()),
        name => upm_runner::config::schema(name),
    })?;
    Ok(0)
}
