//! Figures of series of runs with many coins on the pages. The jobs are those of `tools/bench/many_coins.py`, the
//! command that the pages name; a table's rows say how many seeds are run.

use std::collections::BTreeMap;
use std::process::Command;

use serde_json::Value;

use super::page::{FigurePage, numbers};
use super::root;

/// Runs jobs of the tool two at a time, and prints their reports by job.
const DRIVER: &str = r#"
import contextlib, json, sys, tempfile
sys.path.insert(0, "tools/bench")
import many_coins
upm, planner, most_s, wanted = sys.argv[1], sys.argv[2], float(sys.argv[3]), json.loads(sys.argv[4])
with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(sys.stderr):
    bench = many_coins.Bench(upm, folder, 0.1)
    reports = {name: bench.campaign([name], planner, seeds, 2, most_s)[name] for name, seeds in wanted.items()}
json.dump(reports, sys.stdout)
"#;

/// Headers of the tables.
const FIELDS: &str = "| what | completed |";
const METHODS: &str = "| | 2 pennies |";
const ROTATIONS: &str = "| what | done |";
const DENSE: &str = "| pennies and places | done |";
const README: &str = "| what | `upm` | best rival |";

/// Jobs of both tables of rotations, in the order of the rows.
const ROTATION_JOBS: [&str; 8] =
    ["arrange-2", "arrange-4", "arrange-8", "arrange-16", "sort-8", "sort-12", "swap-2", "ring-6"];
const DENSE_JOBS: [&str; 6] = ["row-6-22", "row-8-22", "octagon-8", "grid-9-24", "grid-12-25", "grid-12-32"];

/// Columns of the table of methods with their jobs.
const COMPARED: [(&str, &str); 4] =
    [("2 pennies", "arrange-2"), ("4", "arrange-4"), ("8", "arrange-8"), ("16", "arrange-16")];
/// Plate time after which a run counts as not completed in that table, s.
const MOST_S: f64 = 120.0;

/// Number of seeds of each job.
type Seeds = BTreeMap<String, usize>;
/// Reports of each job in the order of the seeds, from 1 on.
type Series = BTreeMap<String, Vec<Value>>;

fn run(planner: &str, most_s: f64, seeds: &Seeds) -> Series {
    let (most_s, seeds) = (most_s.to_string(), serde_json::to_string(seeds).unwrap());
    let args = ["-B", "-c", DRIVER, env!("CARGO_BIN_EXE_upm"), planner, &most_s, &seeds];
    let output = Command::new("python3").args(args).current_dir(root()).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {stderr}"))
}

/// Takes at least this many seeds of a job.
fn add(seeds: &mut Seeds, name: &str, count: usize) {
    let wanted = seeds.entry(name.to_owned()).or_default();
    *wanted = count.max(*wanted);
}

/// Number of runs in a cell such as `20 of 20`.
fn count_in(cell: &str) -> usize {
    *numbers(cell).get(1).unwrap_or_else(|| panic!("expected N of N, found {cell:?}")) as usize
}

fn values<'a>(runs: &'a [Value], pointer: &'a str) -> impl Iterator<Item = f64> + 'a {
    runs.iter().filter_map(move |run| run.pointer(pointer)?.as_f64())
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len().is_multiple_of(2) { 0.5 * (values[middle - 1] + values[middle]) } else { values[middle] }
}

/// Plate times of the runs, s; endless where a run is not completed in `most_s`.
fn plate_times_s(runs: &[Value], most_s: f64) -> Vec<f64> {
    let time_s = |run: &Value| {
        let time_s = run["plate_time_s"].as_f64().filter(|time_s| *time_s <= most_s);
        time_s.filter(|_| run["outcome"] == "completed").unwrap_or(f64::INFINITY)
    };
    runs.iter().map(time_s).collect()
}

/// Compares a row with the runs of its job; `done` is its column of counts.
fn compare_row(page: &mut FigurePage, table: &str, label: &str, done: &str, (name, runs): (&str, &[Value])) {
    let times_s = plate_times_s(runs, f64::INFINITY);
    let completed: Vec<Value> =
        runs.iter().zip(&times_s).filter(|(_, time_s)| time_s.is_finite()).map(|(run, _)| run.clone()).collect();
    page.cell(table, label, done, &[completed.len() as f64, runs.len() as f64]);
    let times = if name == "bowtie-3" {
        // a time that the job asks for: the path and the phase instead
        [largest(values(runs, "/cross_track_rms_mm")), 100.0 * largest(values(runs, "/phase_error_max"))]
    } else {
        [median(times_s), largest(values(&completed, "/plate_time_s"))]
    };
    page.cell(table, label, "plate time", &times);
    if name.starts_with("sort-") {
        assert!(completed.iter().all(|run| run["verdict"] == "true"), "{label}: parts are in their bins");
        page.cell(table, label, "worst true error", &[]);
    } else {
        page.cell(table, label, "worst true error", &[largest(values(&completed, "/max_error_mm"))]);
    }
}

/// Compares the rows of a table of rotations, in the order of their jobs.
fn compare_rotations(page: &mut FigurePage, table: &str, jobs: &[&str], series: &Series) {
    for (row, &name) in page.rows(table).iter().zip(jobs) {
        let (label, runs) = (&row.cells[0], &series[name][..count_in(row.cell("done"))]);
        compare_row(page, table, label, "done", (name, runs));
        page.cell(table, label, "touches", &[values(runs, "/collisions").sum::<f64>()]);
    }
}

/// Figures in a cell of the table of methods.
fn in_words(runs: &[Value]) -> Vec<f64> {
    let times_s = plate_times_s(runs, MOST_S);
    let done = times_s.iter().filter(|time_s| time_s.is_finite()).count();
    match median(times_s) {
        _ if done == 0 => vec![values(runs, "/lost_parts").sum::<f64>()],
        median_s if median_s.is_finite() => vec![done as f64, runs.len() as f64, median_s],
        _ => vec![done as f64, runs.len() as f64],
    }
}

/// Compares the errors of forecasts below the first table, over the medians of the jobs.
fn compare_forecasts(page: &mut FigurePage, series: &Series) {
    let medians = |key: &str, name: Option<&str>| -> Vec<f64> {
        let pointer = format!("/prediction_error_mm/{key}");
        let jobs = series.iter().filter(|(job, _)| name.map_or(job.as_str() != "swap-2", |name| job.as_str() == name));
        jobs.map(|(_, runs)| median(values(runs, &pointer).collect())).collect()
    };
    let ends = |values: Vec<f64>| [values.iter().copied().fold(f64::INFINITY, f64::min), largest(values.into_iter())];
    let by_library = [medians("library", None), medians("library", Some("swap-2"))].concat();
    page.passage("each coin's displacement to", "mm rms. With the friction", &ends(by_library));
    let [low, high] = ends(medians("learned", None));
    let swapped = medians("learned", Some("swap-2"))[0];
    page.passage("the error is", "when two coins change places", &[low, high, swapped]);
}

#[test]
#[ignore = "campaign: `cargo test --test cli -- --ignored campaign_of` runs it"]
fn campaign_of_many_coins_has_the_figures_of_the_results_pages() {
    let mut results = FigurePage::open("docs/results.md");
    let mut rotations = FigurePage::open("docs/results-rotations.md");
    let (mut by_fields, mut by_rotations, mut by_pseudo_inverse) = (Seeds::new(), Seeds::new(), Seeds::new());
    let rows = results.rows(FIELDS);
    // `python3 tools/bench/many_coins.py --only NAME`, or: the same with `NAME`
    let name_in = |command: &str| command.trim_end_matches('`').rsplit([' ', '`']).next().unwrap().to_owned();
    let names: Vec<String> = rows.iter().map(|row| name_in(row.cell("command"))).collect();
    for (row, name) in rows.iter().zip(&names) {
        add(&mut by_fields, name, count_in(row.cell("completed")));
    }
    let rotation_rows = rotations.rows(ROTATIONS);
    assert_eq!((names.len(), rotation_rows.len()), (10, ROTATION_JOBS.len()), "{names:?}");
    for (row, name) in rotation_rows.iter().zip(ROTATION_JOBS) {
        add(&mut by_rotations, name, count_in(row.cell("done")));
    }
    let starts = count_in(results.row(METHODS, "synthesised fields").cell("2 pennies"));
    for (_, name) in COMPARED {
        for seeds in [&mut by_fields, &mut by_rotations, &mut by_pseudo_inverse] {
            add(seeds, name, starts);
        }
    }
    let fields = run("synthesized_field", f64::INFINITY, &by_fields);
    let turned = run("cor_sequence", f64::INFINITY, &by_rotations);
    let pseudo_inverse = run("pseudo_inverse", MOST_S, &by_pseudo_inverse);

    let mut lost = 0.0;
    for (row, name) in rows.iter().zip(&names) {
        let runs = &fields[name][..count_in(row.cell("completed"))];
        compare_row(&mut results, FIELDS, &row.cells[0], "completed", (name.as_str(), runs));
        assert_eq!(values(runs, "/collisions").sum::<f64>(), 0.0, "docs/results.md says that none touched: {name}");
        lost += values(runs, "/lost_parts").sum::<f64>();
    }
    results.passage("Coins that fell off the plate in these runs:", "in all", &[lost]);
    compare_forecasts(&mut results, &fields);
    compare_rotations(&mut rotations, ROTATIONS, &ROTATION_JOBS, &turned);
    for (column, name) in COMPARED {
        for (label, series) in [
            ("plain pseudo-inverse", &pseudo_inverse),
            ("sequences of rotations", &turned),
            ("synthesised fields", &fields),
        ] {
            results.cell(METHODS, label, column, &in_words(&series[name][..starts]));
        }
    }
    let mut readme = FigurePage::open("README.md");
    for (label, name) in [("8 pennies to random places", "arrange-8"), ("16 pennies", "arrange-16")] {
        let [ours, others] = [&fields, &pseudo_inverse].map(|series| &series[name][..starts]);
        let times_s = plate_times_s(ours, MOST_S);
        assert!(times_s.iter().all(|time_s| time_s.is_finite()), "README.md says that all are done: {name}");
        readme.cell(README, label, "`upm`", &[median(times_s)]);
        readme.cell(README, label, "best rival", &in_words(others));
    }
    [results, rotations, readme].into_iter().for_each(FigurePage::assert_as_measured);
}

#[test]
#[ignore = "campaign: `cargo test --test cli -- --ignored campaign_of` runs it"]
fn campaign_of_dense_places_has_the_figures_of_the_page_of_rotations() {
    let mut page = FigurePage::open("docs/results-rotations.md");
    let rows = page.rows(DENSE);
    assert_eq!(rows.len(), DENSE_JOBS.len(), "{rows:?}");
    let mut seeds = Seeds::new();
    for (row, name) in rows.iter().zip(DENSE_JOBS) {
        add(&mut seeds, name, count_in(row.cell("done")));
    }
    let series = run("cor_sequence", f64::INFINITY, &seeds);
    compare_rotations(&mut page, DENSE, &DENSE_JOBS, &series);
    page.assert_as_measured();
}
