//! Emergency stops past the API: the socket in the data folder, SIGUSR1, and the listener for stops alone.

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::daemon_process::{LEFT, RIGHT, TestDaemon, config, moving, until};
use super::http::{ask, connect};

/// Answer of the socket to this line.
fn said(served: &TestDaemon, line: &str) -> Value {
    let mut socket = UnixStream::connect(served.folder.path().join("data/estop.sock")).unwrap();
    socket.write_all(line.as_bytes()).unwrap();
    let mut text = String::new();
    socket.read_to_string(&mut text).unwrap();
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn estop_through_the_socket_stops_a_running_job_and_holds_over_a_restart() {
    let served = TestDaemon::start();
    let job = served.submit(&moving("moving", 600.0), "max");
    served.until_moving("moving", &job);
    let data = served.folder.path().join("data");
    let (stdout, stderr) = served.status(&["estop", LEFT, "--json", "--data", data.to_str().unwrap()], 0);
    let stops: Value = serde_json::from_str(&stdout).unwrap();
    let stop = &stops["stops"][0];
    assert_eq!((&stop["via"], &stop["plate"]), (&"socket".into(), &LEFT.into()), "{stdout}{stderr}");
    assert_eq!((&stop["answer"]["silent"], &stop["answer"]["persisted"]), (&true.into(), &true.into()), "{stdout}");
    assert_eq!(served.plate(RIGHT)["state"], "idle");
    let served = served.again(TestDaemon::kill);
    assert_eq!(served.plate(LEFT)["state"], "stopped");
    assert_eq!(said(&served, "\n")["stops"].as_array().unwrap().len(), 2, "the socket was replaced, and stops all");
    assert_eq!(served.plate(RIGHT)["state"], "stopped");
}

#[test]
fn socket_belongs_to_the_daemons_user_and_goes_with_the_daemon() {
    let mut served = TestDaemon::start();
    let socket = served.folder.path().join("data/estop.sock");
    assert_eq!(fs::metadata(&socket).unwrap().permissions().mode() & 0o777, 0o600);
    assert!(served.terminate().success());
    assert!(!socket.exists());
}

#[test]
fn socket_stops_nothing_when_it_is_asked_for_nothing_that_there_is() {
    let served = TestDaemon::start();
    for line in ["stop\n", "{\"plates\": [\"left\"], \"port\": 1}\n", "{\"plate\": \"left\"}\n"] {
        let answer = said(&served, line);
        assert!(answer["error"].is_string() && answer["stops"] == Value::Array(Vec::new()), "{line}: {answer}");
    }
    assert_eq!([LEFT, RIGHT].map(|name| served.plate(name)["state"].clone()), ["idle", "idle"]);
    let answer = said(&served, "{\"plates\": [\"nowhere\", \"left\"]}\n");
    assert_eq!(
        (&answer["error"], &answer["stops"][0]["plate"]),
        (&"expected one of left, right, found \"nowhere\"".into(), &LEFT.into())
    );
    assert_eq!([LEFT, RIGHT].map(|name| served.plate(name)["state"].clone()), ["stopped", "idle"]);
}

#[test]
fn plate_beside_an_unknown_name_is_stopped_through_the_socket() {
    let served = TestDaemon::start();
    let data = served.folder.path().join("data");
    let args = ["estop", LEFT, "nowhere", "--json", "--data", data.to_str().unwrap(), "--url", "http://127.0.0.1:9"];
    let (stdout, stderr) = served.status(&args, 2);
    assert!(stdout.contains("\"socket\"") && stderr.contains("nowhere: NOT STOPPED"), "{stdout}{stderr}");
    assert_eq!(served.plate(LEFT)["state"], "stopped");
}

#[test]
fn estop_without_a_socket_goes_over_http() {
    let served = TestDaemon::start();
    let nowhere = served.folder.path().join("nowhere");
    let args = ["estop", LEFT, "--json", "--data", nowhere.to_str().unwrap()];
    let (stdout, stderr) = served.status(&args, 0);
    assert!(stdout.contains("\"http\"") && stderr.contains("estop.sock"), "{stdout}{stderr}");
    assert_eq!(served.plate(LEFT)["state"], "stopped");
}

#[test]
fn sigusr1_stops_every_plate() {
    let served = TestDaemon::start();
    let job = served.submit(&moving("moving", 600.0), "max");
    served.until_moving("moving", &job);
    served.signal("-USR1");
    for name in [LEFT, RIGHT] {
        until("the plate is stopped", || (served.plate(name)["state"] == "stopped").then_some(()));
    }
    until("the stops are logged", || (served.log().matches("stopped by SIGUSR1").count() == 2).then_some(()));
}

#[test]
fn stop_listener_stops_every_plate_while_silent_connections_take_all_of_the_api() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let mut config = config();
    config["stop_listen"] = free.as_str().into();
    let served = TestDaemon::with(&config);
    ask(&free, "GET", "/v1/estop", &[], b"").is_problem(405);
    ask(&free, "POST", "/v1/jobs", &[], b"").is_problem(404);
    ask(&free, "POST", "/v1/estop", &[("Origin", "http://evil.example")], b"").is_problem(403);
    assert_eq!(served.plate(LEFT)["state"], "idle");
    // more than the API serves at once
    let silent: Vec<TcpStream> = (0..560).map(|_| connect(served.address())).collect();
    let asked_at = Instant::now();
    let answer = ask(&free, "POST", "/v1/estop", &[], b"");
    assert!(asked_at.elapsed() < Duration::from_secs(2), "{:?}", asked_at.elapsed());
    assert_eq!(answer.status, 200);
    let stops = answer.json()["stops"].clone();
    assert!(stops.as_array().unwrap().iter().all(|stop| stop["persisted"] == true), "{stops}");
    let nowhere = served.folder.path().join("nowhere");
    let args = ["estop", "--stop-url", &format!("http://{free}"), "--json", "--data", nowhere.to_str().unwrap()];
    let (stops, _) = served.status(&args, 0);
    assert!(stops.contains(LEFT) && stops.contains(RIGHT) && stops.contains("\"http\""), "{stops}");
    drop(silent);
    let nobody = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let args = ["estop", "--stop-url", &format!("http://{nobody}"), "--data", nowhere.to_str().unwrap()];
    served.status(&args, 0);
    let page = served.get("/v1/plates");
    assert_eq!(page["stop_listen"], free);
    assert_eq!([LEFT, RIGHT].map(|name| served.plate(name)["state"].clone()), ["stopped", "stopped"]);
}
