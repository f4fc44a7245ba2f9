//! Jobs as students, feeder engineers and operators write them first.

use serde_json::Value;

use super::InMemoryRun;
use super::testing::job_in_configs;
use upm_core::job::{CameraMode, Outcome};
use upm_recording::Verdict;

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn newcomers_jobs_are_done_whatever_the_seed() {
    let mut missed = Vec::new();
    let jobs: Vec<Value> = serde_json::from_str(include_str!("newcomer_jobs.json")).unwrap();
    for mut job in jobs {
        job["rig"] = "rigs/upm-2.json".into();
        for seed in 1..=3 {
            job["seed"] = seed.into();
            let report = InMemoryRun::new(&job_in_configs(&job).with_camera(CameraMode::Positions)).unwrap().run();
            if (report.outcome, report.verdict) != (Outcome::Completed, Some(Verdict::True)) {
                missed.push(format!("{}, seed {seed}: {}", job["name"], report.reason));
            }
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}
