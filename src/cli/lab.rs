//! `upm lab`, rendered scenes, and charts as SVG.

mod scene;
mod table;
mod track_speed;

use std::fs;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use super::args::{Common, LabArgs};
use super::failure::Failure;
use super::print_json;
use super::progress::target;
use super::recording;
use upm_chart::Chart;
use upm_lab::{EXPERIMENTS, LabRig, Outcome, Track, VISION, WAVEFORM_FIT, experiment, vision_of, waveform_fit_of};
use upm_recording::RerunMode;
use upm_runner::config::{RigSpec, load_trace, trace_to_json};
use upm_viewer::Experiment;

pub(super) use scene::of_scene;
use table::{markdown, table};
use track_speed::{TrackTimes, tracking};

pub(super) fn lab(args: &LabArgs, common: Common) -> Result<u8, Failure> {
    let Some(name) = &args.experiment else { return list(common) };
    let rerun: RerunMode = args.rerun.parse().map_err(|error| Failure::bad_input(format!("--rerun: {error}")))?;
    recording::check(&rerun)?;
    let (on, outcome) = match &args.trace {
        Some(trace) => (trace.display().to_string(), read_trace(name, trace)?),
        None => make(name, args, common)?,
    };
    let title = format!("{name}, {on}");
    let mut written = write_files(name, &outcome, args)?;
    if rerun != RerunMode::Off {
        let path = args.out.join(format!("{name}.rrd"));
        recording::experiment(&rerun, &path, &page(&title, &outcome))?;
        written.push(path);
    }
    if common.json {
        return print_json(&as_json(name, &outcome)).map(|()| 0);
    }
    say!("{title}")?;
    table(&outcome.figures).into_iter().try_for_each(|line| say!("  {line}"))?;
    outcome.notes.iter().try_for_each(|note| say!("  {note}"))?;
    if let Some(TrackTimes { cached, fresh }) = (name == VISION).then(tracking).flatten() {
        let [cached, fresh] = [cached, fresh].map(|time| time.as_secs_f64() * 1e6);
        say!(
            "  tracking one part of 40 px radius: {cached:.1} us a frame, {fresh:.1} us in pictures not yet in the cache"
        )?;
    }
    written.iter().try_for_each(|path| say!("  {:10} {}", "written", path.display()))?;
    Ok(0)
}

fn list(common: Common) -> Result<u8, Failure> {
    if common.json {
        let rows = EXPERIMENTS.iter().map(|one| json!({ "experiment": one.name, "about": one.about }));
        print_json(&rows.collect::<Vec<_>>())?;
    } else {
        let width = EXPERIMENTS.iter().map(|one| one.name.len()).max().unwrap_or(0);
        EXPERIMENTS.iter().try_for_each(|one| say!("{:width$}  {}", one.name, one.about))?;
    }
    Ok(0)
}

/// What the experiment called `name` comes to on the rig, and which rig that is.
fn make(name: &str, args: &LabArgs, common: Common) -> Result<(String, Outcome), Failure> {
    let Some(experiment) = experiment(name) else {
        let names: Vec<&str> = EXPERIMENTS.iter().map(|one| one.name).collect();
        return Err(Failure::bad_input(format!("lab: found {name:?}, allowed: {}", names.join(", "))));
    };
    if args.scenes.is_some() && name != VISION {
        return Err(Failure::bad_input(format!("--scenes: found experiment {name:?}, allowed: {VISION}")));
    }
    let rig = match &args.rig {
        Some(path) => RigSpec::load(path),
        None if experiment.strong_rig => RigSpec::upm_2(),
        None => RigSpec::upm_1(),
    };
    let rig = lab_rig(&rig.map_err(Failure::faults)?, args.seed)?;
    let spinner = Spinner::start(common.quiet || !std::io::stderr().is_terminal(), experiment.about);
    let outcome = match args.scenes {
        Some(scenes) => Ok(vision_of(rig.seed, scenes as usize)),
        None => (experiment.run)(&rig),
    };
    spinner.finish();
    let outcome = outcome.map_err(|fault| Failure::failed(format!("{name} on {}: {fault}", rig.model.name)))?;
    Ok((format!("rig {}, seed {}", rig.model.name, rig.seed), outcome))
}

fn lab_rig(spec: &RigSpec, seed: u64) -> Result<LabRig, Failure> {
    let penny = spec.kind("penny").and_then(|kind| spec.kinds.get(kind));
    let penny = penny.ok_or_else(|| Failure::failed(format!("rig {} knows no penny", spec.model.name)))?.part();
    Ok(LabRig { model: spec.model.clone(), sim: spec.sim.clone(), penny, seed })
}

/// What the trace file at `path` says.
fn read_trace(name: &str, path: &Path) -> Result<Outcome, Failure> {
    if name != WAVEFORM_FIT {
        return Err(Failure::bad_input(format!("--trace: found experiment {name:?}, allowed: {WAVEFORM_FIT}")));
    }
    let pulse = load_trace(path).map_err(Failure::faults)?;
    waveform_fit_of(&pulse).map_err(|fault| Failure::failed(format!("{}: {fault}", path.display())))
}

/// Writes plots and the trace into the folder; the files, in this order.
fn write_files(name: &str, outcome: &Outcome, args: &LabArgs) -> Result<Vec<PathBuf>, Failure> {
    fs::create_dir_all(&args.out).map_err(|error| Failure::write(&args.out, error))?;
    let mut files: Vec<(PathBuf, String)> = outcome
        .charts
        .iter()
        .map(|chart| (args.out.join(format!("{}.svg", chart.name)), upm_chart::svg(chart)))
        .collect();
    // one that was read from a file need not be written to another
    if let Some(pulse) = outcome.recorded.as_ref().filter(|_| args.trace.is_none()) {
        files.push((args.out.join(format!("{name}-trace.json")), trace_to_json(pulse)));
    }
    for (path, text) in &files {
        fs::write(path, text).map_err(|error| Failure::write(path, error))?;
    }
    Ok(files.into_iter().map(|(path, _)| path).collect())
}

/// The outcome as a page of the viewer.
fn page(title: &str, outcome: &Outcome) -> Experiment {
    let motion = outcome.motion.as_ref().map(|motion| upm_viewer::Motion {
        half_side_m: motion.half_side_m,
        t_s: motion.t_s.clone(),
        tracks: motion.tracks.iter().map(track).collect(),
    });
    let figures = markdown(title, &outcome.figures);
    Experiment { title: title.to_owned(), figures, charts: outcome.charts.clone(), motion }
}

fn track(track: &Track) -> upm_viewer::Track {
    let Track { label, radius_m, places_m } = track.clone();
    upm_viewer::Track { label, radius_m, positions_m: places_m }
}

/// Refuses pictures where this build cannot draw them.
pub(super) fn check_svg() -> Result<(), Failure> {
    Ok(())
}

/// A chart as an SVG document.
pub(super) fn svg(chart: &Chart) -> Result<String, Failure> {
    Ok(upm_chart::svg(chart))
}

fn as_json(name: &str, outcome: &Outcome) -> Value {
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
    json!({ "experiment": name, "figures": figures.collect::<Vec<_>>(), "series": series })
}

/// Shows on stderr that work goes on whose length nobody knows.
struct Spinner {
    bar: ProgressBar,
}

impl Spinner {
    fn start(quiet: bool, message: &'static str) -> Self {
        let bar = ProgressBar::with_draw_target(None, target(quiet));
        bar.set_style(ProgressStyle::default_spinner());
        bar.set_message(message);
        bar.enable_steady_tick(Duration::from_millis(200));
        Self { bar }
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
