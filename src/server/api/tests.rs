mod contract;
mod document;
mod fake;
mod input;
mod recordings;
mod streams;

use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Request};
use bytes::Bytes;
use http_body_util::BodyExt;
use serde_json::Value;
use tokio::sync::Semaphore;
use tower::ServiceExt;

use super::operation::{MediaType, Operation};
use super::{AppParts, EVENT_STREAMS, app, routes};
use crate::http::{AllowedHosts, ProblemDocument, Scope, ShutdownSender, ShutdownSignal, Tokens};
use fake::FakeBackend;

const READING: &str = "look-look-look-look-look-look-look";
const WORK: &str = "work-work-work-work-work-work-work";

/// The API in front of a fake backend. Every answer is checked against the row of its operation.
struct TestApi {
    app: Router,
    backend: Arc<FakeBackend>,
    stop: ShutdownSender,
}

struct ApiAnswer {
    status: u16,
    headers: HeaderMap,
    body: Bytes,
}

impl TestApi {
    fn new() -> Self {
        Self::with(Tokens::default())
    }

    fn with_tokens() -> Self {
        let mut tokens = Tokens::default();
        tokens.add("desk", WORK, Scope::Operate).unwrap();
        tokens.add("screen", READING, Scope::Read).unwrap();
        Self::with(tokens)
    }

    fn with(tokens: Tokens) -> Self {
        let backend = Arc::new(FakeBackend::default());
        let hosts = AllowedHosts::new("127.0.0.1:8750".parse().unwrap(), &[]);
        let (stop, flag) = ShutdownSignal::new();
        let parts = AppParts {
            backend: backend.clone(),
            tokens: Arc::new(tokens),
            hosts,
            stop: flag,
            event_streams: Arc::new(Semaphore::new(EVENT_STREAMS)),
            version: "0.0.0",
        };
        Self { app: app(parts), backend, stop }
    }

    async fn open(&self, request: Request<Body>) -> (u16, HeaderMap, Body) {
        let operation = operation_of(request.method().as_str(), request.uri().path());
        let (parts, body) = self.app.clone().oneshot(request).await.unwrap().into_parts();
        let status = parts.status.as_u16();
        if let Some(operation) = operation {
            assert_documented(&operation, status, &parts.headers);
        }
        (status, parts.headers, body)
    }

    async fn ask(&self, request: Request<Body>) -> ApiAnswer {
        let (status, headers, body) = self.open(request).await;
        let body = body.collect().await.unwrap().to_bytes();
        if status >= 400 {
            let document: ProblemDocument = serde_json::from_slice(&body).unwrap();
            assert_eq!(document.status, status);
            assert!(document.kind.starts_with("urn:upm:problem:") && document.instance.is_some(), "{document:?}");
        }
        ApiAnswer { status, headers, body }
    }

    async fn get(&self, path: &str) -> ApiAnswer {
        self.ask(request("GET", path, &[], "")).await
    }

    async fn post(&self, path: &str, body: &str) -> ApiAnswer {
        self.ask(request("POST", path, &[("content-type", "application/json")], body.to_owned())).await
    }
}

impl ApiAnswer {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }

    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }
}

fn request(method: &str, path: &str, headers: &[(&str, &str)], body: impl Into<Body>) -> Request<Body> {
    let builder = Request::builder().method(method).uri(path).header("host", "localhost:8750");
    let builder = headers.iter().fold(builder, |builder, (name, value)| builder.header(*name, *value));
    builder.body(body.into()).unwrap()
}

/// The operation that a request is routed to.
fn operation_of(method: &str, path: &str) -> Option<Operation> {
    let fits = |template: &str| {
        let (wanted, given): (Vec<&str>, Vec<&str>) = (template.split('/').collect(), path.split('/').collect());
        let one = |(wanted, given): (&&str, &&str)| wanted == given || (wanted.starts_with('{') && !given.is_empty());
        wanted.len() == given.len() && wanted.iter().zip(&given).all(one)
    };
    routes::operations()
        .into_iter()
        .find(|operation| operation.method.name().eq_ignore_ascii_case(method) && fits(operation.path))
}

fn assert_documented(operation: &Operation, status: u16, headers: &HeaderMap) {
    let id = operation.id;
    let media = headers.get("content-type").map_or("", |value| value.to_str().unwrap());
    if let Some(answer) = operation.answers.iter().find(|answer| answer.status == status) {
        match answer.content {
            MediaType::Nothing => assert_eq!(media, "", "{id} {status}"),
            MediaType::Json(_) => assert_eq!(media, "application/json", "{id} {status}"),
            MediaType::Media("*/*") => assert!(!media.is_empty(), "{id} {status}"),
            MediaType::Media(documented) => assert!(media.starts_with(documented), "{id} {status}: {media}"),
        }
        let known = |name: &str| answer.headers.iter().any(|(known, _)| known.eq_ignore_ascii_case(name));
        assert!(!headers.contains_key("location") || known("location"), "{id} {status}");
    } else {
        let problems: Vec<u16> = operation.all_problems().iter().map(|kind| kind.status().as_u16()).collect();
        assert!(problems.contains(&status), "{id} answers {status}, which its row does not say: {problems:?}");
        assert_eq!(media, "application/problem+json", "{id} {status}");
    }
}
