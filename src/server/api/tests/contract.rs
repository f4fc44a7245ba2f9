use std::sync::atomic::Ordering;
use std::time::Duration;

use serde_json::json;
use tokio::time::timeout;

use super::fake::{HOLD, JOB, PLATE};
use super::{READING, TestApi, WORK, request};
use crate::api::operation::{HttpMethod, Operation};
use crate::api::{Refusal, routes};
use crate::http::{Reason, ReasonCode, Scope};

fn path_of(operation: &Operation) -> String {
    operation.path.replace("{id}", JOB).replace("{name}", PLATE).replace("{file}", "index.html")
}

fn body_of(operation: &Operation) -> &'static str {
    match operation.id {
        "submit" | "check" => HOLD,
        "reset" => r#"{"operator": "A. Person", "reason": "looked at it"}"#,
        _ => "",
    }
}

fn good(operation: &Operation, headers: &[(&str, &str)]) -> axum::http::Request<axum::body::Body> {
    let json = ("content-type", "application/json");
    let headers: Vec<_> = headers.iter().copied().chain(operation.body.map(|_| json)).collect();
    request(&operation.method.name().to_uppercase(), &path_of(operation), &headers, body_of(operation))
}

#[tokio::test]
async fn every_operation_answers_with_its_success_status() {
    let asked = TestApi::new();
    for operation in routes::operations() {
        let seen = asked.ask(good(&operation, &[])).await;
        assert_eq!(seen.status, operation.answers[0].status, "{}: {:?}", operation.id, seen.body);
        assert_eq!(seen.header("x-request-id").len(), 32);
        assert_eq!(seen.header("x-content-type-options"), "nosniff");
    }
    let calls = asked.backend.asked.lock().unwrap().clone();
    assert!(calls.contains(&"reset left by A. Person: looked at it".to_owned()), "{calls:?}");
    assert!(calls.contains(&"submit None".to_owned()) && calls.contains(&"jobs 50".to_owned()), "{calls:?}");
}

#[tokio::test]
async fn tokens_grant_only_their_scope() {
    let asked = TestApi::with_tokens();
    let (reading, work) = (format!("Bearer {READING}"), format!("Bearer {WORK}"));
    let wrong = format!("Bearer {WORK}x");
    for operation in routes::operations() {
        let good_status = operation.answers[0].status;
        let (none_or_wrong, with_reading) = match operation.scope {
            None => (good_status, good_status),
            Some(Scope::Read) => (401, good_status),
            Some(Scope::Operate) => (401, 403),
        };
        let table = [
            (None, none_or_wrong),
            (Some(&wrong), none_or_wrong),
            (Some(&reading), with_reading),
            (Some(&work), good_status),
        ];
        for (token, wanted) in table {
            let headers: Vec<_> = token.iter().map(|token| ("authorization", token.as_str())).collect();
            let seen = asked.ask(good(&operation, &headers)).await;
            assert_eq!(seen.status, wanted, "{} with {token:?}", operation.id);
            assert_eq!(seen.header("www-authenticate").starts_with("Bearer"), [401, 403].contains(&seen.status));
            assert!(!String::from_utf8_lossy(&seen.body).contains(WORK));
        }
    }
    let calls = asked.backend.asked.lock().unwrap().clone();
    assert!(calls.contains(&"estop left by screen".to_owned()) && !calls.contains(&"estop left by local".to_owned()));
    assert!(calls.iter().filter(|line| line.starts_with("cancel")).all(|line| line.ends_with("by desk")), "{calls:?}");
}

#[tokio::test]
async fn other_methods_are_refused_and_the_right_ones_named() {
    let asked = TestApi::new();
    for operation in routes::operations() {
        let knows = |method: HttpMethod| {
            routes::operations().iter().any(|other| other.path == operation.path && other.method == method)
        };
        for method in ["DELETE", "PUT", "PATCH", "OPTIONS", "TRACE", "BREW"] {
            if method == "DELETE" && knows(HttpMethod::Delete) {
                continue;
            }
            let seen = asked.ask(request(method, &path_of(&operation), &[], "")).await;
            assert_eq!(seen.status, 405, "{method} {}", operation.path);
            let name = operation.method.name().to_uppercase();
            assert!(seen.header("allow").split(',').any(|allowed| allowed == name), "{method} {}", operation.path);
        }
        let head = request("HEAD", &path_of(&operation), &[], "");
        let (status, ..) = asked.open(head).await;
        let wanted = if knows(HttpMethod::Get) { 200 } else { 405 };
        assert_eq!(status, wanted, "HEAD {}", operation.path);
    }
    for path in ["/v1", "/v1/jobs/", "/v2/jobs", "/V1/jobs", "//v1/jobs", "/v1/plates/left", "/..%2f..%2fetc/passwd"] {
        assert_eq!(asked.get(path).await.status, 404, "{path}");
    }
}

#[tokio::test]
async fn refusals_become_their_problems() {
    let asked = TestApi::new();
    let table = [
        (Refusal::Conflict("stopped".to_owned()), 409, ""),
        (Refusal::KeyReused, 422, ""),
        (Refusal::QueueFull { queued: 64, retry_after_s: 30 }, 429, "30"),
        (Refusal::Busy { why: "checking others".to_owned(), retry_after_s: 1 }, 503, "1"),
        (Refusal::DiskFull("the disk is full".to_owned()), 507, ""),
        (Refusal::Broken("the store is damaged".to_owned()), 500, ""),
    ];
    for (refusal, status, retry_after) in table {
        asked.backend.refuse(refusal);
        let seen = asked.post("/v1/jobs", HOLD).await;
        assert_eq!((seen.status, seen.header("retry-after")), (status, retry_after));
    }
    for (refusal, status) in
        [(Refusal::Conflict("it has ended".to_owned()), 409), (Refusal::DiskFull("the disk is full".to_owned()), 507)]
    {
        asked.backend.refuse(refusal);
        assert_eq!(asked.post(&format!("/v1/jobs/{JOB}/cancel"), "").await.status, status);
    }
}

#[tokio::test]
async fn plates_are_listed_while_the_store_hangs_or_refuses() {
    let asked = TestApi::new();
    let queued = async || asked.get("/v1/plates").await.json()["plates"][0]["queued"].clone();
    assert_eq!(queued().await, json!(0));
    asked.backend.hangs.store(true, Ordering::Relaxed);
    assert_eq!(queued().await, json!(7), "as counted before");
    asked.backend.hangs.store(false, Ordering::Relaxed);
    asked.backend.refuse(Refusal::Busy { why: "the job store is busy".to_owned(), retry_after_s: 1 });
    assert_eq!(queued().await, json!(7));
}

#[tokio::test]
async fn picture_has_its_age_in_a_header() {
    let seen = TestApi::new().get(&format!("/v1/jobs/{JOB}/frame.png")).await;
    assert_eq!((seen.status, seen.header("upm-age-ms")), (200, "12"));
}

#[tokio::test]
async fn submission_returns_location_and_replayed_headers() {
    let asked = TestApi::new();
    let seen = asked.post("/v1/jobs?pace=max", HOLD).await;
    assert_eq!((seen.status, seen.header("location")), (201, format!("/v1/jobs/{JOB}").as_str()));
    assert_eq!(seen.header("idempotency-replayed"), "");
    assert_eq!(*asked.backend.asked.lock().unwrap(), ["submit Some(Max)"]);
    let headers = [("content-type", "application/json; charset=UTF-8"), ("idempotency-key", "again")];
    let seen = asked.ask(request("POST", "/v1/jobs", &headers, HOLD)).await;
    assert_eq!((seen.status, seen.header("idempotency-replayed")), (201, "true"));
    assert_eq!(seen.json()["id"], JOB);
}

#[tokio::test]
async fn emergency_stop_reaches_the_plate_before_any_wait() {
    let asked = TestApi::new();
    let answer = asked.ask(request("POST", "/v1/plates/endless/estop", &[], ""));
    assert!(timeout(Duration::from_millis(20), answer).await.is_err(), "the confirmation does not come");
    assert_eq!(*asked.backend.asked.lock().unwrap(), ["estop endless"]);
}

#[tokio::test]
async fn health_reports_every_failure() {
    let asked = TestApi::new();
    assert_eq!(asked.get("/healthz").await.json(), json!({"ok": true}));
    let reasons = [(ReasonCode::StoreHangs, "the store hangs"), (ReasonCode::DiskLow, "no room")];
    *asked.backend.failures.lock().unwrap() = reasons.map(|(code, detail)| Reason::new(code, detail)).into();
    for path in ["/healthz", "/readyz"] {
        let seen = asked.get(path).await;
        assert_eq!((seen.status, &seen.json()["detail"]), (503, &json!("the store hangs; no room")));
        let codes = seen.json()["reasons"].as_array().unwrap().iter().map(|reason| reason["code"].clone()).collect();
        assert_eq!(json!(["store_hangs", "disk_low"]), serde_json::Value::Array(codes));
    }
}

#[tokio::test]
async fn the_page_is_fenced_in_and_not_sent_twice() {
    let asked = TestApi::new();
    let seen = asked.get("/").await;
    assert!(seen.header("content-security-policy").starts_with("default-src 'none'; script-src 'self'"));
    let again = asked.ask(request("GET", "/", &[("if-none-match", seen.header("etag"))], "")).await;
    assert_eq!((again.status, again.body.len()), (304, 0));
    for file in ["nothing.js", "..%2fCargo.toml", "%2e%2e", "a%00b", "%ff"] {
        assert_eq!(asked.get(&format!("/assets/{file}")).await.status, 404, "{file}");
    }
}
