use serde_json::json;

use super::{REST, TestApi, request};

const NO_JOB: &str = "019a0000000070008000000000000002";

#[test]
fn non_utf8_bodies_are_a_problem() {
    let api = TestApi::new();
    let json = [("content-type", "application/json")];
    for path in ["/v1/jobs", "/v1/plates/upm-1/reset"] {
        let seen = api.ask(request("POST", path, &json, b"{\"name\": \"\xff\xfe\"}".to_vec()));
        assert_eq!(seen.status, 400);
        let fault = json!({"path": "$", "found": "a byte that is not UTF-8 at offset 10", "allowed": "UTF-8 text"});
        assert_eq!(seen.json()["faults"], json!([fault]));
    }
}

#[test]
fn only_json_is_read() {
    let api = TestApi::new();
    let others = "text/plain|application/x-www-form-urlencoded|application/jsonx|application/json, text/plain|\
        application/problem+json|";
    for media in others.split('|') {
        let seen = api.ask(request("POST", "/v1/jobs", &[("content-type", media)], REST));
        assert_eq!(seen.status, 415, "{media}");
    }
    assert_eq!(api.ask(request("POST", "/v1/jobs", &[], REST)).status, 415);
}

#[test]
fn body_over_the_size_limit_is_refused() {
    let api = TestApi::new();
    let most = 1 << 20;
    let padded = format!("{REST}{}", " ".repeat(most - REST.len()));
    assert_eq!(api.post("/v1/jobs", &padded).status, 201);
    assert_eq!(api.post("/v1/jobs", &format!("{padded} ")).status, 413);
}

#[test]
fn unknown_and_invalid_queries_are_refused() {
    let api = TestApi::new();
    for (query, path, allowed) in [
        ("limit=0", "limit", "a whole number from 1 to 200"),
        ("limit=x", "limit", "a whole number from 1 to 200"),
        ("limit=-1", "limit", "a whole number from 1 to 200"),
        ("limit=1&limit=1", "limit", "each key once"),
        ("cursor=../../x", "cursor", "a string of 32 characters or null"),
        ("state=done", "state", "one of queued, running, completed, failed, cancelled, interrupted"),
        ("sort=1", "sort", "one of cursor, limit, plate, state"),
    ] {
        let seen = api.get(&format!("/v1/jobs?{query}"));
        assert_eq!(seen.status, 400, "{query}");
        let faults = &seen.json()["faults"];
        assert_eq!((&faults[0]["path"], &faults[0]["allowed"]), (&json!(path), &json!(allowed)), "{query}");
        assert_eq!(faults.as_array().unwrap().len(), 1, "{query}");
    }
    for query in ["", "limit=200", "state=queued&plate=upm-1", &format!("cursor={NO_JOB}&limit=1")] {
        assert_eq!(api.get(&format!("/v1/jobs?{query}")).status, 200, "{query}");
    }
    assert_eq!(api.get("/v1/jobs?cursor=%ff").status, 400);
    assert_eq!(api.post("/v1/jobs?pace=fast", REST).status, 400);
    assert_eq!(api.get("/healthz?x=%ff").status, 200);
    assert_eq!(api.post("/v1/plates/upm-1/estop?now", "").status, 200);
}

#[test]
fn invalid_headers_are_refused() {
    let api = TestApi::new();
    let long = "k".repeat(256);
    for key in ["", "two words", "\u{e9}", &long] {
        let headers = [("content-type", "application/json"), ("idempotency-key", key)];
        assert_eq!(api.ask(request("POST", "/v1/jobs", &headers, REST)).status, 400, "{key:?}");
    }
    for id in ["", "x", "-1", "+1", " 1", "1.0", "9999999999999999999", "\u{e9}"] {
        let seen = api.ask(request("GET", &format!("/v1/jobs/{NO_JOB}/events"), &[("last-event-id", id)], ""));
        assert_eq!(seen.status, 400, "{id:?}");
    }
}

#[test]
fn reset_requires_operator_and_reason() {
    let api = TestApi::new();
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
        let seen = api.post("/v1/plates/upm-1/reset", body);
        assert_eq!(seen.status, status, "{body}: {:?}", seen.body);
        assert_eq!(seen.json()["faults"].as_array().unwrap().len(), 1);
    }
}
