//! Standing jobs of a daemon as a subprocess: they run on an idle plate, give way, and wait where an operator must act
//! first.

use std::fs;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::daemon_process::{LEFT, RIGHT, TestDaemon, config, moving, rest, root, serve, status_of, until};

/// Configuration of two plates with a standing job on the left one, at full speed.
fn with_standing(start: &str) -> Value {
    let mut config = config();
    config["pace"] = json!("max");
    config["plates"][0]["standing_job"] = json!({"job": "standing.json", "start": start});
    config
}

/// A folder with that configuration, and an endless plus sign as the standing job.
fn folder(config: &Value, change: impl FnOnce(&mut Value)) -> TempDir {
    let folder = TempDir::new().unwrap();
    let mut job = moving("standing", 3600.0);
    job["rig"] = json!(root().join("configs/rigs/upm-2.json"));
    change(&mut job);
    fs::write(folder.path().join("daemon.json"), config.to_string()).unwrap();
    fs::write(folder.path().join("standing.json"), job.to_string()).unwrap();
    folder
}

fn served(start: &str) -> TestDaemon {
    TestDaemon::in_folder(folder(&with_standing(start), |_| ()))
}

/// Waits until the standing job moves its part in a run other than `before`; returns that run's id.
fn until_it_runs(served: &TestDaemon, before: Option<&str>) -> String {
    until("the standing job runs", || {
        let plate = served.plate(LEFT);
        let id = plate["job"].as_str().filter(|id| Some(*id) != before)?.to_owned();
        let runs = plate["standing_job"]["state"] == "running" && plate["phase"] != "";
        runs.then_some(id)
    })
}

#[test]
fn standing_job_gives_way_to_a_submitted_job_and_runs_again() {
    let served = served("running");
    let first = until_it_runs(&served, None);
    let plate = served.plate(LEFT);
    assert_eq!((&plate["state"], &plate["standing_job"]["name"]), (&json!("running"), &json!("standing")), "{plate}");
    assert_eq!((&served.job(&first)["standing"], &served.plate(RIGHT)["standing_job"]), (&json!(true), &Value::Null));

    let submitted = served.submit(&rest("rest"), "max");
    let done = served.until_state(&submitted, "completed");
    assert_eq!(done["standing"], json!(false));
    let gave_way = served.job(&first);
    let report = &gave_way["report"];
    assert_eq!((&gave_way["state"], &report["stop"]["code"]), (&json!("completed"), &json!("gave_way")), "{gave_way}");
    assert!(gave_way["finished_at"].as_str() <= done["started_at"].as_str());

    let second = until_it_runs(&served, Some(&first));
    assert!(served.status(&["show", "last"], 0).0.starts_with("rest on plate "), "the last that a person submitted");
    let (listed, _) = served.status(&["jobs"], 0);
    let is_standing = |line: &&str| line.ends_with("standing (standing job)");
    assert_eq!((listed.lines().count(), listed.lines().filter(is_standing).count()), (3, 2), "{listed}");
    assert!(second.ends_with(&listed[..6]), "{listed}");
    let (plates, _) = served.status(&["plates"], 0);
    assert!(plates.contains(&format!("standing job {second}")), "{plates}");
}

#[test]
fn paused_standing_job_starts_with_a_resume() {
    let served = served("paused");
    let submitted = served.submit(&rest("rest"), "max");
    served.until_state(&submitted, "completed");
    let plate = until("the plate is idle", || Some(served.plate(LEFT)).filter(|plate| plate["state"] == "idle"));
    let standing = &plate["standing_job"];
    assert_eq!((&standing["state"], &plate["job"]), (&json!("paused"), &Value::Null));
    assert_eq!(standing["why"], "it starts paused, as the configuration says");
    assert_eq!(served.get("/v1/jobs")["jobs"].as_array().unwrap().len(), 1);
    let (stdout, _) = served.status(&["resume", LEFT], 0);
    assert!(stdout.starts_with(LEFT), "{stdout}");
    until_it_runs(&served, None);
}

#[test]
fn cancelled_standing_job_stays_off_its_plate_until_a_resume() {
    let served = served("running");
    let first = until_it_runs(&served, None);
    served.status(&["cancel", &first], 0);
    served.until_state(&first, "cancelled");
    let paused = |plate: &Value| plate["standing_job"]["state"] == "paused";
    let plate = until("it is paused", || Some(served.plate(LEFT)).filter(paused));
    assert_eq!((&plate["state"], &plate["job"]), (&json!("idle"), &Value::Null), "{plate}");
    let submitted = served.submit(&rest("rest"), "max");
    served.until_state(&submitted, "completed");
    assert_eq!(served.plate(LEFT)["standing_job"]["state"], "paused");
    served.status(&["resume", LEFT], 0);
    until_it_runs(&served, Some(&first));
}

#[test]
fn emergency_stop_holds_a_standing_job_over_a_restart_until_reset_and_resume() {
    let served = served("running");
    let first = until_it_runs(&served, None);
    served.status(&["estop", LEFT], 0);
    let job = served.until_state(&first, "cancelled");
    assert_eq!(job["reason"], "emergency stop");
    let served = served.again(|served| assert!(served.terminate().success()));
    let plate = served.plate(LEFT);
    assert_eq!((&plate["state"], &plate["standing_job"]["state"]), (&json!("stopped"), &json!("waiting")), "{plate}");
    served.status(&["reset", LEFT, "--operator", "Ada", "--reason", "test"], 0);
    assert_eq!(served.plate(LEFT)["state"], "paused");
    assert_eq!(served.get("/v1/jobs")["jobs"].as_array().unwrap().len(), 1, "a reset starts nothing");
    served.status(&["resume", LEFT], 0);
    until_it_runs(&served, Some(&first));
}

#[test]
fn standing_run_is_interrupted_by_sigterm_and_the_next_daemon_runs_it_again() {
    let mut served = served("running");
    let first = until_it_runs(&served, None);
    assert_eq!(served.terminate().code(), Some(0), "all was closed within the time there is for it");
    let served = served.again(|_| {});
    let job = served.job(&first);
    assert_eq!((&job["state"], &job["standing"]), (&json!("interrupted"), &json!(true)), "{job}");
    until_it_runs(&served, Some(&first));
}

#[test]
fn killed_daemon_starts_no_standing_job_before_a_resume() {
    let served = served("running");
    let first = until_it_runs(&served, None);
    let served = served.again(TestDaemon::kill);
    assert_eq!(served.job(&first)["state"], "interrupted");
    let plate = served.plate(LEFT);
    assert_eq!((&plate["state"], &plate["standing_job"]["state"]), (&json!("paused"), &json!("waiting")), "{plate}");
    served.status(&["resume", LEFT], 0);
    until_it_runs(&served, Some(&first));
}

#[test]
fn few_runs_of_a_standing_job_are_kept() {
    let mut config = with_standing("running");
    config["keep"] = json!({"standing_runs": 2});
    let served = TestDaemon::in_folder(folder(&config, |_| ()));
    let mut runs: Vec<String> = Vec::new();
    for _ in 0..4 {
        runs.push(until_it_runs(&served, runs.last().map(String::as_str)));
        let submitted = served.submit(&rest("rest"), "max");
        served.until_state(&submitted, "completed");
    }
    until("the first runs are forgotten", || {
        let forgotten = |id: &String| served.ask("GET", &format!("/v1/jobs/{id}"), &[], "").status == 404;
        let folders = fs::read_dir(served.folder.path().join("data/runs")).unwrap();
        let names = folders.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let standing = names.filter(|name| name.starts_with("standing-")).count();
        (runs[..2].iter().all(forgotten) && standing <= 3).then_some(())
    });
    let listed = served.get("/v1/jobs");
    let others = listed["jobs"].as_array().unwrap().iter().filter(|job| job["standing"] == json!(false));
    assert_eq!(others.count(), 4, "other jobs stay");
}

#[test]
fn invalid_standing_job_is_refused_in_one_line() {
    let folder = folder(&with_standing("running"), |job| job["parts"][0]["kind"] = json!("pennyy"));
    for more in [&[][..], &["--check"]] {
        let mut command = serve(folder.path(), "127.0.0.1:0");
        let output = command.args(more).stderr(std::process::Stdio::piped()).output().unwrap();
        let (_, stderr) = status_of(&output, more, 2);
        let lines: Vec<&str> = stderr.lines().collect();
        assert!(
            lines.len() == 1 && lines[0].contains("standing.json: parts[0].kind: expected one of penny"),
            "{stderr}"
        );
    }
    assert!(!folder.path().join("data").exists(), "nothing was started");
}
