//! The command line of `upm-lab`: experiments, rendered scenes, and the reference vision. Exit status: 0 done, 1 no
//! result, 2 bad usage or a bad file.

mod args;
mod failure;
mod locate;
mod scene;

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use super::experiment::{EXPERIMENTS, Experiment, Kind, Request, VISION, WAVEFORM_FIT};
use super::outcome::{ExperimentResult, Figure};
use super::recorded::waveform_fit_of;
use super::settings::{SettingInfo, assignment};
use super::sweep::Sweep;
use super::table::{columns, table};
use super::vision::vision_of;
use super::{LabError, LabRig};
use args::{Cli, Command, ExperimentArgs};
use failure::Failure;
use upm_chart::{Chart, Layer, text_table};
use upm_runner::config::{RigSpec, load_trace, one_of, trace_to_json};

/// Name that selects all experiments.
const ALL: &str = "all";

/// Parses the command line and runs the command.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Err(error) if error.use_stderr() => {
            let text = error.render().to_string();
            let said: Vec<&str> = text.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
            let said = said.join(" ");
            return Failure::bad_input(format!("{}; see `upm-lab --help`", said.trim_start_matches("error: ")))
                .report();
        }
        cli => cli.unwrap_or_else(|help| help.exit()),
    };
    let done = match &cli.command {
        Some(Command::Scene(args)) => scene::draw(args, cli.json),
        Some(Command::Locate(args)) => locate::locate(args, cli.json),
        None => run(&cli),
    };
    done.and_then(print).map_or_else(Failure::report, |()| ExitCode::SUCCESS)
}

/// Writes the result of a command to stdout. A reader that has gone is no failure.
fn print(mut result: String) -> Result<(), Failure> {
    if !result.is_empty() && !result.ends_with('\n') {
        result.push('\n');
    }
    match io::stdout().write_all(result.as_bytes()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::failed(format!("stdout: {error}"))),
        _ => Ok(()),
    }
}

/// Runs the experiments of the command line; returns their result as text or JSON.
fn run(cli: &Cli) -> Result<String, Failure> {
    let args = &cli.experiment;
    match args.name.as_deref() {
        None => Ok(list(cli.json)),
        Some(ALL) => all(cli),
        Some(name) if args.settings => list_settings(named(name)?, args, cli.json),
        Some(name) => make(name, cli).map(|(json, text)| if cli.json { format!("{json:#}") } else { text }),
    }
}

/// Runs every experiment: one JSON document with figures and curves of all, or a table of each.
fn all(cli: &Cli) -> Result<String, Failure> {
    let args = &cli.experiment;
    let given = [
        ("--set", !args.set.is_empty()),
        ("--sweep", args.sweep.is_some()),
        ("--settings", args.settings),
        ("--scenes", args.scenes.is_some()),
        ("--trace", args.trace.is_some()),
    ];
    if let Some((option, _)) = given.iter().find(|(_, is_given)| *is_given) {
        return Err(Failure::bad_input(format!("{option}: expected the name of one experiment, found {ALL:?}")));
    }
    let mut rows = Vec::new();
    for experiment in EXPERIMENTS {
        let (json, text) = make(experiment.name, cli)?;
        if cli.json {
            rows.push(json);
        } else {
            print(text)?;
        }
    }
    Ok(if cli.json { format!("{:#}", json!({ "seed": args.seed, "experiments": rows })) } else { String::new() })
}

/// Runs an experiment, or evaluates a recorded trace, and writes its plots; returns the result as JSON and as text.
fn make(name: &str, cli: &Cli) -> Result<(Value, String), Failure> {
    let args = &cli.experiment;
    for (option, is_given, of) in
        [("--trace", args.trace.is_some(), WAVEFORM_FIT), ("--scenes", args.scenes.is_some(), VISION)]
    {
        if is_given && named(name)?.name != of {
            return Err(Failure::bad_input(format!("{option}: expected the experiment {of}, found {name:?}")));
        }
    }
    let (on, outcome) = match &args.trace {
        Some(trace) => (trace.display().to_string(), read_trace(trace)?),
        None => measure(name, cli)?,
    };
    let written = write_files(name, &outcome, args)?;
    Ok((as_json(name, &on, &outcome), as_text(name, &on, &outcome, &written)))
}

/// Title, tables, notes and files; the title has rig, seed and settings, too.
fn as_text(name: &str, on: &str, outcome: &ExperimentResult, written: &[PathBuf]) -> String {
    let mut lines = if outcome.figures.is_empty() { Vec::new() } else { table(&outcome.figures) };
    lines.extend(outcome.sheet.iter().flat_map(columns));
    lines.extend(outcome.notes.iter().cloned());
    lines.extend(written.iter().map(|path| format!("{:10} {}", "written", path.display())));
    lines.iter().fold(format!("{name}, {on}\n"), |text, line| text + "  " + line + "\n")
}

fn as_json(name: &str, on: &str, outcome: &ExperimentResult) -> Value {
    let figure = |figure: &Figure| {
        let Figure { name, unit, measured, reference, source } = figure;
        let error = figure.relative_error();
        json!({ "name": name, "unit": unit, "measured": measured, "reference": reference, "source": source, "relative_error": error })
    };
    let layer = |layer: &Layer| json!({ "label": layer.label, "points": layer.points });
    let chart = |Chart { name, title, x, y, layers, .. }: &Chart| {
        let layers: Vec<Value> = layers.iter().map(layer).collect();
        json!({ "name": name, "title": title, "x": x.label, "y": y.label, "layers": layers })
    };
    let table = outcome.sheet.as_ref().map(|sheet| json!({ "columns": sheet.columns, "rows": sheet.rows }));
    json!({
        "experiment": name,
        "on": on,
        "figures": outcome.figures.iter().map(figure).collect::<Vec<_>>(),
        "charts": outcome.charts.iter().map(chart).collect::<Vec<_>>(),
        "table": table,
        "notes": outcome.notes,
    })
}

fn list(json: bool) -> String {
    if json {
        let rows = EXPERIMENTS.iter().map(|one| json!({ "experiment": one.name, "about": one.about }));
        return format!("{:#}", rows.collect::<Value>());
    }
    let names = EXPERIMENTS.iter().map(|one| [one.name, one.about]).chain([[ALL, "all of these"]]);
    aligned(names.map(|row| row.map(str::to_owned).to_vec()))
}

/// Lines with their cells in columns.
fn aligned(rows: impl Iterator<Item = Vec<String>>) -> String {
    text_table(&rows.collect::<Vec<_>>(), |_| false).join("\n")
}

fn named(name: &str) -> Result<&'static Experiment, Failure> {
    EXPERIMENTS.iter().find(|experiment| experiment.name == name).ok_or_else(|| {
        let names = EXPERIMENTS.iter().map(|one| one.name).chain([ALL]).collect::<Vec<_>>();
        Failure::bad_input(format!("expected {}, found {name:?}", one_of(name, &names)))
    })
}

fn list_settings(experiment: &Experiment, args: &ExperimentArgs, json: bool) -> Result<String, Failure> {
    let settings = (experiment.settings)(&rig_for(experiment, args)?);
    if json {
        let row = |SettingInfo { key, about, usual, range }: &SettingInfo| json!({ "key": key, "about": about, "usual": usual, "range": range });
        return Ok(format!("{:#}", settings.iter().map(row).collect::<Value>()));
    }
    let row = |SettingInfo { key, about, usual, range: [least, most] }: &SettingInfo| {
        vec![(*key).to_owned(), format!("{about} ({least} to {most}); usually {}", rounded(*usual))]
    };
    match settings.is_empty() {
        true => Ok(format!("{} has no settings", experiment.name)),
        false => Ok(aligned(settings.iter().map(row))),
    }
}

/// `value` without the rounding error of its unit conversion.
fn rounded(value: f64) -> f64 {
    format!("{value:.9e}").parse().unwrap_or(value)
}

/// Rig on which the experiment is run.
fn rig_for(experiment: &Experiment, args: &ExperimentArgs) -> Result<LabRig, Failure> {
    let rig = match &args.rig {
        Some(path) => RigSpec::load(path),
        None if experiment.kind == Kind::StrongPlate => RigSpec::upm_2(),
        None => RigSpec::upm_1(),
    };
    let RigSpec { model, sim, kinds, .. } = rig.map_err(Failure::of_files)?;
    let penny = kinds.iter().find(|spec| spec.kind.name == "penny");
    let penny = penny.ok_or_else(|| Failure::failed(format!("rig {} has no kind `penny`", model.name)))?.part();
    Ok(LabRig { model, sim, penny, seed: args.seed })
}

/// Rig on which the experiment called `name` was run, and its result.
fn measure(name: &str, cli: &Cli) -> Result<(String, ExperimentResult), Failure> {
    let args = &cli.experiment;
    let experiment = named(name)?;
    let wrong = |option: &str, error: String| Failure::bad_input(format!("{option}: {error}"));
    let assignments = args.set.iter().map(|text| assignment(text).map_err(|error| wrong("--set", error)));
    let sweep = args.sweep.as_ref().map(|text| Sweep::parse(text).map_err(|error| wrong("--sweep", error)));
    let request = Request { assignments: assignments.collect::<Result<_, _>>()?, sweep: sweep.transpose()? };
    let rig = rig_for(experiment, args)?;
    let outcome = with_progress(cli.quiet, experiment.about, |show| match args.scenes {
        Some(scenes) => Ok(vision_of(rig.seed, scenes as usize, show)),
        None => (experiment.run)(&rig, &request, show),
    });
    let outcome = outcome.map_err(|fault| match fault {
        LabError::Setting(fault) => Failure::bad_input(format!("{name}: {fault}")),
        fault => Failure::failed(format!("{name} on {}: {fault}", rig.model.name)),
    })?;
    let on = if experiment.kind != Kind::Machine { format!("rig {}, ", rig.model.name) } else { String::new() };
    let set = [&args.set[..], args.sweep.as_slice()].concat().join(", ");
    let how = if set.is_empty() { String::new() } else { format!(", {set}") };
    Ok((format!("{on}seed {}{how}", rig.seed), outcome))
}

/// Runs `work` with its progress on stderr, if that is a terminal.
fn with_progress<T>(quiet: bool, about: &str, work: impl FnOnce(&(dyn Fn(f64) + Sync)) -> T) -> T {
    const FULL: u64 = 1000;
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(FULL) };
    if let Ok(style) = ProgressStyle::with_template("[{bar:30}] {percent:>3} %  {elapsed}  {msg}") {
        bar.set_style(style);
    }
    bar.set_message(about.to_owned());
    bar.enable_steady_tick(Duration::from_millis(200));
    let made = work(&|share| bar.set_position((share * FULL as f64) as u64));
    bar.finish_and_clear();
    made
}

/// Result of an experiment on the trace file at `path`.
fn read_trace(path: &Path) -> Result<ExperimentResult, Failure> {
    let pulse = load_trace(path).map_err(Failure::of_files)?;
    waveform_fit_of(&pulse).map_err(|fault| Failure::failed(format!("{}: {fault}", path.display())))
}

/// Writes plots and the trace into the folder; returns the paths in this order.
fn write_files(name: &str, outcome: &ExperimentResult, args: &ExperimentArgs) -> Result<Vec<PathBuf>, Failure> {
    fs::create_dir_all(&args.out).map_err(|error| Failure::write(&args.out, error))?;
    let charts = outcome.charts.iter();
    let mut files: Vec<(PathBuf, String)> =
        charts.map(|chart| (args.out.join(format!("{}.svg", chart.name)), upm_chart::svg(chart))).collect();
    // a trace that was read from a file is not written again
    if let Some(pulse) = outcome.recorded.as_ref().filter(|_| args.trace.is_none()) {
        files.push((args.out.join(format!("{name}-trace.json")), trace_to_json(pulse)));
    }
    for (path, text) in &files {
        fs::write(path, text).map_err(|error| Failure::write(path, error))?;
    }
    Ok(files.into_iter().map(|(path, _)| path).collect())
}
