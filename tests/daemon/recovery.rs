//! State of the daemon after a crash.

use std::fs;

use serde_json::Value;

use super::daemon_process::{LEFT, RIGHT, TestDaemon, moving, put_fifo, rest};

#[test]
fn after_a_kill_nothing_is_lost_and_nothing_moves_by_itself() {
    let served = TestDaemon::start();
    let done = served.submit(&rest("done"), "max");
    served.until_state(&done, "completed");
    let running = served.submit(&moving("running", 3600.0), "max");
    let waiting: Vec<String> = (0..3).map(|i| served.submit(&rest(&format!("waiting-{i}")), "max")).collect();
    served.until_moving("running", &running);
    let served = served.again(TestDaemon::kill);

    let state = |id: &str| served.job(id)["state"].as_str().unwrap().to_owned();
    let interrupted = served.job(&running);
    assert_eq!(interrupted["state"], "interrupted");
    assert!(interrupted["finished_at"].is_string() && interrupted["reason"] != "", "{interrupted}");
    assert_eq!(state(&done), "completed");
    assert_eq!(served.job(&done)["report"]["outcome"], "completed");
    assert!(waiting.iter().all(|id| state(id) == "queued"));
    for plate in [LEFT, RIGHT] {
        let plate = served.plate(plate);
        assert_eq!(plate["state"], "paused", "{plate}");
        assert_ne!(plate["why"], "");
    }

    let journal = fs::read_to_string(served.run_folder("running").join("journal.jsonl")).unwrap();
    let whole: Vec<Value> = journal
        .split_inclusive('\n')
        .filter(|line| line.ends_with('\n'))
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    assert!(whole.len() >= 4, "{journal}");
    if cfg!(feature = "rerun") {
        assert_eq!(interrupted["recording"], "partial", "{interrupted}");
        let recording = served.ask("GET", &format!("/v1/jobs/{running}/recording"), &[], "");
        assert_eq!(recording.status, 200);
        assert!(recording.body.starts_with(b"RRF"), "{:?}", &recording.body[..8.min(recording.body.len())]);
    }

    served.status(&["resume", RIGHT], 0);
    served.run_on(RIGHT);
    assert!(waiting.iter().all(|id| state(id) == "queued"), "nothing starts moving by itself");
    assert_eq!(served.plate(LEFT)["queued"], 3);
    served.status(&["resume", LEFT], 0);
    waiting.iter().for_each(|id| drop(served.until_state(id, "completed")));
    assert_eq!(state(&running), "interrupted", "what was interrupted is not run again");
}

#[test]
fn an_emergency_stop_holds_over_a_kill() {
    let served = TestDaemon::start();
    let running = served.submit(&moving("running", 3600.0), "max");
    served.until_moving("running", &running);
    served.status(&["estop", LEFT], 0);
    let served = served.again(TestDaemon::kill);
    assert_eq!(served.plate(LEFT)["state"], "stopped");
    assert_ne!(served.plate(RIGHT)["state"], "stopped");
    let json = [("Content-Type", "application/json")];
    served.ask("POST", "/v1/jobs", &json, &rest("no").to_string()).is_problem(409);
    served.ask("POST", &format!("/v1/plates/{LEFT}/resume"), &[], "").is_problem(409);
    let job = served.job(&running);
    assert!(matches!(job["state"].as_str().unwrap(), "cancelled" | "interrupted"), "{job}");
}

#[test]
#[cfg(feature = "rerun")]
fn fifo_in_place_of_a_recording_is_refused_at_once() {
    use std::time::{Duration, Instant};

    let served = TestDaemon::start();
    let id = served.submit(&rest("one"), "max");
    assert_eq!(served.until_state(&id, "completed")["recording"], "whole");
    put_fifo(&served.run_folder("one").join("run.rrd"));
    let asked = Instant::now();
    served.ask("GET", &format!("/v1/jobs/{id}/recording"), &[], "").is_problem(409);
    assert_eq!(served.get("/v1/jobs")["jobs"].as_array().unwrap().len(), 1);
    assert!(asked.elapsed() < Duration::from_secs(5), "{:?}", asked.elapsed());
}

#[test]
fn fifos_in_the_folder_of_an_interrupted_run_do_not_block_the_start() {
    let served = TestDaemon::start();
    let running = served.submit(&moving("running", 3600.0), "max");
    served.until_moving("running", &running);
    let served = served.again(|served| {
        served.kill();
        let run = served.run_folder("running");
        ["journal.jsonl", "run.rrd"].iter().for_each(|name| put_fifo(&run.join(name)));
    });
    let job = served.job(&running);
    assert_eq!((&job["state"], &job["recording"]), (&"interrupted".into(), &"partial".into()), "{job}");
    served.ask("GET", &format!("/v1/jobs/{running}/recording"), &[], "").is_problem(409);
}
