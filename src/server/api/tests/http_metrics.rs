use super::fake::{HOLD, JOB};
use super::*;
use crate::api::{HttpMetrics, StreamStart};

/// The counters above zero.
fn counted(http_metrics: &HttpMetrics) -> Vec<(&'static str, u16, u64)> {
    let requests = http_metrics.requests().into_iter().filter(|requests| requests.count > 0);
    requests.map(|requests| (requests.operation, requests.status, requests.count)).collect()
}

#[tokio::test]
async fn answers_are_counted_by_operation_and_status() {
    let asked = TestApi::new();
    for _ in 0..3 {
        asked.post("/v1/jobs", HOLD).await;
    }
    asked.post("/v1/jobs", "{").await;
    asked.get(&format!("/v1/jobs/{JOB}")).await;
    asked.get("/v1/jobs/none").await;
    asked.get("/nothing").await;
    asked.post("/healthz", "").await;
    asked.ask(request("GET", "/healthz", &[("host", "evil.example")], "")).await;
    let expected = [("submit", 201, 3), ("submit", 400, 1), ("job", 200, 1), ("job", 404, 1)];
    let refused = [("none", 400, 1), ("none", 404, 1), ("none", 405, 1)];
    assert_eq!(counted(&asked.http_metrics), [&expected[..], &refused].concat());
}

#[tokio::test]
async fn number_of_counters_does_not_depend_on_requests() {
    let asked = TestApi::new();
    let before = asked.http_metrics.requests().len();
    for i in 0..50 {
        let odd = Request::builder().method(format!("M{i}").as_str()).uri(format!("/{i}"));
        asked.app.clone().oneshot(odd.header("host", "localhost").body(Body::empty()).unwrap()).await.unwrap();
    }
    assert_eq!(asked.http_metrics.requests().len(), before);
    assert_eq!(asked.http_metrics.requests().iter().map(|requests| requests.count).sum::<u64>(), 50);
}

#[tokio::test]
async fn an_event_stream_is_counted_while_it_is_open() {
    let asked = TestApi::new();
    *asked.backend.stream_start.lock().unwrap() =
        Some(StreamStart { snapshot: "{}".to_owned(), newest: 0, is_over: false });
    let open = || asked.open(request("GET", &format!("/v1/jobs/{JOB}/events"), &[], ""));
    let (first, second) = (open().await, open().await);
    assert_eq!(asked.http_metrics.event_streams(), 2);
    drop(first);
    assert_eq!(asked.http_metrics.event_streams(), 1);
    drop(second);
    assert_eq!(asked.http_metrics.event_streams(), 0);
}
