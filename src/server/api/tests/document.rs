use std::collections::BTreeSet;

use serde_json::Value;

use super::TestApi;
use crate::api::{openapi, routes};

fn document(version: &str) -> Value {
    openapi::document(&routes::operations(), version)
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
async fn every_reference_leads_somewhere_and_every_part_is_used() {
    let document = TestApi::new().get("/openapi.json").await.json();
    assert_eq!(document["openapi"], "3.1.0");
    let mut references = BTreeSet::new();
    walk(&document, &mut |value| references.extend(value.get("$ref").and_then(Value::as_str)));
    assert!(references.len() > 20);
    for reference in &references {
        let pointer = reference.strip_prefix('#').unwrap();
        assert!(document.pointer(pointer).is_some(), "{reference}");
    }
    for part in document["components"]["schemas"].as_object().unwrap().keys() {
        assert!(references.contains(format!("#/components/schemas/{part}").as_str()), "{part} is used nowhere");
    }
    assert!(!document.to_string().contains("$defs"));
}

#[test]
fn routes_and_document_are_one() {
    let document = document("1.2.3");
    assert_eq!(document["info"]["version"], "1.2.3");
    let mut documented = BTreeSet::new();
    for (path, methods) in document["paths"].as_object().unwrap() {
        for (method, operation) in methods.as_object().unwrap() {
            documented.insert((method.clone(), path.clone()));
            let of_path: BTreeSet<&str> =
                path.split('/').filter_map(|step| step.strip_prefix('{')?.strip_suffix('}')).collect();
            let parameters = operation["parameters"].as_array().unwrap();
            let declared: BTreeSet<&str> = parameters
                .iter()
                .filter(|parameter| parameter["in"] == "path" && parameter["required"] == true)
                .map(|parameter| parameter["name"].as_str().unwrap())
                .collect();
            assert_eq!(of_path, declared, "{method} {path}");
            assert_eq!(
                operation.get("requestBody").is_some(),
                ["submit", "check", "reset"].contains(&operation["operationId"].as_str().unwrap())
            );
        }
    }
    let routes = routes::operations();
    let of_routes: BTreeSet<_> = routes.iter().map(|row| (row.method.name().to_owned(), row.path.to_owned())).collect();
    assert_eq!(of_routes, documented);
    let ids: BTreeSet<&str> = routes.iter().map(|row| row.id).collect();
    assert_eq!((ids.len(), of_routes.len()), (routes.len(), routes.len()));
}

#[test]
fn document_contains_the_contract() {
    let document = document("0");
    for (path, method) in [
        ("/v1/jobs", "post"),
        ("/v1/jobs", "get"),
        ("/v1/jobs/{id}", "get"),
        ("/v1/jobs/{id}/run-next", "post"),
        ("/v1/jobs/{id}/cancel", "post"),
        ("/v1/jobs/{id}/events", "get"),
        ("/v1/jobs/{id}/recording", "get"),
        ("/v1/jobs/{id}/frame.png", "get"),
        ("/v1/plates", "get"),
        ("/v1/plates/{name}/estop", "post"),
        ("/v1/plates/{name}/reset", "post"),
        ("/v1/plates/{name}/resume", "post"),
        ("/healthz", "get"),
        ("/readyz", "get"),
        ("/metrics", "get"),
        ("/", "get"),
    ] {
        assert!(document["paths"][path][method].is_object(), "{method} {path}");
    }
    let submit = &document["paths"]["/v1/jobs"]["post"];
    let statuses: Vec<&str> = submit["responses"].as_object().unwrap().keys().map(String::as_str).collect();
    let wanted =
        ["201", "400", "401", "403", "408", "409", "413", "414", "415", "422", "429", "431", "500", "503", "507"];
    assert_eq!(statuses, wanted);
    let body = &submit["requestBody"]["content"]["application/json"]["schema"]["$ref"];
    let job = document.pointer(body.as_str().unwrap().trim_start_matches('#')).unwrap();
    let mut file = upm_runner::config::schema("job").unwrap();
    let file = file.as_object_mut().unwrap();
    assert_eq!(job["required"], file["required"]);
    assert_eq!(job["properties"]["tolerance_mm"], file["properties"]["tolerance_mm"]);
    let state = &document["components"]["schemas"]["Job"]["properties"];
    for key in ["id", "name", "state", "plate", "submitted_at", "started_at", "finished_at", "progress", "report"] {
        assert!(state[key].is_object(), "{key}");
    }
}
