//! Authorisation: the token that each route requires.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

use super::daemon_process::{LEFT, TestDaemon, config, rest, serve, until};
use super::http::exchange;

const OPERATE: &str = "operate-0123456789abcdef0123456789abcdef";
const READ: &str = "readonly-0123456789abcdef0123456789abcdef";

/// Method, path and required token: none, one to read, or one to operate.
const ROUTES: [(&str, &str, Needs); 20] = [
    ("GET", "/healthz", Needs::Nothing),
    ("GET", "/readyz", Needs::Nothing),
    ("GET", "/", Needs::Nothing),
    ("GET", "/v1/jobs", Needs::Read),
    ("GET", "/v1/jobs/ID", Needs::Read),
    ("GET", "/v1/jobs/ID/events", Needs::Read),
    ("GET", "/v1/jobs/ID/recording", Needs::Read),
    ("GET", "/v1/jobs/ID/frame.png", Needs::Read),
    ("GET", "/v1/jobs/ID/layout", Needs::Read),
    ("GET", "/v1/plates", Needs::Read),
    ("GET", "/metrics", Needs::Read),
    ("GET", "/openapi.json", Needs::Read),
    ("POST", "/v1/plates/nowhere/estop", Needs::Read),
    ("POST", "/v1/jobs", Needs::Operate),
    ("POST", "/v1/check", Needs::Operate),
    ("POST", "/v1/dry-run", Needs::Operate),
    ("POST", "/v1/jobs/ID/run-next", Needs::Operate),
    ("POST", "/v1/jobs/ID/cancel", Needs::Operate),
    ("DELETE", "/v1/jobs/ID", Needs::Operate),
    ("POST", "/v1/plates/nowhere/resume", Needs::Operate),
];

#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Needs {
    Nothing,
    Read,
    Operate,
}

/// Writes a file that only its owner may read.
fn secret(path: &Path, text: &str) {
    fs::write(path, text).unwrap();
    fs::set_permissions(path, fs::Permissions::from_mode(0o600)).unwrap();
}

fn guarded() -> TestDaemon {
    let folder = TempDir::new().unwrap();
    let file = |name: &str, token: &str| {
        let path = folder.path().join(name);
        secret(&path, &format!("{token}\n"));
        path
    };
    let mut config = config();
    config["token_file"] = file("operate", OPERATE).to_str().unwrap().into();
    config["read_token_file"] = file("read", READ).to_str().unwrap().into();
    fs::write(folder.path().join("daemon.json"), config.to_string()).unwrap();
    TestDaemon::in_folder(folder)
}

#[test]
fn every_route_asks_for_its_token() {
    let served = guarded();
    let cut = OPERATE[..OPERATE.len() - 1].to_owned();
    let shown: [(Option<String>, Needs); 6] = [
        (None, Needs::Nothing),
        (Some("Bearer wrong-0123456789abcdef0123456789abcdef".to_owned()), Needs::Nothing),
        (Some(format!("Bearer {cut}")), Needs::Nothing),
        (Some(format!("Basic {OPERATE}")), Needs::Nothing),
        (Some(format!("Bearer {READ}")), Needs::Read),
        (Some(format!("Bearer {OPERATE}")), Needs::Operate),
    ];
    for (method, path, needs) in ROUTES {
        let path = path.replace("ID", &"0".repeat(32));
        for (token, may) in &shown {
            let mut headers = vec![("Content-Type", "application/json")];
            headers.extend(token.as_ref().map(|token| ("Authorization", token.as_str())));
            let status = served.ask(method, &path, &headers, if method == "POST" { "{}" } else { "" }).status;
            let expected = match (needs, *may) {
                (Needs::Nothing, _) => !matches!(status, 401 | 403),
                (_, Needs::Nothing) => status == 401,
                (Needs::Operate, Needs::Read) => status == 403,
                _ => matches!(status, 200 | 400 | 404 | 409 | 422),
            };
            assert!(expected, "{method} {path} with {token:?}: {status}");
        }
    }
    let log = fs::read_to_string(served.folder.path().join("log")).unwrap();
    assert!(![OPERATE, READ, &cut].iter().any(|token| log.contains(token)), "tokens are never logged: {log}");
}

#[test]
fn commands_show_their_token_and_a_reader_may_stop() {
    let served = guarded();
    let write = |name: &str, text: &str| {
        let path = served.folder.path().join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let (operate, read) = (write("operate", OPERATE), write("read", &format!("{READ}\n")));
    let job = write("job.json", &rest("rest").to_string());
    let (_, stderr) = served.status(&["jobs"], 2);
    assert!(stderr.contains("UPM_TOKEN_FILE"), "{stderr}");
    served.status(&["jobs", "--token-file", &read], 0);
    served.status(&["submit", &job, "--token-file", &read], 2);
    served.status(&["submit", &job, "--pace", "max", "--watch", "--token-file", &operate], 0);
    assert!(served.upm(&["plates"]).env("UPM_TOKEN_FILE", &read).output().unwrap().status.success());
    served.status(&["estop", LEFT, "--token-file", &read], 0);
    served.status(&["reset", LEFT, "--operator", "A", "--reason", "r", "--token-file", &read], 2);
    served.status(&["reset", LEFT, "--operator", "A", "--reason", "r", "--token-file", &operate], 0);
    let is_reset = |line: &str| line.contains(" reset ") && line.contains("token_name=\"operate\"");
    until("the reset is logged with its token's name", || served.log().lines().any(is_reset).then_some(()));
    served.status(&["jobs", "--token-file", &write("empty", "")], 2);
}

#[test]
fn pages_and_names_of_others_are_refused_even_on_loopback() {
    let served = TestDaemon::start();
    let estop = format!("/v1/plates/{LEFT}/estop");
    for (name, value) in [("Origin", "http://evil.example"), ("Origin", "null"), ("Sec-Fetch-Site", "cross-site")] {
        served.ask("POST", &estop, &[(name, value)], "").is_problem(403);
    }
    let rebound =
        format!("POST {estop} HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\nContent-Length: 0\r\n\r\n");
    exchange(served.address(), rebound.as_bytes()).is_problem(403);
    assert_ne!(served.plate(LEFT)["state"], "stopped");
    let origin = served.url.clone();
    assert_eq!(served.ask("POST", &estop, &[("Origin", &origin)], "").status, 200);
    assert_eq!(served.plate(LEFT)["state"], "stopped");
}

#[test]
fn non_loopback_listener_requires_token() {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("daemon.json"), config().to_string()).unwrap();
    let refused = |command: &mut Command| {
        let status = command.output().unwrap().status;
        let log = fs::read_to_string(folder.path().join("log")).unwrap();
        assert_eq!(status.code(), Some(2), "{log}");
        assert_eq!(log.lines().count(), 1, "{log}");
        assert!(log.contains("token"), "{log}");
        fs::remove_file(folder.path().join("log")).unwrap();
    };
    for listen in ["0.0.0.0:0", "[::]:0"] {
        refused(&mut serve(folder.path(), listen));
        refused(serve(folder.path(), listen).arg("--check"));
    }
    assert!(!folder.path().join("data").exists(), "a daemon that does not start leaves nothing");
    let mut short = config();
    short["token_file"] = "short".into();
    secret(&folder.path().join("short"), "short");
    fs::write(folder.path().join("daemon.json"), short.to_string()).unwrap();
    refused(&mut serve(folder.path(), "127.0.0.1:0"));
}
