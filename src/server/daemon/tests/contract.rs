use std::collections::BTreeSet;
use std::sync::LazyLock;

use serde_json::{Value, json};

use super::{REST, TestApi, request};

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
}

fn document() -> &'static Value {
    static DOCUMENT: LazyLock<Value> = LazyLock::new(|| TestApi::new().get("/openapi.json").json());
    &DOCUMENT
}

fn operations() -> Vec<Operation> {
    let document = document();
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

#[test]
fn document_has_every_operation_and_every_reference_leads_somewhere() {
    let document = document();
    assert_eq!((&document["openapi"], &document["info"]["version"]), (&json!("3.1.0"), &json!("0.0.0")));
    let mut references = BTreeSet::new();
    walk(document, &mut |value| references.extend(value.get("$ref").and_then(Value::as_str)));
    for reference in &references {
        assert!(document.pointer(reference.strip_prefix('#').unwrap()).is_some(), "{reference}");
    }
    for part in document["components"]["schemas"].as_object().unwrap().keys() {
        assert!(references.contains(format!("#/components/schemas/{part}").as_str()), "{part} is used nowhere");
    }
    let operations = operations();
    let ids: BTreeSet<&str> = operations.iter().map(Operation::id).collect();
    assert_eq!((operations.len(), ids.len()), (20, 20));
    for operation in &operations {
        let parameters = operation.described["parameters"].as_array().into_iter().flatten();
        let in_path = parameters.filter(|of| of["in"] == "path" && of["required"] == true).count();
        assert_eq!(in_path, operation.path.matches('{').count(), "{}", operation.path);
        let problem = &operation.described["responses"]["default"]["content"]["application/problem+json"]["schema"];
        assert_eq!(problem["$ref"], "#/components/schemas/ProblemDocument");
        let has_body = operation.described.get("requestBody").is_some();
        assert_eq!(has_body, ["submit", "check", "dry-run", "reset"].contains(&operation.id()), "{}", operation.id());
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

#[test]
fn answers_are_of_the_documented_type() {
    let api = TestApi::new();
    let get = |operation: &&Operation| operation.method == "get" && !operation.path.contains('{');
    for operation in operations().iter().filter(get) {
        let seen = api.get(&operation.path);
        assert_eq!(seen.status, 200, "{}: {:?}", operation.id(), seen.body);
        assert_eq!(seen.header("x-request-id").len(), 32);
        assert_eq!(seen.header("x-content-type-options"), "nosniff");
        let documented = operation.described["responses"]["200"]["content"].as_object().unwrap();
        assert_eq!(documented.keys().collect::<Vec<_>>(), [seen.header("content-type")]);
    }
}

#[test]
fn page_and_api_are_served_below_the_base_path_alone() {
    let api = TestApi::with(|spec| spec.base_path = "/lab/upm".to_owned());
    assert_eq!(api.get("/lab/upm/openapi.json").json()["servers"], json!([{"url": "/lab/upm"}]));
    assert_eq!((api.get("/lab/upm/").status, api.get("/lab/upm/assets/app.js").status), (200, 200));
    let bare = api.get("/lab/upm");
    assert_eq!((bare.status, bare.header("location")), (307, "/lab/upm/"));
    let seen = api.post("/lab/upm/v1/jobs?pace=max", REST);
    let address = format!("/lab/upm/v1/jobs/{}", seen.json()["id"].as_str().unwrap());
    assert_eq!((seen.status, seen.header("location")), (201, address.as_str()));
    assert_eq!((api.get(&address).status, api.get(&format!("{address}/layout/")).status), (200, 404));
    for path in ["/", "/v1/jobs", "/healthz", "/lab/upm/v1", "/lab/upmv1/jobs"] {
        assert_eq!(api.get(path).status, 404, "{path}");
    }
}

#[test]
fn other_methods_and_paths_are_refused() {
    let api = TestApi::new();
    for (method, path, allowed) in
        [("PUT", "/v1/jobs", "POST"), ("BREW", "/healthz", "GET"), ("GET", "/v1/check", "POST")]
    {
        let seen = api.ask(request(method, path, &[], ""));
        assert_eq!(seen.status, 405, "{method} {path}");
        assert!(seen.header("allow").split(',').any(|method| method == allowed), "{method} {path}");
    }
    for path in ["/v1", "/v1/jobs/", "/v2/jobs", "//v1/jobs", "/v1/plates/upm-1", "/..%2f..%2fetc/passwd"] {
        assert_eq!(api.get(path).status, 404, "{path}");
    }
}

#[test]
fn submission_returns_location_and_replayed_headers() {
    let api = TestApi::new();
    let submit = |key: &str| {
        let headers = [("content-type", "application/json; charset=UTF-8"), ("idempotency-key", key)];
        api.ask(request("POST", "/v1/jobs?pace=max", &headers, REST))
    };
    let seen = submit("k");
    let id = seen.json()["id"].clone();
    assert_eq!((seen.status, seen.header("location")), (201, format!("/v1/jobs/{}", id.as_str().unwrap()).as_str()));
    assert_eq!(seen.header("idempotency-replayed"), "");
    let seen = submit("k");
    assert_eq!((seen.status, seen.header("idempotency-replayed"), &seen.json()["id"]), (201, "true", &id));
    let headers = [("content-type", "application/json"), ("idempotency-key", "k")];
    assert_eq!(api.ask(request("POST", "/v1/jobs", &headers, REST)).status, 422, "another pace is another job");
}

#[test]
fn health_reports_its_reasons() {
    let api = TestApi::new();
    assert_eq!(api.get("/readyz").json(), json!({"ok": true}));
    api.daemon.plates.iter().for_each(|plate| assert!(plate.estop()));
    let seen = api.get("/readyz");
    let why = "an emergency stop holds on every plate";
    assert_eq!((seen.status, &seen.json()["detail"]), (503, &json!(why)));
    assert_eq!(seen.json()["reasons"], json!([{"code": "all_stopped", "detail": why}]));
    assert_eq!(api.get("/healthz").json(), json!({"ok": true}));
}

#[test]
fn the_page_is_fenced_in_and_not_sent_twice() {
    let api = TestApi::new();
    let seen = api.get("/");
    let policy = seen.header("content-security-policy");
    assert!(policy.starts_with("default-src 'none'; script-src 'self'") && policy.contains("; base-uri"));
    let again = api.ask(request("GET", "/", &[("if-none-match", seen.header("etag"))], ""));
    assert_eq!((again.status, again.body.len()), (304, 0));
    for file in ["nothing.js", "..%2fCargo.toml", "%2e%2e", "a%00b", "%ff"] {
        assert_eq!(api.get(&format!("/assets/{file}")).status, 404, "{file}");
    }
}
