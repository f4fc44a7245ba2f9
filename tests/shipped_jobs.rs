//! Every shipped job completes on its rig without a guard firing, in about the time that its dry run predicts.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};
use std::thread;

use serde_json::{Value, json};
use std::process::Command;
use tempfile::TempDir;

#[path = "figures/page.rs"]
#[allow(dead_code)] // figures in passages
mod page;

use page::FigurePage;

/// Ratios of predicted and measured time that the page of results calls usual.
const USUAL: std::ops::RangeInclusive<f64> = 0.7..=1.4;

/// The job that runs to its time limit, as the page names jobs: there is no plate time to compare.
const ENDLESS: &str = "`plus-sign-endless`";

/// All jobs among the shipped configurations.
fn jobs() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let is_job = |file: &PathBuf| {
        file.extension().is_some_and(|extension| extension == "json")
            && serde_json::from_str::<Value>(&std::fs::read_to_string(file).unwrap()).unwrap()["parts"].is_array()
    };
    files.filter(is_job).collect()
}

/// JSON that `upm` prints.
fn printed(args: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_upm")).args(args).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{args:?}: {error}: {stderr}"))
}

/// A job with its own seed.
struct JobResult {
    /// Predicted plate times, s; null where no dry run reaches the goal, and for the job without an end.
    predicted_s: Value,
    report: Value,
}

/// Result of each job by its name. All tests of this file share them.
fn results() -> &'static BTreeMap<String, JobResult> {
    static RESULTS: OnceLock<BTreeMap<String, JobResult>> = OnceLock::new();
    RESULTS.get_or_init(|| {
        let named = jobs().into_iter().map(|file| (format!("`{}`", file.file_stem().unwrap().display()), file));
        let waiting = Mutex::new(named.collect::<Vec<_>>());
        let done = Mutex::new(BTreeMap::new());
        let work = || {
            while let Some((name, file)) = { waiting.lock().unwrap().pop() } {
                let (file, out) = (file.to_str().unwrap(), TempDir::new().unwrap());
                let jobs = (name != ENDLESS).then(|| printed(&["check", file, "--plan", "--json"]));
                let predicted_s =
                    jobs.map(|jobs| jobs[0]["plan"]["predicted_plate_time_s"].clone()).unwrap_or_default();
                let out = out.path().to_str().unwrap();
                let report = printed(&["run", file, "--rerun", "off", "--json", "--quiet", "--out", out]);
                done.lock().unwrap().insert(name, JobResult { predicted_s, report });
            }
        };
        thread::scope(|scope| {
            let threads = [(); 2].map(|()| scope.spawn(work));
            threads.into_iter().for_each(|thread| thread.join().unwrap());
        });
        done.into_inner().unwrap()
    })
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn shipped_jobs_complete_and_no_guard_fires() {
    assert!(results().len() >= 23, "jobs are where they are looked for");
    for (name, JobResult { report, .. }) in results() {
        assert_eq!(report["outcome"], "completed", "{name}: {}", report["reason"]);
        // a hold whose plate is not knocked would complete without any pulse
        assert!(name != "`hold-4`" || report["pulses"].as_u64() > Some(20), "{}", report["pulses"]);
        assert!([&Value::Null, &json!([])].contains(&&report["guards"]), "{name}: {}", report["guards"]);
    }
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn dry_runs_predict_runs_as_the_results_pages_say() {
    let page = FigurePage::open("docs/results.md");
    let ending = results().iter().filter(|(name, _)| *name != ENDLESS);
    let mut unusual = BTreeSet::new();
    for (name, JobResult { predicted_s, report }) in ending {
        let predicted_s = predicted_s["median"].as_f64().unwrap_or_else(|| panic!("{name} is not predicted"));
        let ratio = predicted_s / report["plate_time_s"].as_f64().unwrap();
        if !USUAL.contains(&ratio) {
            unusual.insert(name.trim_matches('`'));
        }
    }
    let excepted = page.text_between("Every ratio", "is within 0.7 to 1.4");
    let excepted: BTreeSet<String> = excepted.split('`').skip(1).step_by(2).map(str::to_owned).collect();
    assert!(excepted.iter().eq(unusual.iter().copied()), "docs/results.md excepts {excepted:?}, found {unusual:?}");
}

/// `UPM_REMAKE_GOLDEN=1` writes the file anew.
#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn times_in_the_list_of_jobs_are_those_of_the_dry_runs() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/expected-plate-times-s.json");
    let of = |key: &str, result: &JobResult| result.predicted_s[key].as_f64().unwrap();
    let all = results().iter().filter(|(name, _)| *name != ENDLESS).map(|(name, job)| (name.trim_matches('`'), job));
    if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
        let times: BTreeMap<_, _> = all.map(|(name, job)| (name, (10.0 * of("median", job)).round() / 10.0)).collect();
        return std::fs::write(&file, serde_json::to_string_pretty(&times).unwrap() + "\n").unwrap();
    }
    let listed: BTreeMap<String, f64> = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    let holds = |name: &str, job: &JobResult| (of("least", job)..=of("most", job)).contains(&listed[name]);
    let outdated: Vec<&str> = all.filter(|(name, job)| !holds(name, job)).map(|(name, _)| name).collect();
    assert!(outdated.is_empty(), "{outdated:?}");
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn run_of_the_strong_rig_has_the_figures_of_the_results_page() {
    let figures = ["cross_track_rms_mm", "plate_time_s"];
    let measured = |key: &str| results()["`plus-sign-upm-2`"].report[key].as_f64().unwrap();
    let mut page = FigurePage::open("docs/results.md");
    page.cell("| what | measured | command |", "`upm-2`, plus-sign, one lap", "measured", &figures.map(measured));
    page.assert_as_measured();
}
