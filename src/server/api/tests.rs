mod contract;
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
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

use super::{AppParts, EVENT_STREAMS, app};
use crate::http::{AllowedHosts, ProblemDocument, Scope, Tokens};
use fake::FakeBackend;

const READING: &str = "look-look-look-look-look-look-look";
const WORK: &str = "work-work-work-work-work-work-work";

/// The API in front of a fake backend.
struct TestApi {
    app: Router,
    backend: Arc<FakeBackend>,
    stop: CancellationToken,
    event_streams: Arc<Semaphore>,
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
        let (stop, event_streams) = (CancellationToken::new(), Arc::new(Semaphore::new(EVENT_STREAMS)));
        let parts = AppParts {
            backend: backend.clone(),
            tokens: Arc::new(tokens),
            hosts,
            stop: stop.clone(),
            event_streams: event_streams.clone(),
            stop_port: Some(8751),
            version: "0.0.0",
        };
        Self { app: app(parts), backend, stop, event_streams }
    }

    async fn open(&self, request: Request<Body>) -> (u16, HeaderMap, Body) {
        let (parts, body) = self.app.clone().oneshot(request).await.unwrap().into_parts();
        (parts.status.as_u16(), parts.headers, body)
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
