//! `upm lab`, rendered scenes, and SVG charts.

mod scene;
mod table;
mod track_speed;

use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

use super::args::{Common, LabArgs};
use super::output::{Failure, print, print_json};
use super::progress::{LateProgress, with_progress};
use upm_chart::Chart;
use upm_lab::{
    EXPERIMENTS, Experiment, ExperimentResult, LabFault, LabRig, Request, VISION, WAVEFORM_FIT, experiment, vision_of,
    waveform_fit_of,
};
use upm_runner::config::{RigSpec, load_trace, one_of, trace_to_json};

pub(super) use scene::of_scene;
use table::{columns, table};
use track_speed::{TrackTimes, tracking};

/// Name that selects all experiments.
const ALL: &str = "all";

/// Result of an experiment, and the files with its plots.
struct ExperimentOutput {
    name: String,
    /// Rig, seed and settings.
    on: String,
    outcome: ExperimentResult,
    written: Vec<PathBuf>,
}

pub(super) fn lab(args: &LabArgs, common: Common) -> Result<u8, Failure> {
    let Some(name) = &args.experiment else { return list(common) };
    if name == ALL {
        return all(args, common);
    }
    if args.settings {
        return list_settings(named(name)?, args, common);
    }
    let made = make(name, args, common)?;
    print(common.json, &made.as_json(), || made.print())
}

/// Runs every experiment; prints one JSON document with figures and series of all, or one table each.
fn all(args: &LabArgs, common: Common) -> Result<u8, Failure> {
    let given = [
        ("--set", !args.set.is_empty()),
        ("--sweep", args.sweep.is_some()),
        ("--settings", args.settings),
        ("--scenes", args.scenes.is_some()),
        ("--trace", args.trace.is_some()),
        ("--plot", args.plot.is_some()),
    ];
    if let Some((option, _)) = given.iter().find(|(_, is_given)| *is_given) {
        let allowed = "the name of one experiment";
        return Err(Failure::bad_input(format!("{option}: expected {allowed}, found {ALL:?}")));
    }
    let mut rows = Vec::new();
    for experiment in EXPERIMENTS {
        let made = make(experiment.name, args, common)?;
        if common.json {
            rows.push(made.as_json());
        } else {
            made.print()?;
        }
    }
    if common.json {
        print_json(&json!({ "seed": args.seed, "experiments": rows }))?;
    }
    Ok(0)
}

/// Runs an experiment, or evaluates a recorded trace, and writes its plots.
fn make(name: &str, args: &LabArgs, common: Common) -> Result<ExperimentOutput, Failure> {
    let (on, outcome) = match &args.trace {
        Some(trace) => (trace.display().to_string(), read_trace(name, trace)?),
        None => measure(name, args, common)?,
    };
    let written = write_files(name, &outcome, args)?;
    Ok(ExperimentOutput { name: name.to_owned(), on, outcome, written })
}

impl ExperimentOutput {
    /// Prints title, tables, notes and files.
    fn print(&self) -> Result<(), Failure> {
        let Self { name, on, outcome, written } = self;
        outln!("{name}, {on}")?;
        if !outcome.figures.is_empty() {
            table(&outcome.figures).into_iter().try_for_each(|line| outln!("  {line}"))?;
        }
        if let Some(sheet) = &outcome.sheet {
            columns(sheet).into_iter().try_for_each(|line| outln!("  {line}"))?;
        }
        outcome.notes.iter().try_for_each(|note| outln!("  {note}"))?;
        if let Some(TrackTimes { cached, fresh }) = (name == VISION).then(tracking).flatten() {
            let [cached, fresh] = [cached, fresh].map(|time| time.as_secs_f64() * 1e6);
            outln!(
                "  tracking one part of 40 px radius: {cached:.1} us a frame, {fresh:.1} us in pictures not yet in the cache"
            )?;
        }
        written.iter().try_for_each(|path| outln!("  {:10} {}", "written", path.display()))
    }

    fn as_json(&self) -> Value {
        let Self { name, on, outcome, .. } = self;
        let figures = outcome.figures.iter().map(|figure| {
            json!({
                "name": figure.name,
                "unit": figure.unit,
                "measured": figure.measured,
                "reference": figure.reference,
                "source": figure.source,
                "relative_error": figure.relative_error(),
            })
        });
        let series: serde_json::Map<String, Value> =
            outcome.series.iter().map(|series| (series.name.clone(), json!(series.values))).collect();
        let table = outcome.sheet.as_ref().map(|sheet| json!({ "columns": sheet.columns, "rows": sheet.rows }));
        json!({
            "experiment": name,
            "on": on,
            "figures": figures.collect::<Vec<_>>(),
            "series": series,
            "table": table,
            "notes": outcome.notes,
        })
    }
}

fn list(common: Common) -> Result<u8, Failure> {
    if common.json {
        let rows = EXPERIMENTS.iter().map(|one| json!({ "experiment": one.name, "about": one.about }));
        print_json(&rows.collect::<Vec<_>>())?;
    } else {
        let width = EXPERIMENTS.iter().map(|one| one.name.len()).max().unwrap_or(0);
        EXPERIMENTS.iter().try_for_each(|one| outln!("{:width$}  {}", one.name, one.about))?;
        outln!("{ALL:width$}  all of these")?;
    }
    Ok(0)
}

fn named(name: &str) -> Result<&'static Experiment, Failure> {
    experiment(name).ok_or_else(|| {
        let names = EXPERIMENTS.iter().map(|one| one.name).chain([ALL]).collect::<Vec<_>>();
        Failure::bad_input(format!("lab: expected {}, found {name:?}", one_of(name, &names)))
    })
}

fn list_settings(experiment: &Experiment, args: &LabArgs, common: Common) -> Result<u8, Failure> {
    let settings = experiment.method.settings(&rig_for(experiment, args)?);
    if common.json {
        let row = |one: &upm_lab::SettingInfo| json!({ "key": one.key, "about": one.about, "usual": one.usual, "range": one.range });
        print_json(&settings.iter().map(row).collect::<Vec<_>>())?;
    } else if settings.is_empty() {
        outln!("{} has no settings", experiment.name)?;
    } else {
        let width = settings.iter().map(|one| one.key.len()).max().unwrap_or(0);
        settings.iter().try_for_each(|one| {
            let [least, most] = one.range;
            outln!("{:width$}  {} ({least} to {most}); usually {}", one.key, one.about, rounded(one.usual))
        })?;
    }
    Ok(0)
}

/// `value` without the rounding error of its unit conversion.
fn rounded(value: f64) -> f64 {
    format!("{value:.9e}").parse().unwrap_or(value)
}

/// Rig on which the experiment is run.
fn rig_for(experiment: &Experiment, args: &LabArgs) -> Result<LabRig, Failure> {
    let rig = match &args.rig {
        Some(path) => RigSpec::load(path),
        None if experiment.strong_rig => RigSpec::upm_2(),
        None => RigSpec::upm_1(),
    };
    lab_rig(&rig.map_err(Failure::faults)?, args.seed)
}

/// Request for the experiment according to the command line.
fn request(args: &LabArgs) -> Result<Request, Failure> {
    let wrong = |option: &str, error: String| Failure::bad_input(format!("{option}: {error}"));
    let assignments = args.set.iter().map(|text| text.parse().map_err(|error| wrong("--set", error)));
    let sweep = args.sweep.as_ref().map(|text| text.parse().map_err(|error| wrong("--sweep", error)));
    Ok(Request { assignments: assignments.collect::<Result<_, _>>()?, sweep: sweep.transpose()? })
}

/// Rig on which the experiment called `name` was run, and its result.
fn measure(name: &str, args: &LabArgs, common: Common) -> Result<(String, ExperimentResult), Failure> {
    let (experiment, request) = (named(name)?, request(args)?);
    if args.scenes.is_some() && name != VISION {
        return Err(Failure::bad_input(format!("--scenes: expected the experiment {VISION}, found {name:?}")));
    }
    let rig = rig_for(experiment, args)?;
    let outcome = with_progress(LateProgress::at_once(common), experiment.about, |show| match args.scenes {
        Some(scenes) => Ok(vision_of(rig.seed, scenes as usize, show)),
        None => experiment.method.run(&rig, &request, show),
    });
    let outcome = outcome.map_err(|fault| match fault {
        LabFault::Setting(fault) => Failure::bad_input(format!("lab {name}: {fault}")),
        fault => Failure::failed(format!("{name} on {}: {fault}", rig.model.name)),
    })?;
    let on = if experiment.on_rig { format!("rig {}, ", rig.model.name) } else { String::new() };
    let set = [&args.set[..], args.sweep.as_slice()].concat().join(", ");
    let how = if set.is_empty() { String::new() } else { format!(", {set}") };
    Ok((format!("{on}seed {}{how}", rig.seed), outcome))
}

fn lab_rig(spec: &RigSpec, seed: u64) -> Result<LabRig, Failure> {
    let penny = spec.kind("penny").and_then(|kind| spec.kinds.get(kind));
    let penny = penny.ok_or_else(|| Failure::failed(format!("rig {} has no kind `penny`", spec.model.name)))?.part();
    Ok(LabRig { model: spec.model.clone(), sim: spec.sim.clone(), penny, seed })
}

/// Result of an experiment on the trace file at `path`.
fn read_trace(name: &str, path: &Path) -> Result<ExperimentResult, Failure> {
    if name != WAVEFORM_FIT {
        return Err(Failure::bad_input(format!("--trace: expected the experiment {WAVEFORM_FIT}, found {name:?}")));
    }
    let pulse = load_trace(path).map_err(Failure::of_files)?;
    waveform_fit_of(&pulse).map_err(|fault| Failure::failed(format!("{}: {fault}", path.display())))
}

/// Writes plots and the trace into the folder; returns the paths in this order.
fn write_files(name: &str, outcome: &ExperimentResult, args: &LabArgs) -> Result<Vec<PathBuf>, Failure> {
    fs::create_dir_all(&args.out).map_err(|error| Failure::write(&args.out, error))?;
    let mut files: Vec<(PathBuf, String)> = outcome
        .charts
        .iter()
        .map(|chart| (args.out.join(format!("{}.svg", chart.name)), upm_chart::svg(chart)))
        .collect();
    // a trace that was read from a file is not written again
    if let Some(pulse) = outcome.recorded.as_ref().filter(|_| args.trace.is_none()) {
        files.push((args.out.join(format!("{name}-trace.json")), trace_to_json(pulse)));
    }
    if let Some(path) = &args.plot {
        files.push((path.clone(), upm_chart::svg_page(&outcome.charts)));
    }
    for (path, text) in &files {
        fs::write(path, text).map_err(|error| Failure::write(path, error))?;
    }
    Ok(files.into_iter().map(|(path, _)| path).collect())
}

/// Refuses SVG output if this build lacks charts.
pub(super) fn check_svg() -> Result<(), Failure> {
    Ok(())
}

/// A chart as an SVG document.
pub(super) fn svg(chart: &Chart) -> Result<String, Failure> {
    Ok(upm_chart::svg(chart))
}
