//! Messages about wrong command lines: one line with a remedy.

use std::error::Error as _;
use std::net::AddrParseError;
use std::num::{ParseFloatError, ParseIntError};

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Error};

use super::args::Cli;
use super::features::HELP;
use super::output::BAD_INPUT;
use upm_runner::config::nearest;

/// Prints help or version if requested, else one line about the fault of the command line.
pub(super) fn answer(error: &Error) -> u8 {
    if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        error.print().ok();
        return u8::try_from(error.exit_code()).unwrap_or(BAD_INPUT);
    }
    errln!("upm: {}", line(error));
    BAD_INPUT
}

/// The fault of a command line, in one line.
pub(super) fn line(error: &Error) -> String {
    let command = command_of(error);
    let help = format!("see `{command} --help`");
    let argument = first(error, ContextKind::InvalidArg);
    // `--seed` of `--seed N`
    let name = argument.split(' ').next().unwrap_or_default().trim_matches(['[', ']']);
    let value = first(error, ContextKind::InvalidValue);
    let found = format!("found {value:?}");
    match error.kind() {
        ErrorKind::InvalidSubcommand => unknown_command(error),
        ErrorKind::UnknownArgument => {
            let meant = did_you_mean(&first(error, ContextKind::SuggestedArg));
            format!("expected an option of `{command}`{meant}, found {argument:?}; {help}")
        }
        ErrorKind::MissingRequiredArgument => {
            let expected = all(error, ContextKind::InvalidArg).join(" and ");
            format!("{}: expected {expected}, found nothing; {help}", command.trim_start_matches("upm "))
        }
        ErrorKind::InvalidValue => match all(error, ContextKind::ValidValue).as_slice() {
            [] => format!("expected {argument}, found nothing; {help}"),
            choices => {
                let meant = nearest(&value, choices.iter().map(String::as_str)).unwrap_or_default();
                format!("{name}: expected one of {}{}, {found}", choices.join(", "), did_you_mean(meant))
            }
        },
        ErrorKind::ValueValidation => match error.source() {
            Some(why) if why.is::<ParseIntError>() => format!("{name}: expected a whole number, {found}"),
            Some(why) if why.is::<ParseFloatError>() => format!("{name}: expected a number, {found}"),
            Some(why) if why.is::<AddrParseError>() => {
                format!("{name}: expected an IP address and a port like 127.0.0.1:8750, {found}")
            }
            Some(why) if why.to_string().contains(", found ") => format!("{name}: {why}"),
            Some(why) => format!("{name}: {why}; {found}"),
            None => format!("{name}: {found}; {help}"),
        },
        ErrorKind::ArgumentConflict => {
            let prior = all(error, ContextKind::PriorArg).join(" or ");
            format!("expected {argument} or {prior}, found both; {help}")
        }
        _ => {
            let text = error.render().to_string();
            let line = text.lines().next().unwrap_or_default();
            format!("{}; {help}", line.trim_start_matches("error: "))
        }
    }
}

/// Message about an unknown command: a similar one, or for a file `run`, which takes files.
fn unknown_command(error: &Error) -> String {
    let found = first(error, ContextKind::InvalidSubcommand);
    if found.ends_with(".json") {
        return format!("expected a command, found the file {found:?}; `upm run {found}` runs a job");
    }
    if found == "lab" {
        return "the lab is a program of its own: `cargo run -p upm-lab` lists its experiments".to_owned();
    }
    let cli = Cli::command();
    let names = cli.get_subcommands().filter(|command| !command.is_hide_set()).map(clap::Command::get_name);
    let suggested = first(error, ContextKind::SuggestedSubcommand);
    let meant = did_you_mean(nearest(&found, names).unwrap_or(&suggested));
    // a build without the daemon lacks its commands
    let lacking = if HELP.is_empty() { String::new() } else { format!(". {}", *HELP) };
    format!("expected a command{meant}, found {found:?}; `upm --help` lists them{lacking}")
}

fn did_you_mean(word: &str) -> String {
    if word.is_empty() { String::new() } else { format!(" (did you mean {word}?)") }
}

/// Command as the usage line in `error` begins: `upm run`.
fn command_of(error: &Error) -> String {
    let usage = match error.get(ContextKind::Usage) {
        Some(ContextValue::StyledStr(usage)) => usage.to_string(),
        _ => String::new(),
    };
    let words = usage.trim_start_matches("Usage:").split_whitespace();
    let named: Vec<&str> = words.take_while(|word| !word.starts_with(['[', '<', '-'])).collect();
    if named.is_empty() { "upm".to_owned() } else { named.join(" ") }
}

fn first(error: &Error, kind: ContextKind) -> String {
    all(error, kind).into_iter().next().unwrap_or_default()
}

/// Words that `error` has under `kind`; arguments as `--rig RIG.json`.
fn all(error: &Error, kind: ContextKind) -> Vec<String> {
    let plain = |text: &String| text.replace(['<', '>'], "").trim_end_matches("...").to_owned();
    match error.get(kind) {
        Some(ContextValue::String(text)) => vec![plain(text)],
        Some(ContextValue::Strings(texts)) => texts.iter().map(plain).collect(),
        _ => Vec::new(),
    }
}
