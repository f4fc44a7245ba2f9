//! Invalid requests are answered with their fault, and the plate continues undisturbed.

use std::io::{Read, Write};
use std::net::TcpStream;

use serde_json::json;

use super::daemon_process::{LEFT, TestDaemon, moving, rest};
use super::http::{Answer, ask, connect, exchange, head, read};

const JSON: [(&str, &str); 1] = [("Content-Type", "application/json")];

#[test]
fn bad_requests_are_answered_and_the_plate_goes_on_undisturbed() {
    let served = TestDaemon::start();
    let id = served.submit(&moving("undisturbed", 600.0), "real-time");
    served.until_moving("undisturbed", &id);
    let (slow, mut in_body) = slow_writers(&served);
    bodies(&served);
    addresses(&served, &id);
    methods_and_types(&served, &id);
    heads(&served);
    assert_closed(slow);
    read(&mut in_body).is_problem(408);
    assert_eq!(served.job(&id)["state"], "running");
    served.status(&["cancel", &id], 0);
    served.until_state(&id, "cancelled");
    let run = served.run_folder("undisturbed");
    let (verified, _) = served.status(&["verify", run.to_str().unwrap()], 0);
    assert!(verified.contains("equal byte for byte up to there"), "the journal of an undisturbed run: {verified}");
    let jobs = served.get("/v1/jobs");
    assert_eq!(jobs["jobs"].as_array().unwrap().len(), 1, "nothing wrong was kept: {jobs}");
    assert_eq!(served.get("/healthz"), json!({"ok": true}));
}

fn post(served: &TestDaemon, body: &[u8]) -> Answer {
    ask(served.address(), "POST", "/v1/jobs", &JSON, body)
}

fn bodies(served: &TestDaemon) {
    let good = rest("rest").to_string();
    let deep = format!("{{\"name\": {}1{}}}", "[".repeat(100_000), "]".repeat(100_000));
    let half = &good.as_bytes()[..good.len() / 2];
    for malformed in [half, b"", b"{\"name\": \"\xe9\"}", b"{} {}", b"\0", deep.as_bytes()] {
        post(served, malformed).is_problem(400);
    }
    for invalid in ["{}", "[]", "null", "1", "{\"name\": \"..\"}", "{\"name\": \"a\", \"name\": \"b\"}"] {
        let answer = post(served, invalid.as_bytes());
        answer.is_problem(422);
        assert!(!answer.json()["faults"].as_array().unwrap().is_empty(), "{answer:?}");
    }
    let mut files = rest("files");
    files["rig"] = json!("/etc/passwd");
    files["library"] = json!("../../etc/shadow");
    let answer = post(served, files.to_string().as_bytes());
    answer.is_problem(422);
    assert!(!String::from_utf8(answer.body).unwrap().contains("root:"));

    let large = vec![b' '; (1 << 20) + 1];
    post(served, &large).is_problem(413);
    let (start, bytes) = (head(served.address(), "POST", "/v1/jobs", &JSON), large.len());
    let chunked = [
        format!("{start}Transfer-Encoding: chunked\r\n\r\n{bytes:x}\r\n").into_bytes(),
        large,
        b"\r\n0\r\n\r\n".to_vec(),
    ]
    .concat();
    exchange(served.address(), &chunked).is_problem(413);
    let unsent = head(served.address(), "POST", "/v1/jobs", &JSON) + "Content-Length: 99999999999\r\n\r\n{";
    exchange(served.address(), unsent.as_bytes()).is_problem(413);
    let plate = |body: &str| ask(served.address(), "POST", &format!("/v1/plates/{LEFT}/reset"), &JSON, body.as_bytes());
    plate("{").is_problem(400);
    plate("{\"operator\": \"\", \"reason\": \"r\"}").is_problem(422);
}

fn addresses(served: &TestDaemon, id: &str) {
    let get = |path: &str| served.ask("GET", path, &[], "");
    let unknown = "0".repeat(32);
    for id in [unknown.as_str(), "x", "..", "%2e%2e", "..%2f..%2fetc%2fpasswd", "%00", &"a".repeat(2000), "%ff"] {
        for tail in ["", "/events", "/recording", "/frame.png", "/layout"] {
            get(&format!("/v1/jobs/{id}{tail}")).is_problem(404);
        }
        served.ask("POST", &format!("/v1/plates/{id}/estop"), &[], "").is_problem(404);
    }
    for path in ["/v2/jobs", "/v1", "//", "/assets/..%2fdaemon.json", "/assets/%2e%2e/daemon.json", "/../daemon.json"] {
        get(path).is_problem(404);
    }
    for query in
        ["limit=0", "limit=x", "limit=201", "cursor=x", "cursor=..", "state=done", "sort=up", "limit=1&limit=2"]
    {
        get(&format!("/v1/jobs?{query}")).is_problem(400);
    }
    get(&format!("/v1/jobs?cursor={}", "x".repeat(5000))).is_problem(400);
    for last in ["-1", "x", "", "99999999999999999999"] {
        served.ask("GET", &format!("/v1/jobs/{id}/events"), &[("Last-Event-ID", last)], "").is_problem(400);
    }
}

fn methods_and_types(served: &TestDaemon, id: &str) {
    for (method, path) in
        [("DELETE", "/v1/jobs"), ("PUT", "/v1/plates"), ("PATCH", "/healthz"), ("GET", "/v1/plates/left/estop")]
    {
        let answer = served.ask(method, path, &[], "");
        answer.is_problem(405);
        assert!(answer.header("allow").is_some(), "{answer:?}");
    }
    let body = rest("rest").to_string();
    for kind in ["text/plain", "application/x-www-form-urlencoded", "application/jsonp", ""] {
        served.ask("POST", "/v1/jobs", &[("Content-Type", kind)], &body).is_problem(415);
    }
    served.ask("POST", "/v1/jobs", &[], &body).is_problem(415);
    served.ask("GET", &format!("/v1/jobs/{id}/recording"), &[("Range", "bytes=0-1")], "").is_problem(409);
}

fn heads(served: &TestDaemon) {
    let large = "x".repeat(20 << 10);
    assert_eq!(served.ask("GET", "/v1/jobs", &[("X-Large", &large)], "").status, 431);
    let many: Vec<(&str, &str)> = (0..80).map(|_| ("X-Many", "1")).collect();
    assert_eq!(served.ask("GET", "/v1/jobs", &many, "").status, 431);
    let address = served.address();
    exchange(address, b"GET /v1/jobs HTTP/1.1\r\n\r\n").is_problem(400);
    let twice = format!("GET /v1/jobs HTTP/1.1\r\nHost: {address}\r\nHost: {address}\r\n\r\n");
    exchange(address, twice.as_bytes()).is_problem(400);
    for garbage in ["\x16\x03\x01\x02\0", "GET\r\n\r\n", "NONSENSE\r\n\r\n"] {
        assert_eq!(exchange(address, format!("{garbage}\r\n\r\n").as_bytes()).status, 400, "{garbage:?}");
    }
}

/// Connections of clients that stall in the middle of a header, and of one that stalls in the middle of a body; another
/// client disconnects there.
fn slow_writers(served: &TestDaemon) -> (Vec<TcpStream>, TcpStream) {
    let body = head(served.address(), "POST", "/v1/jobs", &JSON) + "Content-Length: 100\r\n\r\n{";
    connect(served.address()).write_all(body.as_bytes()).unwrap();
    let begin = |start: &str| {
        let mut stream = connect(served.address());
        stream.write_all(start.as_bytes()).unwrap();
        stream
    };
    (["", "GET", "GET /v1/jobs HTT", "POST /v1/jobs HTTP/1.1\r\nHost: "].map(begin).into(), begin(&body))
}

/// Asserts that the connections were closed without an answer.
fn assert_closed(slow: Vec<TcpStream>) {
    for mut stream in slow {
        assert_eq!(stream.read_to_end(&mut Vec::new()).unwrap_or(0), 0);
    }
}
