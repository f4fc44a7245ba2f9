use serde_json::json;

use super::fake::{HOLD, JOB, NO_JOB};
use super::{TestApi, request};

#[tokio::test]
async fn non_utf8_bodies_are_a_problem() {
    let asked = TestApi::new();
    let json = [("content-type", "application/json")];
    for path in ["/v1/jobs", "/v1/plates/left/reset"] {
        let seen = asked.ask(request("POST", path, &json, b"{\"name\": \"\xff\xfe\"}".to_vec())).await;
        assert_eq!(seen.status, 400);
        let fault = json!({"path": "$", "found": "a byte that is not UTF-8 at offset 10", "allowed": "UTF-8 text"});
        assert_eq!(seen.json()["faults"], json!([fault]));
    }
}

#[tokio::test]
async fn only_json_is_read() {
    let asked = TestApi::new();
    for media in [
        "",
        "text/plain",
        "application/x-www-form-urlencoded",
        "application/jsonx",
        "application/json, text/plain",
        "application/problem+json",
    ] {
        let seen = asked.ask(request("POST", "/v1/jobs", &[("content-type", media)], HOLD)).await;
        assert_eq!(seen.status, 415, "{media}");
    }
    assert_eq!(asked.ask(request("POST", "/v1/jobs", &[], HOLD)).await.status, 415);
}

#[tokio::test]
async fn body_over_the_size_limit_is_refused() {
    let asked = TestApi::new();
    let most = 1 << 20;
    let padded = format!("{HOLD}{}", " ".repeat(most - HOLD.len()));
    assert_eq!(asked.post("/v1/jobs", &padded).await.status, 201);
    assert_eq!(asked.post("/v1/jobs", &format!("{padded} ")).await.status, 413);
}

#[tokio::test]
async fn unknown_and_invalid_queries_are_refused() {
    let asked = TestApi::new();
    for (query, path, allowed) in [
        ("limit=0", "limit", "a whole number from 1 to 200"),
        ("limit=x", "limit", "a whole number from 1 to 200"),
        ("limit=-1", "limit", "a whole number from 1 to 200"),
        ("limit=1&limit=1", "limit", "each key once"),
        ("cursor=../../x", "cursor", "a string of 32 characters or null"),
        ("state=done", "state", "one of queued, running, completed, failed, cancelled, interrupted"),
        ("sort=1", "sort", "one of cursor, limit, state"),
    ] {
        let seen = asked.get(&format!("/v1/jobs?{query}")).await;
        assert_eq!(seen.status, 400, "{query}");
        let faults = &seen.json()["faults"];
        assert_eq!((&faults[0]["path"], &faults[0]["allowed"]), (&json!(path), &json!(allowed)), "{query}");
        assert_eq!(faults.as_array().unwrap().len(), 1, "{query}");
    }
    for query in ["", "limit=200", "state=queued", &format!("cursor={NO_JOB}&limit=1")] {
        assert_eq!(asked.get(&format!("/v1/jobs?{query}")).await.status, 200, "{query}");
    }
    assert_eq!(asked.get("/v1/jobs?cursor=%ff").await.status, 400);
    assert_eq!(asked.post("/v1/jobs?pace=fast", HOLD).await.status, 400);
    assert_eq!(asked.get("/healthz?x=%ff").await.status, 200);
    assert_eq!(asked.post("/v1/plates/left/estop?now", "").await.status, 200);
}

#[tokio::test]
async fn invalid_headers_are_refused() {
    let asked = TestApi::new();
    let long = "k".repeat(256);
    for key in ["", "two words", "\u{e9}", &long] {
        let headers = [("content-type", "application/json"), ("idempotency-key", key)];
        assert_eq!(asked.ask(request("POST", "/v1/jobs", &headers, HOLD)).await.status, 400, "{key:?}");
    }
    for id in ["", "x", "-1", "+1", " 1", "1.0", "9999999999999999999", "\u{e9}"] {
        let seen = asked.ask(request("GET", &format!("/v1/jobs/{JOB}/events"), &[("last-event-id", id)], "")).await;
        assert_eq!(seen.status, 400, "{id:?}");
    }
}

#[tokio::test]
async fn reset_requires_operator_and_reason() {
    let asked = TestApi::new();
    let long = format!(r#"{{"operator": "{}", "reason": "y"}}"#, "x".repeat(201));
    for (body, status) in [
        ("", 400),
        ("{", 400),
        (r#"{"operator": "x", "reason": "y"} z"#, 400),
        (&"[".repeat(1000), 400),
        ("null", 422),
        (r#"{"operator": "x"}"#, 422),
        (r#"{"operator": "", "reason": "y"}"#, 422),
        (r#"{"operator": "x", "reason": " \t\n"}"#, 422),
        (r#"{"operator": 1, "reason": "y"}"#, 422),
        (r#"{"operator": "x", "reason": "y", "force": true}"#, 422),
        (r#"{"operator": "x", "operator": "x", "reason": "y"}"#, 422),
        (&long, 422),
    ] {
        let seen = asked.post("/v1/plates/left/reset", body).await;
        assert_eq!(seen.status, status, "{body}: {:?}", seen.body);
        assert_eq!(seen.json()["faults"].as_array().unwrap().len(), 1);
    }
    assert!(asked.backend.asked.lock().unwrap().is_empty());
}
