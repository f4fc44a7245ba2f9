//! The client commands against a running daemon.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use super::daemon_process::{LEFT, RIGHT, TestDaemon, moving, rest, root, status_of};

/// Writes the job to a file, with a rig if given.
fn file(served: &TestDaemon, job: &Value, rig: Option<&str>) -> String {
    let mut job = job.clone();
    if let Some(rig) = rig {
        job["rig"] = json!(root().join("configs/rigs").join(rig));
    }
    let path: PathBuf = served.folder.path().join("job.json");
    fs::write(&path, job.to_string()).unwrap();
    path.to_str().unwrap().to_owned()
}

fn json_of(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn a_job_goes_in_is_watched_and_shown() {
    let served = TestDaemon::start();
    for (rig, name) in [(Some("upm-2.json"), "with-rig"), (None, "without-rig")] {
        let job = file(&served, &rest(name), rig);
        let (stdout, stderr) = served.status(&["submit", &job, "--pace", "max", "--seed", "9", "--watch"], 0);
        let id = stdout.lines().next().unwrap().to_owned();
        assert!(id.len() == 6 && stderr.is_empty(), "{stdout}{stderr}");
        for said in ["completed", &format!("{name} on plate {LEFT}, seed 9: completed"), "plate time"] {
            assert!(stdout.contains(said), "{said}: {stdout}");
        }
        let shown = json_of(&served.status(&["show", &id, "--json"], 0).0);
        assert_eq!((&shown["state"], &shown["seed"], &shown["pace"]), (&json!("completed"), &json!(9), &json!("max")));
        assert_eq!(shown["report"]["outcome"], "completed");
        assert!(served.status(&["show", &id], 0).0.starts_with(&format!("{name} on plate {LEFT}")));
        let (again, _) = served.status(&["watch", &id], 0);
        assert!(again.contains("completed"), "{again}");
    }
    let (listed, _) = served.status(&["jobs", "--limit", "1"], 0);
    assert!(listed.lines().count() == 1 && listed.contains("without-rig"), "newest first: {listed}");
    let listed = json_of(&served.status(&["jobs", "--all", "--json", "--state", "completed"], 0).0);
    assert_eq!(listed["jobs"].as_array().unwrap().len(), 2);
}

#[test]
fn faults_are_reported_one_a_line_under_the_file_name() {
    let served = TestDaemon::start();
    let mut bad = rest("bad");
    bad["parts"][0]["kind"] = json!("pennyy");
    bad["seed"] = json!("seven");
    let refused = |job: &Value, rig, args: &[&str], said: &[&str]| {
        let job = file(&served, job, rig);
        let (stdout, stderr) = served.status(&[&["submit", &job], args].concat(), 2);
        assert!(stdout.is_empty(), "{stdout}");
        assert_eq!(stderr.lines().count(), said.len(), "{stderr}");
        for (line, said) in stderr.lines().zip(said) {
            assert!(line.starts_with(&format!("upm: {job}: {said}: expected ")) && line.contains(", found "), "{line}");
        }
    };
    refused(&bad, Some("upm-2.json"), &[], &["seed", "parts[0].kind"]);
    bad["seed"] = json!(7);
    refused(&bad, Some("upm-2.json"), &[], &["parts[0].kind"]);
    refused(&bad, None, &[], &["parts[0].kind"]);
    refused(&rest("elsewhere"), None, &["--plate", "nowhere"], &["plate"]);
    let mut other_rig = rest("other-rig");
    other_rig["planner"] = json!("auto");
    refused(&other_rig, Some("upm-1.json"), &[], &["rig"]);
    let mut library = rest("own-library");
    library["library"] = json!(root().join("assets/libraries/upm-2.json"));
    refused(&library, Some("upm-2.json"), &[], &["library"]);
    let no_job = "0".repeat(32);
    let (_, stderr) = served.status(&["show", &no_job], 2);
    assert_eq!(stderr, "upm: there is no such job\n");
    let (_, stderr) = served.status(&["estop", "nowhere"], 2);
    assert!(stderr.contains("nowhere: NOT STOPPED"), "{stderr}");
    let (_, stderr) = served.status(&["jobs", "--url", "http://127.0.0.1:1"], 1);
    assert!(stderr.starts_with("upm: no daemon answers at http://127.0.0.1:1"), "{stderr}");
    assert_eq!(served.get("/v1/jobs")["jobs"], json!([]), "nothing wrong is kept");
}

#[test]
fn a_plate_is_stopped_reset_and_resumed_by_hand() {
    let served = TestDaemon::start();
    let job = file(&served, &moving("endless", 3600.0), Some("upm-2.json"));
    let queued = json_of(&served.status(&["submit", &job, "--pace", "max", "--json"], 0).0);
    let id = queued["id"].as_str().unwrap();
    served.until_moving("endless", id);
    let mut watch = served.upm(&["watch", id, "--json"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let (mut watched, mut stdout) = (String::new(), BufReader::new(watch.stdout.take().unwrap()));
    stdout.read_line(&mut watched).unwrap();
    let (plates, _) = served.status(&["plates"], 0);
    assert!(plates.lines().next().unwrap().contains("running"), "{plates}");

    let (stopped, _) = served.status(&["estop"], 0);
    for (line, plate) in stopped.lines().zip([LEFT, RIGHT]) {
        assert!(line.starts_with(&format!("{plate}: motors silent, ")), "{stopped}");
    }
    assert_eq!(stopped.lines().count(), 2);
    stdout.read_to_string(&mut watched).unwrap();
    status_of(&watch.wait_with_output().unwrap(), &["watch"], 1);
    let events: Vec<Value> = watched.lines().map(json_of).collect();
    assert_eq!((&events[0]["event"], &events[0]["data"]["state"]), (&json!("job"), &json!("running")), "{watched}");
    let last = events.last().unwrap();
    assert_eq!((&last["event"], &last["data"]["state"]), (&json!("job"), &json!("cancelled")), "{watched}");
    assert!(served.job(id)["reason"].as_str().unwrap().contains("emergency stop"), "{}", served.job(id));

    let (_, stderr) = served.status(&["submit", &job], 1);
    assert!(stderr.contains("emergency stop"), "{stderr}");
    let (_, stderr) = served.status(&["resume", LEFT], 1);
    assert!(stderr.contains("reset"), "{stderr}");
    served.status(&["reset", LEFT, "--operator", "Ada"], 2);
    served.status(&["reset", LEFT, "--operator", "Ada", "--reason", " "], 2);
    let (reset, _) = served.status(&["reset", LEFT, "--operator", "Ada", "--reason", "nothing is loose"], 0);
    assert!(reset.contains("paused"), "{reset}");
    let (_, stderr) = served.status(&["reset", LEFT, "--operator", "Ada", "--reason", "again"], 1);
    assert_eq!(stderr.lines().count(), 1, "{stderr}");

    let waiting = served.submit(&rest("waiting"), "max");
    assert_eq!(served.plate(RIGHT)["state"], "stopped");
    served.status(&["reset", RIGHT, "--operator", "Ada", "--reason", "nothing is loose"], 0);
    served.status(&["resume", RIGHT], 0);
    served.run_on(RIGHT);
    assert_eq!(served.job(&waiting)["state"], "queued", "a reset starts nothing");
    let (resumed, _) = served.status(&["resume", LEFT, "--operator", "Ann Ö"], 0);
    served.until_state(&waiting, "completed");
    assert!(served.log().contains("operator=\"Ann Ö\"") && resumed.contains("  resumed by Ann Ö"), "{resumed}");
}

#[test]
fn ctrl_c_ends_the_watching_and_not_the_job() {
    let served = TestDaemon::start();
    let id = served.submit(&moving("endless", 3600.0), "max");
    served.until_moving("endless", &id);
    let mut watch = served.upm(&["watch", &id]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    let mut stdout = BufReader::new(watch.stdout.take().unwrap());
    stdout.read_line(&mut line).unwrap();
    assert!(line.starts_with("endless on plate left, seed 1: running"), "{line}");
    assert!(Command::new("kill").args(["-INT", &watch.id().to_string()]).status().unwrap().success());
    let (_, stderr) = status_of(&watch.wait_with_output().unwrap(), &["watch"], 130);
    assert!(stderr.contains("the job goes on"), "{stderr}");
    assert_eq!(served.job(&id)["state"], "running");
}

#[test]
fn watching_goes_on_over_a_kill_of_the_daemon() {
    let served = TestDaemon::start();
    let id = served.submit(&moving("endless", 3600.0), "max");
    served.until_moving("endless", &id);
    let args = ["watch", &id, "--json"];
    let mut watch = served.upm(&args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut stdout = BufReader::new(watch.stdout.take().unwrap());
    let mut before = String::new();
    while !before.contains("\"event\":\"message\"") {
        assert_ne!(stdout.read_line(&mut before).unwrap(), 0, "{before}");
    }
    let served = served.again_there(TestDaemon::kill);
    let mut after = String::new();
    stdout.read_to_string(&mut after).unwrap();
    let (_, stderr) = status_of(&watch.wait_with_output().unwrap(), &args, 1);
    assert!(stderr.contains("the connection"), "it says that it was away: {stderr}");
    let events: Vec<Value> = before.lines().chain(after.lines()).map(json_of).collect();
    let lines = events.iter().filter(|event| event["event"] == "message");
    let offsets: Vec<u64> = lines.filter_map(|event| event["id"].as_u64()).collect();
    assert!(offsets.is_sorted_by(|a, b| a < b), "nothing is told twice: {offsets:?}");
    assert_eq!(events.last().unwrap()["data"]["state"], "interrupted", "{after}");
    assert_eq!(served.job(&id)["state"], "interrupted");
}

#[test]
fn queued_job_can_be_run_before_the_others() {
    let served = TestDaemon::start();
    let running = served.submit(&moving("running", 3600.0), "max");
    served.until_moving("running", &running);
    let [first, second] = ["first", "second"].map(|name| served.submit(&moving(name, 3600.0), "max"));
    let (stdout, _) = served.status(&["run-next", &second], 0);
    assert_eq!(stdout, format!("{second}: runs next on plate {LEFT}\n"));
    assert!(served.job(&second)["turn"].as_i64() < served.job(&first)["turn"].as_i64());
    let (_, stderr) = served.status(&["run-next", &running], 1);
    assert!(stderr.contains("the job does not wait for its plate: running"), "{stderr}");
    served.status(&["cancel", &running], 0);
    served.until_state(&second, "running");
    assert_eq!(served.job(&first)["state"], "queued");
}

#[test]
fn a_job_is_cancelled_in_the_queue_and_on_the_plate() {
    let served = TestDaemon::start();
    let running = served.submit(&moving("running", 3600.0), "max");
    served.until_moving("running", &running);
    let waiting = served.submit(&rest("waiting"), "max");
    let (stdout, _) = served.status(&["cancel", &waiting], 0);
    assert_eq!(stdout, format!("{waiting}: cancelled\n"));
    served.status(&["cancel", &running], 0);
    served.until_state(&running, "cancelled");
    let (_, stderr) = served.status(&["cancel", &running], 1);
    assert!(stderr.contains("has ended"), "{stderr}");
    assert_eq!(served.plate(LEFT)["state"], "idle", "a cancelled job stops nothing else");
}
