use std::collections::BTreeMap;
use std::sync::Arc;

use axum::Router;
use axum::extract::{FromRequestParts, Query as UrlQuery, RawPathParams, Request};
use axum::http::HeaderMap;
use axum::http::header::CONTENT_TYPE;
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};
use axum::routing::on;
use bytes::Bytes;

use super::operation::{Operation, ParamIn};
use super::query::QueryParams;
use super::request::{Api, RequestContext};
use crate::http::{Caller, Peer, Problem, ProblemKind, in_time, read_body};

/// The router of all `operations`.
pub(super) fn router(operations: Vec<Operation>, api: &Arc<Api>) -> Router {
    let mut router = Router::new();
    for operation in operations {
        let (path, filter) = (operation.path, operation.method.filter());
        let (operation, api) = (Arc::new(operation), api.clone());
        let handler = move |request: Request| {
            let (operation, api) = (operation.clone(), api.clone());
            async move { operation.answer(api, request).await.into_response() }
        };
        router = router.route(path, on(filter, handler));
    }
    router
        .fallback(async || Problem::new(ProblemKind::NotFound, "unknown path; see /openapi.json"))
        .method_not_allowed_fallback(async || {
            Problem::new(ProblemKind::MethodNotAllowed, "method not allowed; see the Allow header")
        })
}

impl Operation {
    async fn answer(&self, api: Arc<Api>, request: Request) -> Result<Response, Problem> {
        let (mut parts, body) = request.into_parts();
        let remote = parts.extensions.get::<Peer>().map(|peer| peer.0);
        let name = match self.scope {
            Some(scope) => api.tokens.admit(&parts.headers, scope)?,
            None => "anonymous".to_owned(),
        };
        let path = path_params(&mut parts).await?;
        let query = self.query(&parts)?;
        let body = match self.body {
            Some(_) => {
                demand_json(&parts.headers)?;
                read_body(body).await?
            }
            None => Bytes::new(),
        };
        let caller = Caller { name, remote };
        let (backend, headers) = (api.backend.clone(), parts.headers);
        let call = RequestContext { backend, api: api.clone(), caller, headers, query, body, path };
        in_time(self.handler.answer(call)).await
    }

    fn query(&self, parts: &Parts) -> Result<QueryParams, Problem> {
        let pairs = UrlQuery::<Vec<(String, String)>>::try_from_uri(&parts.uri)
            .map_err(|_| Problem::new(ProblemKind::Malformed, "the query cannot be read"))?;
        let known: Vec<&str> = self.params.iter().filter(|p| p.location == ParamIn::Query).map(|p| p.name).collect();
        QueryParams::new(pairs.0, &known)
    }
}

/// Parameters in the path; a path that cannot be decoded is not found.
async fn path_params(parts: &mut Parts) -> Result<BTreeMap<String, String>, Problem> {
    let params = RawPathParams::from_request_parts(parts, &()).await;
    let params = params.map_err(|_| Problem::new(ProblemKind::NotFound, "the path is not UTF-8 text"))?;
    Ok(params.iter().map(|(name, value)| (name.to_owned(), value.to_owned())).collect())
}

/// Demands the content type of JSON, since forms of other sites cannot send it.
fn demand_json(headers: &HeaderMap) -> Result<(), Problem> {
    let mut types = headers.get_all(CONTENT_TYPE).iter();
    let given = match (types.next(), types.next()) {
        (Some(value), None) => value.to_str().unwrap_or_default(),
        _ => "",
    };
    let mut parts = given.split(';').map(str::trim);
    let is_json = parts.next().is_some_and(|media| media.eq_ignore_ascii_case("application/json"));
    let is_utf8 =
        parts.all(|part| ["charset=utf-8", "charset=\"utf-8\"", ""].iter().any(|p| part.eq_ignore_ascii_case(p)));
    if is_json && is_utf8 {
        return Ok(());
    }
    Err(Problem::new(ProblemKind::UnsupportedMediaType, "the body must come as `Content-Type: application/json`"))
}
