//! Idempotency keys: a job is queued once, however often it is sent.

use std::collections::BTreeSet;
use std::fs;
use std::thread;

use serde_json::{Value, json};

use super::daemon_process::{LEFT, TestDaemon, config, moving, rest};
use super::http::Answer;

fn send(served: &TestDaemon, key: &str, query: &str, job: &Value) -> Answer {
    let headers = [("Content-Type", "application/json"), ("Idempotency-Key", key)];
    served.ask("POST", &format!("/v1/jobs{query}"), &headers, &job.to_string())
}

fn id(answer: &Answer) -> String {
    assert_eq!(answer.status, 201, "{answer:?}");
    answer.json()["id"].as_str().unwrap().to_owned()
}

#[test]
fn the_same_key_gives_the_same_job_over_stops_and_restarts() {
    let mut served = TestDaemon::start();
    served.status(&["estop", LEFT], 0);
    served.status(&["reset", LEFT, "--operator", "Ada", "--reason", "test"], 0);
    let first = send(&served, "one", "", &rest("one"));
    assert_eq!(first.header("idempotency-replayed"), None);
    let job = id(&first);
    assert_eq!(first.header("location"), Some(format!("/v1/jobs/{job}").as_str()));

    let again = |served: &TestDaemon| {
        let answer = send(served, "one", "", &rest("one"));
        assert_eq!((id(&answer), answer.header("idempotency-replayed")), (job.clone(), Some("true")));
        send(served, "one", "", &rest("two")).is_problem(422);
        send(served, "one", "?pace=max", &rest("one")).is_problem(422);
        assert_eq!(served.get("/v1/jobs")["jobs"].as_array().unwrap().len(), 1);
    };
    again(&served);
    served = served.again(|served| assert!(served.terminate().success()));
    again(&served);
    served = served.again(TestDaemon::kill);
    again(&served);
    served.status(&["estop", LEFT], 0);
    again(&served);
    send(&served, "new", "", &rest("one")).is_problem(409);
    for key in ["", "two words", "caf\u{e9}", &"k".repeat(256)] {
        send(&served, key, "", &rest("one")).is_problem(400);
    }
}

#[test]
fn key_is_recognized_after_a_configuration_change() {
    let served = TestDaemon::start();
    served.status(&["estop", LEFT], 0);
    served.status(&["reset", LEFT, "--operator", "Ada", "--reason", "test"], 0);
    let mut job = rest("one");
    job["plate"] = json!(LEFT);
    let first = id(&send(&served, "one", "", &job));
    let served = served.again(|served| {
        assert!(served.terminate().success());
        let mut config = config();
        config["plates"][0]["name"] = json!("near");
        config["default_plate"] = json!("near");
        config["pace"] = json!("max");
        fs::write(served.folder.path().join("daemon.json"), config.to_string()).unwrap();
    });
    let again = send(&served, "one", "", &job);
    assert_eq!((id(&again), again.header("idempotency-replayed")), (first, Some("true")));
    send(&served, "two", "", &job).is_problem(422);
}

#[test]
fn twenty_at_once_are_one_job() {
    let served = TestDaemon::start();
    served.submit(&moving("first", 600.0), "real-time");
    let ids: BTreeSet<String> = thread::scope(|scope| {
        let senders: Vec<_> = (0..20).map(|_| scope.spawn(|| id(&send(&served, "k", "", &rest("once"))))).collect();
        senders.into_iter().map(|sender| sender.join().unwrap()).collect()
    });
    assert_eq!(ids.len(), 1);
    assert_eq!(served.get("/v1/jobs")["jobs"].as_array().unwrap().len(), 2);
}
