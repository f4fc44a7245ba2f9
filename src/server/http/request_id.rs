use axum::extract::Request;
use axum::http::HeaderValue;
use axum::http::header::{CONTENT_LENGTH, HeaderName};
use axum::middleware::Next;
use axum::response::Response;
use uuid::Uuid;

use super::Problem;

static X_REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// The outermost layer: assigns the request an id (32 hex digits that sort by time) and writes it into the answer, its
/// problem document and the log. An id sent by the client is ignored: clients must not write log lines.
pub async fn identify(request: Request, next: Next) -> Response {
    let id = Uuid::now_v7().simple().to_string();
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let mut response = next.run(request).await;
    if let Some(problem) = response.extensions_mut().remove::<Problem>() {
        *response.body_mut() = problem.body(Some(&id));
        response.headers_mut().remove(CONTENT_LENGTH);
    }
    if let Ok(value) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(X_REQUEST_ID.clone(), value);
    }
    let status = response.status().as_u16();
    if is_alarming(&path, status) {
        tracing::warn!(request = id, %method, path, status, "request");
    } else {
        tracing::debug!(request = id, %method, path, status, "request");
    }
    response
}

/// True for answers that are logged as warnings. Failed health probes are not, since they come every few seconds.
fn is_alarming(path: &str, status: u16) -> bool {
    let is_probe = path == "/healthz" || path == "/readyz";
    status >= 500 && !(is_probe && status == 503)
}

#[cfg(test)]
mod tests {
    use axum::Router;
    use axum::body::Body;
    use axum::middleware::from_fn;
    use axum::routing::get;
    use http_body_util::BodyExt;
    use tower::ServiceExt;

    use super::*;
    use crate::http::{ProblemDocument, ProblemKind};

    #[test]
    fn failed_probe_is_not_logged_as_a_warning() {
        for (path, status, alarming) in [
            ("/readyz", 503, false),
            ("/healthz", 503, false),
            ("/readyz", 500, true),
            ("/v1/jobs", 503, true),
            ("/v1/jobs", 429, false),
            ("/readyz", 200, false),
        ] {
            assert_eq!(is_alarming(path, status), alarming, "{path} {status}");
        }
    }

    #[tokio::test]
    async fn a_problem_carries_the_name_of_its_request() {
        let app = Router::new()
            .route("/", get(|| async { Problem::new(ProblemKind::NotFound, "nothing here") }))
            .layer(from_fn(identify));
        let request = Request::get("/").header("x-request-id", "mine").body(Body::empty()).unwrap();
        let response = app.oneshot(request).await.unwrap();
        let id = response.headers()["x-request-id"].to_str().unwrap().to_owned();
        assert_eq!(id.len(), 32);
        let body = response.into_body().collect().await.unwrap().to_bytes();
        let document: ProblemDocument = serde_json::from_slice(&body).unwrap();
        assert_eq!(document.instance, Some(format!("urn:upm:request:{id}")));
    }
}
