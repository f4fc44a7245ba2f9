use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::atomic::AtomicBool;

use parking_lot::Mutex;
use rand_distr::{Distribution, StandardNormal};
use serde_json::{Value, json};

use super::*;
use crate::config::Origin;
use upm_core::random::{Rng, Streams};
use upm_recording::RerunMode;
use upm_sim::faults::FaultyComponent;

fn origin() -> Origin {
    Origin::of_file(&Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/made.json"))
}

fn campaign(seeds: &str, job: Value) -> Result<Campaign, Vec<String>> {
    let text = json!({"name": "made", "seeds": seeds, "job": job}).to_string();
    let lines = |faults: Vec<crate::config::Diagnostic>| faults.iter().map(ToString::to_string).collect();
    Campaign::from_json(&text, &origin(), &[]).map_err(lines)
}

/// A job of pennies with draws of every kind.
fn drawn_job() -> Value {
    json!({
        "rig": {"extends": "rigs/upm-2", "friction": {"spread": {"$uniform": [0.0, 0.2]}}},
        "parts": [{"kind": {"$one_of": ["penny", "dime"]}, "count": {"$each": [1, 3]}}],
        "task": {"type": "arrange", "targets_mm": {"$places": {"apart_mm": {"$uniform": [30, 40]}, "within_mm": 120}}},
        "planner": {"$each": ["moving_field", "synthesized_field"]},
        "tolerance_mm": {"$log_uniform": [0.4, 0.8]},
        "limits": {"plate_time_s": {"$integer": [20, 40]}},
        "faults": {"$faults": {"most": 8}},
    })
}

#[test]
fn cells_are_all_combinations_and_each_run_is_drawn_by_its_seed_alone() {
    let made = campaign("1..40", drawn_job()).unwrap();
    assert_eq!((made.cells(), made.runs()), (4, 160));
    assert_eq!(made.cell_name(1), "count=1 planner=synthesized_field");
    let jobs: Vec<Value> = (0..made.runs()).map(|run| made.document(run).unwrap()).collect();
    assert_eq!(jobs[17], made.document(17).unwrap());
    for (run, job) in jobs.iter().enumerate() {
        let (cell, seed) = made.cell_and_seed(run);
        assert_eq!((job["seed"].as_u64(), job["parts"][0]["count"].as_u64()), (Some(seed), Some([1, 3][cell / 2])));
        let places = job["task"]["targets_mm"].as_array().unwrap();
        assert_eq!(places.len() as u64, job["parts"][0]["count"].as_u64().unwrap());
        let (spread, tolerance) = (&job["rig"]["friction"]["spread"], job["tolerance_mm"].as_f64().unwrap());
        assert!((0.0..=0.2).contains(&spread.as_f64().unwrap()) && (0.4..=0.8).contains(&tolerance), "{job}");
        assert!((20..=40).contains(&job["limits"]["plate_time_s"].as_i64().unwrap()), "{job}");
        // what another cell has in the place of a draw changes no other draw
        assert_eq!(&jobs[run - cell]["rig"], &job["rig"]);
        assert_eq!(&jobs[run - cell]["task"]["targets_mm"][0], &places[0]);
        made.job(run).unwrap();
    }
    let distinct: BTreeSet<String> = jobs.iter().map(|job| job["tolerance_mm"].to_string()).collect();
    assert_eq!(distinct.len(), 40);
    let kinds: BTreeMap<_, usize> = jobs.iter().fold(BTreeMap::new(), |mut counts, job| {
        *counts.entry(job["parts"][0]["kind"].to_string()).or_default() += 1;
        counts
    });
    assert!(kinds.len() == 2 && kinds.values().all(|&count| count > 40), "{kinds:?}");
}

#[test]
fn every_kind_of_fault_is_drawn_and_valid() {
    let mut job = drawn_job();
    job["faults"] = json!({"$one_of": [{"$faults": {"most": 8}}, {"$faults": {"until_s": 5}}]});
    let made = campaign("1..400", job).unwrap();
    let mut drawn = BTreeSet::new();
    for run in (2..made.runs()).step_by(4) {
        let faults = made.job(run).unwrap().faults;
        drawn.extend(faults.iter().map(|fault| format!("{} {}", fault.component.class(), fault.kind.code())));
    }
    let single = ["camera", "light", "view", "coil0", "coils", "accel0", "part0", "parts", "plate", "device", "clock"];
    let components = single.into_iter().filter_map(FaultyComponent::named);
    let all: BTreeSet<_> = components
        .flat_map(|component| component.kinds().map(move |kind| format!("{} {}", component.class(), kind.code())))
        .collect();
    assert_eq!(drawn, all);
}

#[test]
fn impossible_draws_are_refused_by_their_places() {
    for (path, value, said) in [
        ("/parts/0/count", json!({"$eac": [1, 2]}), "parts[0].count: expected one of $each, $faults"),
        (
            "/parts/0/count",
            json!({"$integer": [3, 1]}),
            "parts[0].count[\"$integer\"]: expected the least and the largest",
        ),
        ("/tolerance_mm", json!({"$log_uniform": [-1, 1]}), "of one sign, found [-1,1]"),
        ("/planner", json!({"$each": []}), "expected one value or more, found none"),
        ("/planner", json!({"$one_of": [{"$each": ["auto"]}]}), "$each within another draw"),
        ("/faults", json!({"$faults": {"mots": 3}}), "\"most\": 1 to 8"),
        ("/task/targets_mm", json!({"$places": {"apart_mm": 400, "within_mm": 50}}), "no room for 3 parts"),
        ("/rig/extends", json!("rigs/none"), "rigs/none.json"),
    ] {
        let mut job = drawn_job();
        *job.pointer_mut(path).unwrap() = value;
        let lines = campaign("1..2", job).unwrap_err();
        assert!(lines.iter().any(|line| line.contains(said)), "{path}: {lines:?}");
    }
    assert!(campaign("1..2,2", drawn_job()).unwrap_err()[0].contains("seeds: expected each seed once"));
    assert!(
        campaign("0..999999", json!({"parts": [], "x": {"$each": vec![0; 20]}})).unwrap_err()[0].contains("too many")
    );
}

#[test]
fn shards_divide_the_runs() {
    let made = campaign("1..25", drawn_job()).unwrap();
    for shards in [1, 3, 64, 1000] {
        let facts = FolderFacts::of(&made, shards, None);
        let runs: Vec<usize> = (0..shards).flat_map(|shard| facts.runs_of(shard)).collect();
        assert_eq!(runs, (0..100).collect::<Vec<_>>());
    }
}

/// Makes the runs of `campaign` into a folder below `out`; how many were made.
fn made_runs(campaign: &Campaign, out: &Path, threads: usize, judge: Option<&str>) -> usize {
    let folder = CampaignFolder::open_or_create(out, FolderFacts::of(campaign, 8, judge)).unwrap();
    let (stop, count) = (AtomicBool::new(false), Mutex::new(0));
    let runner = CampaignRunner {
        campaign,
        folder: &folder,
        threads,
        keep: Keep::Failures,
        rerun: RerunMode::Off,
        most_kept_bytes: 1 << 20,
        judge,
        without_guard: None,
        stop: &stop,
    };
    runner.run(0..8, 0..campaign.runs(), &|line| *count.lock() += usize::from(line.is_some())).unwrap();
    count.into_inner()
}

fn summary(out: &Path) -> Summary {
    let folder = CampaignFolder::open(out).unwrap();
    let mut summary = Summary::new(&folder.facts);
    for shard in 0..folder.facts.shards {
        folder.lines_of(shard, &[]).unwrap().0.iter().for_each(|line| summary.add(line));
    }
    summary.finish()
}

#[test]
fn half_a_line_is_cut_off_and_its_run_made_again() {
    let out = tempfile::tempdir().unwrap();
    let mut job = drawn_job();
    (job["faults"], job["limits"]["plate_time_s"]) = (json!([]), json!({"$one_of": [20, 0.1]}));
    let made = campaign("1..4", job).unwrap();
    assert_eq!(made_runs(&made, out.path(), 3, None), 16);
    let whole = json!(summary(out.path()));
    assert_eq!(made_runs(&made, out.path(), 1, None), 0);
    let shard = out.path().join("shard-003.jsonl");
    let text = std::fs::read_to_string(&shard).unwrap();
    std::fs::write(&shard, &text[..text.len() - 20]).unwrap();
    assert_eq!(summary(out.path()).missing(), 1);
    assert_eq!(made_runs(&made, out.path(), 2, None), 1);
    assert_eq!(json!(summary(out.path())), whole);
    // folders of failures alone stay, and repeat
    let folder = CampaignFolder::open(out.path()).unwrap();
    let lines: Vec<RunLine> = (0..8).flat_map(|shard| folder.lines_of(shard, &[]).unwrap().0).collect();
    assert!(lines.iter().all(|line| line.folder.is_none() || !line.success), "{lines:?}");
    let kept: Vec<RunLine> = lines.into_iter().filter(|line| line.folder.is_some()).collect();
    assert!((1..16).contains(&kept.len()), "as many as there is room for");
    for line in kept {
        let report = out.path().join(line.folder.unwrap()).join("report.json");
        let report: Value = serde_json::from_str(&std::fs::read_to_string(report).unwrap()).unwrap();
        assert_eq!((report["outcome"].as_str(), report["seed"].as_u64()), (Some(&*line.outcome), Some(line.seed)));
    }
    // another judge is another campaign's folder
    let judged = out.path().join("judged");
    let says = r#"while read folder; do grep -q 'time_limit' "$folder/report.json" && echo '{"violations": ["late: x"]}' \
                  || echo '{"violations": []}'; done"#;
    made_runs(&made, &judged, 2, Some(says));
    assert_eq!(summary(&judged).violations["late"], summary(&judged).failures.len());
}

/// Pairs of runs of which both succeed, the logarithms of the ratios of their times normal about `mean`, until they are
/// told apart or there are 2,000.
fn told(mean: f64, rng: &mut Rng) -> Pairs {
    let mut pairs = Pairs::new(0.03);
    while pairs.verdict == PairsVerdict::Open && pairs.pairs < 2000 {
        let ratio: f64 = StandardNormal.sample(rng);
        pairs.add_ratio(true, true, Some(mean + 0.2 * ratio));
    }
    pairs
}

#[test]
fn pairs_tell_three_per_cent_and_nothing_where_nothing_is() {
    let count = |mean: f64, of: &[PairsVerdict]| {
        let runs = (0..200).filter(|&trial| of.contains(&told(mean, &mut Streams::new(trial).stream("pairs")).verdict));
        runs.count()
    };
    use PairsVerdict::{Faster, LessSuccess, Slower};
    let told = [count(0.0, &[Slower, Faster]), count(0.03, &[Slower]), count(-0.03, &[Faster])];
    assert!(told[0] <= 2 && told[1] >= 198 && told[2] >= 198, "{told:?}");
    let mut pairs = Pairs::new(0.03);
    let verdicts: Vec<_> = (0..100).map(|_| pairs.add_ratio(true, false, None)).collect();
    // 0.75 against 0.5 at odds of 396 to 1 takes fifteen
    assert_eq!((verdicts[99], pairs.pairs), (LessSuccess, 15));
}

#[test]
fn intervals_hold_what_they_are_of() {
    let share = Interval::of_share(8, 10).unwrap();
    // Wilson (1927)
    assert!((share.low - 0.490).abs() < 1e-3 && (share.high - 0.943).abs() < 1e-3, "{share:?}");
    let mut held = 0;
    for trial in 0..1000 {
        let mut rng = Streams::new(trial).stream("median");
        let mut values: Vec<f64> = (0..31).map(|_| StandardNormal.sample(&mut rng)).collect();
        values.sort_by(f64::total_cmp);
        let median = Interval::of_median(&values).unwrap();
        held += usize::from((median.low..=median.high).contains(&0.0));
    }
    assert!((930..=985).contains(&held), "{held}");
}
