use std::collections::BTreeSet;
use std::sync::atomic::Ordering;
use std::time::Duration;

use serde_json::{Value, json};
use tokio::time::timeout;

use super::fake::{HOLD, JOB, PLATE};
use super::{READING, TestApi, WORK, request};
use crate::api::Refusal;
use crate::http::{Reason, ReasonCode};
use upm_core::document::Diagnostic;

/// An operation of the OpenAPI document.
struct Operation {
    method: String,
    path: String,
    described: Value,
}

impl Operation {
    fn id(&self) -> &str {
        self.described["operationId"].as_str().unwrap()
    }

    /// The scope that it needs; empty without a token.
    fn scope(&self) -> &str {
        self.described["security"][0]["token"][0].as_str().unwrap_or_default()
    }

    fn good_status(&self) -> u16 {
        self.described["responses"].as_object().unwrap().keys().find_map(|status| status.parse().ok()).unwrap()
    }

    fn good_request(&self, headers: &[(&str, &str)]) -> axum::http::Request<axum::body::Body> {
        let path = self.path.replace("{id}", JOB).replace("{name}", PLATE);
        let body = match self.id() {
            "submit" | "check" => HOLD,
            "reset" => r#"{"operator": "A. Person", "reason": "looked at it"}"#,
            _ => "",
        };
        let headers: Vec<_> = headers.iter().copied().chain([("content-type", "application/json")]).collect();
        request(&self.method.to_uppercase(), &path, &headers, body)
    }
}

async fn document() -> Value {
    TestApi::new().get("/openapi.json").await.json()
}

async fn operations() -> Vec<Operation> {
    let document = document().await;
    let of_path = |(path, methods): (&String, &Value)| -> Vec<Operation> {
        let operation = |(method, described): (&String, &Value)| Operation {
            method: method.clone(),
            path: path.clone(),
            described: described.clone(),
        };
        methods.as_object().unwrap().iter().map(operation).collect()
    };
    document["paths"].as_object().unwrap().iter().flat_map(of_path).collect()
}

fn walk<'a>(value: &'a Value, visit: &mut impl FnMut(&'a Value)) {
    visit(value);
    match value {
        Value::Object(members) => members.values().for_each(|member| walk(member, visit)),
        Value::Array(items) => items.iter().for_each(|item| walk(item, visit)),
        _ => (),
    }
}

#[tokio::test]
async fn document_has_every_operation_and_every_reference_leads_somewhere() {
    let document = document().await;
    assert_eq!((&document["openapi"], &document["info"]["version"]), (&json!("3.1.0"), &json!("0.0.0")));
    let mut references = BTreeSet::new();
    walk(&document, &mut |value| references.extend(value.get("$ref").and_then(Value::as_str)));
    for reference in &references {
        assert!(document.pointer(reference.strip_prefix('#').unwrap()).is_some(), "{reference}");
    }
    for part in document["components"]["schemas"].as_object().unwrap().keys() {
        assert!(references.contains(format!("#/components/schemas/{part}").as_str()), "{part} is used nowhere");
    }
    let operations = operations().await;
    let ids: BTreeSet<&str> = operations.iter().map(Operation::id).collect();
    assert_eq!((operations.len(), ids.len()), (19, 19));
    for operation in &operations {
        let parameters = operation.described["parameters"].as_array().into_iter().flatten();
        let in_path = parameters.filter(|of| of["in"] == "path" && of["required"] == true).count();
        assert_eq!(in_path, operation.path.matches('{').count(), "{}", operation.path);
        let problem = &operation.described["responses"]["default"]["content"]["application/problem+json"]["schema"];
        assert_eq!(problem["$ref"], "#/components/schemas/ProblemDocument");
        let has_body = operation.described.get("requestBody").is_some();
        assert_eq!(has_body, ["submit", "check", "reset"].contains(&operation.id()), "{}", operation.id());
    }
    let submit = &document["paths"]["/v1/jobs"]["post"];
    let parameters = submit["parameters"].as_array().unwrap().iter();
    assert_eq!(parameters.map(|of| of["name"].clone()).collect::<Vec<_>>(), ["pace", "Idempotency-Key"]);
    let body = &submit["requestBody"]["content"]["application/json"]["schema"]["$ref"];
    let job = document.pointer(body.as_str().unwrap().trim_start_matches('#')).unwrap();
    let file = upm_runner::config::schema("job").unwrap();
    assert_eq!(job["required"], file["required"]);
    assert_eq!(job["properties"]["tolerance_mm"], file["properties"]["tolerance_mm"]);
}

#[tokio::test]
async fn every_operation_answers_with_its_success_status() {
    let asked = TestApi::new();
    for operation in operations().await {
        let seen = asked.ask(operation.good_request(&[])).await;
        assert_eq!(seen.status, operation.good_status(), "{}: {:?}", operation.id(), seen.body);
        assert_eq!(seen.header("x-request-id").len(), 32);
        assert_eq!(seen.header("x-content-type-options"), "nosniff");
        let answers = &operation.described["responses"][seen.status.to_string()]["content"];
        let medias = answers.as_object().into_iter().flat_map(|answers| answers.keys());
        assert_eq!(
            medias.collect::<Vec<_>>(),
            [seen.header("content-type")]
                .map(str::to_owned)
                .iter()
                .filter(|media| !media.is_empty())
                .collect::<Vec<_>>()
        );
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
    for operation in operations().await {
        let good_status = operation.good_status();
        let (none_or_wrong, with_reading) = match operation.scope() {
            "" => (good_status, good_status),
            "read" => (401, good_status),
            _ => (401, 403),
        };
        let table = [
            (None, none_or_wrong),
            (Some(&wrong), none_or_wrong),
            (Some(&reading), with_reading),
            (Some(&work), good_status),
        ];
        for (token, wanted) in table {
            let headers: Vec<_> = token.iter().map(|token| ("authorization", token.as_str())).collect();
            let seen = asked.ask(operation.good_request(&headers)).await;
            assert_eq!(seen.status, wanted, "{} with {token:?}", operation.id());
            assert_eq!(seen.header("www-authenticate").starts_with("Bearer"), [401, 403].contains(&seen.status));
            assert!(!String::from_utf8_lossy(&seen.body).contains(WORK));
        }
    }
    let calls = asked.backend.asked.lock().unwrap().clone();
    assert!(calls.contains(&"estop left by screen".to_owned()) && !calls.contains(&"estop left by local".to_owned()));
    assert!(calls.iter().filter(|line| line.starts_with("cancel")).all(|line| line.ends_with("by desk")), "{calls:?}");
}

#[tokio::test]
async fn other_methods_and_paths_are_refused() {
    let asked = TestApi::new();
    for (method, path, allowed) in
        [("PUT", "/v1/jobs", "POST"), ("BREW", "/healthz", "GET"), ("GET", "/v1/check", "POST")]
    {
        let seen = asked.ask(request(method, path, &[], "")).await;
        assert_eq!(seen.status, 405, "{method} {path}");
        assert!(seen.header("allow").split(',').any(|method| method == allowed), "{method} {path}");
    }
    for path in ["/v1", "/v1/jobs/", "/v2/jobs", "//v1/jobs", "/v1/plates/left", "/..%2f..%2fetc/passwd"] {
        assert_eq!(asked.get(path).await.status, 404, "{path}");
    }
}

#[tokio::test]
async fn refusals_become_their_problems() {
    let asked = TestApi::new();
    let faults = vec![Diagnostic::new("job", "seed", "\"x\"", "a whole number")];
    let table = [
        (Refusal::Malformed(faults.clone()), 400, ""),
        (Refusal::Invalid(faults.clone()), 422, ""),
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
    asked.backend.refuse(Refusal::Invalid(faults));
    let faults = asked.post("/v1/jobs", HOLD).await.json()["faults"].clone();
    assert_eq!(faults, json!([{"path": "seed", "found": "\"x\"", "allowed": "a whole number"}]));
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
        assert_eq!(json!(["store_hangs", "disk_low"]), Value::Array(codes));
    }
}

#[tokio::test]
async fn the_page_is_fenced_in_and_not_sent_twice() {
    let asked = TestApi::new();
    let seen = asked.get("/").await;
    let policy = seen.header("content-security-policy");
    assert!(policy.starts_with("default-src 'none'; script-src 'self'") && policy.contains("'self' http://*:8751;"));
    let again = asked.ask(request("GET", "/", &[("if-none-match", seen.header("etag"))], "")).await;
    assert_eq!((again.status, again.body.len()), (304, 0));
    for file in ["nothing.js", "..%2fCargo.toml", "%2e%2e", "a%00b", "%ff"] {
        assert_eq!(asked.get(&format!("/assets/{file}")).await.status, 404, "{file}");
    }
}
