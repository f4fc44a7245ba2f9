use serde_json::json;

use super::fake::{HOLD, JOB, NO_JOB};
use super::{TestApi, request};

#[tokio::test]
async fn invalid_job_is_a_problem() {
    let asked = TestApi::new();
    let deep = "[".repeat(100_000);
    let deep_member = format!("{}1{}", "{\"name\":".repeat(5000), "}".repeat(5000));
    for (body, status) in [
        ("", 400),
        (&HOLD[..HOLD.len() - 1], 400),
        (&HOLD[..20], 400),
        (&deep, 400),
        (&deep_member, 400),
        ("{\"name\": \"\\ud800\"}", 400),
        ("NaN", 400),
        ("1e999", 400),
        ("{} {}", 400),
        ("\u{feff}{}", 400),
        ("null", 422),
        ("[]", 422),
        ("7", 422),
        ("\"job\"", 422),
        ("{}", 422),
        (r#"{"name": 3, "parts": {}, "task": []}"#, 422),
        (r#"{"name": "../x", "parts": [{"kind": "penny"}], "task": {"type": "hold", "duration_s": 1}}"#, 422),
        (
            r#"{"name": "x", "rig": "/etc/passwd", "parts": [{"kind": "penny"}], "task": {"type": "hold", "duration_s": 1}}"#,
            422,
        ),
        (r#"{"name": "x", "name": "y", "parts": [{"kind": "penny"}], "task": {"type": "hold", "duration_s": 1}}"#, 422),
    ] {
        let seen = asked.post("/v1/jobs", body).await;
        let short: String = body.chars().take(60).collect();
        assert_eq!(seen.status, status, "{short}: {:?}", seen.body);
        let faults = seen.json()["faults"].as_array().unwrap().clone();
        assert!(!faults.is_empty() && faults.iter().all(|fault| fault["path"] != "" && fault["allowed"] != ""));
    }
    assert!(asked.backend.asked.lock().unwrap().is_empty(), "nothing of it was queued");
}

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
        "multipart/form-data; boundary=x",
        "application/jsonx",
        "application/json; charset=latin1",
        "application/json, text/plain",
        "application/problem+json",
    ] {
        let seen = asked.ask(request("POST", "/v1/jobs", &[("content-type", media)], HOLD)).await;
        assert_eq!(seen.status, 415, "{media}");
    }
    assert_eq!(asked.ask(request("POST", "/v1/jobs", &[], HOLD)).await.status, 415);
    let twice = [("content-type", "application/json"), ("content-type", "application/json")];
    assert_eq!(asked.ask(request("POST", "/v1/jobs", &twice, HOLD)).await.status, 415);
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
async fn unknown_names_are_not_found() {
    let asked = TestApi::new();
    let long = "0".repeat(2000);
    let upper = JOB.to_uppercase();
    let ids = [
        "x",
        "..%2f..%2fetc%2fpasswd",
        "%2e%2e",
        "%00",
        "%ff%fe",
        "%F0%9F%92%A5",
        &long,
        &upper,
        NO_JOB,
        "1;DROP",
        "*",
    ];
    for id in ids {
        for path in ["", "/events", "/recording", "/frame.png"] {
            assert_eq!(asked.get(&format!("/v1/jobs/{id}{path}")).await.status, 404, "{id}{path}");
        }
        for action in ["run-next", "cancel"] {
            assert_eq!(asked.post(&format!("/v1/jobs/{id}/{action}"), "").await.status, 404, "{id}");
        }
        assert_eq!(asked.post(&format!("/v1/plates/{id}/estop"), "").await.status, 404, "{id}");
        assert_eq!(asked.post(&format!("/v1/plates/{id}/resume"), "").await.status, 404, "{id}");
        let reset = r#"{"operator": "x", "reason": "y"}"#;
        assert_eq!(asked.post(&format!("/v1/plates/{id}/reset"), reset).await.status, 404, "{id}");
    }
    let calls = asked.backend.asked.lock().unwrap().clone();
    assert!(calls.iter().all(|line| !line.contains("..") && !line.contains('\0') && !line.contains('/')), "{calls:?}");
}

#[tokio::test]
async fn unknown_and_invalid_queries_are_refused() {
    let asked = TestApi::new();
    for query in ["limit=0", "limit=x", "cursor=../../x", "cursor=%ff", "state=done", "sort=1", "limit=1&limit=1", "&="]
    {
        let seen = asked.get(&format!("/v1/jobs?{query}")).await;
        assert_eq!(seen.status, 400, "{query}");
        assert_eq!(seen.json()["faults"].as_array().unwrap().len(), 1, "{query}");
    }
    for query in ["", "limit=200", "state=queued", &format!("cursor={NO_JOB}&limit=1")] {
        assert_eq!(asked.get(&format!("/v1/jobs?{query}")).await.status, 200, "{query}");
    }
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
        (&"[".repeat(1000), 422),
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
