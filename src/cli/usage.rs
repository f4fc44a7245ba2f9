//! Messages about wrong command lines: one line with a remedy.

use std::net::AddrParseError;
use std::num::{ParseFloatError, ParseIntError};
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Error};

use super::args::Cli;
use super::output::BAD_INPUT;
use upm_runner::config::nearest;

/// Prints help or version if requested, else one line about the fault of the command line.
pub(super) fn answer(error: &Error) -> ExitCode {
    if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        error.print().ok();
        return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(BAD_INPUT));
    }
    errln!("upm: {}", line(error));
    ExitCode::from(BAD_INPUT)
}

fn line(error: &Error) -> String {
    let command = command_of(error);
    let help = format!("`{command} --help`");
    let argument = first(error, ContextKind::InvalidArg);
    match error.kind() {
        ErrorKind::InvalidSubcommand => unknown_command(error),
        ErrorKind::UnknownArgument if argument.starts_with('-') => {
            let meant = did_you_mean(&first(error, ContextKind::SuggestedArg));
            format!("expected an option of `{command}`{meant}, found {argument:?}; {help} lists them")
        }
        ErrorKind::UnknownArgument => format!("`{command}` takes no further argument, found {argument:?}; see {help}"),
        ErrorKind::MissingRequiredArgument => {
            format!(
                "{}: expected {}, found nothing; see {help}",
                command.strip_prefix("upm ").unwrap_or(&command),
                all(error, ContextKind::InvalidArg).join(" and ")
            )
        }
        ErrorKind::InvalidValue => invalid_value(error, &argument, &help),
        ErrorKind::ValueValidation => {
            let found = first(error, ContextKind::InvalidValue);
            format!(
                "{}: {}found {found:?}",
                name_of(&argument),
                std::error::Error::source(error).map(wanted).unwrap_or_default()
            )
        }
        ErrorKind::ArgumentConflict => {
            let prior = all(error, ContextKind::PriorArg).join(" or ");
            let prior = if prior.is_empty() { "the others".to_owned() } else { prior };
            format!(
                "expected {} or {}, found both; see {help}",
                argument.trim_end_matches("..."),
                prior.trim_end_matches("...")
            )
        }
        _ => {
            let text = error.render().to_string();
            let line = text.lines().next().unwrap_or_default();
            format!("{}; see {help}", line.strip_prefix("error: ").unwrap_or(line))
        }
    }
}

/// Message about an unknown command: a similar one, or for a file `run`, which takes files.
fn unknown_command(error: &Error) -> String {
    let found = first(error, ContextKind::InvalidSubcommand);
    if found.ends_with(".json") {
        return format!("expected a command, found the file {found:?}; `upm run {found}` runs a job");
    }
    let cli = Cli::command();
    let names = || cli.get_subcommands().filter(|command| !command.is_hide_set()).map(clap::Command::get_name);
    let begun = || names().find(|name| found.len() >= 3 && name.starts_with(&found));
    let meant = did_you_mean(nearest(&found, names()).or_else(begun).unwrap_or_default());
    format!("expected a command{meant}, found {found:?}; `upm --help` lists them")
}

fn invalid_value(error: &Error, argument: &str, help: &str) -> String {
    let (found, choices) = (first(error, ContextKind::InvalidValue), all(error, ContextKind::ValidValue));
    let meant = did_you_mean(&first(error, ContextKind::SuggestedValue));
    let found = if found.is_empty() { "nothing".to_owned() } else { format!("{found:?}") };
    match choices.as_slice() {
        [] => format!("expected {argument}, found {found}; see {help}"),
        choices => format!("{}: expected one of {}{meant}, found {found}", name_of(argument), choices.join(", ")),
    }
}

/// Expected form of a value that cannot be parsed, with a trailing comma.
fn wanted(why: &(dyn std::error::Error + 'static)) -> String {
    if why.is::<ParseIntError>() {
        "expected a whole number, ".to_owned()
    } else if why.is::<ParseFloatError>() {
        "expected a number, ".to_owned()
    } else if why.is::<AddrParseError>() {
        "expected an IP address and a port like 127.0.0.1:8750, ".to_owned()
    } else {
        format!("{why}; ")
    }
}

/// Flag without its value: `--seed` of `--seed N`.
fn name_of(argument: &str) -> &str {
    argument.split(' ').next().unwrap_or(argument)
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
    let plain = |text: &String| text.replace(['<', '>'], "");
    match error.get(kind) {
        Some(ContextValue::String(text)) => vec![plain(text)],
        Some(ContextValue::Strings(texts)) => texts.iter().map(plain).collect(),
        _ => Vec::new(),
    }
}
