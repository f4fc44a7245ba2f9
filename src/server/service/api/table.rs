use std::collections::BTreeMap;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;

use axum::Router;
use axum::extract::{FromRequestParts, Query as UrlQuery, RawPathParams, Request};
use axum::http::header::CONTENT_TYPE;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodFilter, MethodRouter, on};
use bytes::Bytes;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Serialize;

use super::cursor::{Query, is_job_id};
use super::traffic::Reached;
use super::{Api, Desk};
use crate::service::http::{Caller, Peer, Problem, ProblemKind, Scope};
use upm_runner::config::is_plain_name;

/// How an operation is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    Get,
    Post,
}

impl Method {
    pub fn name(self) -> &'static str {
        match self {
            Self::Get => "get",
            Self::Post => "post",
        }
    }

    fn filter(self) -> MethodFilter {
        match self {
            Self::Get => MethodFilter::GET,
            Self::Post => MethodFilter::POST,
        }
    }
}

/// Where a parameter stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    Path,
    Query,
    Header,
}

/// A parameter of an operation.
pub(super) struct Param {
    pub name: &'static str,
    pub place: Place,
    pub what: &'static str,
    /// Its JSON Schema.
    pub schema: fn() -> serde_json::Value,
}

/// Makes the schema of a type and leaves its parts with the generator.
pub(super) type SchemaOf = fn(&mut SchemaGenerator) -> Schema;

pub(super) fn schema_of<T: JsonSchema>(generator: &mut SchemaGenerator) -> Schema {
    generator.subschema_for::<T>()
}

/// What an answer holds.
#[derive(Clone, Copy)]
pub(super) enum Content {
    Nothing,
    Json(SchemaOf),
    /// Text or bytes of this media type.
    Media(&'static str),
}

/// A good answer of an operation. Bad ones are all problem documents.
pub(super) struct Answer {
    pub status: u16,
    pub what: &'static str,
    pub content: Content,
    /// Names and meanings of its headers.
    pub headers: &'static [(&'static str, &'static str)],
}

/// What a handler has to go on.
pub(super) struct Call {
    pub desk: Arc<dyn Desk>,
    pub api: Arc<Api>,
    pub caller: Caller,
    pub headers: HeaderMap,
    pub query: Query,
    pub body: Bytes,
    path: BTreeMap<String, String>,
}

impl Call {
    /// The job in the path. What cannot be an id is no job's.
    pub fn job_id(&self) -> Result<&str, Problem> {
        let id = self.path.get("id").map_or("", String::as_str);
        is_job_id(id).then_some(id).ok_or_else(|| Problem::new(ProblemKind::NotFound, "there is no such job"))
    }

    /// The plate in the path. What cannot be a name is no plate's.
    pub fn plate(&self) -> Result<&str, Problem> {
        let name = self.path.get("name").map_or("", String::as_str);
        is_plain_name(name).then_some(name).ok_or_else(|| Problem::new(ProblemKind::NotFound, "there is no such plate"))
    }

    /// The file of the operator page in the path.
    pub fn file(&self) -> &str {
        self.path.get("file").map_or("", String::as_str)
    }
}

pub(super) type Outcome = Pin<Box<dyn Future<Output = Result<Response, Problem>> + Send>>;

/// One thing that can be asked of the daemon: all that router and document have to know of it.
pub(super) struct Operation {
    /// Its name in the document.
    pub id: &'static str,
    pub method: Method,
    pub path: &'static str,
    /// What a token must allow; `None` for what is open to all who get through the guard.
    pub scope: Option<Scope>,
    pub what: &'static str,
    pub params: &'static [Param],
    /// Schema of the JSON body, where there is one.
    pub body: Option<SchemaOf>,
    pub answers: &'static [Answer],
    /// Problems of its own, beside those of the layers.
    pub problems: &'static [ProblemKind],
    pub handler: fn(Call) -> Outcome,
}

impl Operation {
    /// Every problem it can be answered with: its own, and those of what a request passes on its way to the handler.
    pub fn all_problems(&self) -> Vec<ProblemKind> {
        use ProblemKind as P;
        let mut kinds = vec![P::Malformed, P::Forbidden, P::UriTooLong, P::HeaderTooLarge, P::Internal, P::Unavailable];
        kinds.extend(self.scope.map(|_| P::Unauthorized));
        kinds.extend(self.body.iter().flat_map(|_| [P::RequestTimeout, P::ContentTooLarge, P::UnsupportedMediaType]));
        kinds.extend(self.has_path_params().then_some(P::NotFound));
        kinds.extend(self.problems);
        ProblemKind::ALL.into_iter().filter(|kind| kinds.contains(kind)).collect()
    }

    fn has_path_params(&self) -> bool {
        self.params.iter().any(|param| param.place == Place::Path)
    }

    async fn answer(&self, api: Arc<Api>, request: Request) -> Result<Response, Problem> {
        let (mut parts, body) = request.into_parts();
        let remote = parts.extensions.get::<Peer>().map(|peer| peer.0);
        let name = match self.scope {
            Some(scope) => api.tokens.admit(&parts.headers, scope, remote)?,
            None => "anonymous".to_owned(),
        };
        let path = path_params(&mut parts).await?;
        let query = self.query(&parts)?;
        // the room is held until the request is answered
        let (body, _room) = match self.body {
            Some(_) => {
                demand_json(&parts.headers)?;
                let (bytes, room) = api.limits.read_body(&parts.headers, body).await?;
                (bytes, Some(room))
            }
            None => (Bytes::new(), None),
        };
        let caller = Caller { name, remote };
        let (desk, headers) = (api.desk.clone(), parts.headers);
        let call = Call { desk, api: api.clone(), caller, headers, query, body, path };
        api.limits.in_time((self.handler)(call)).await
    }

    fn query(&self, parts: &Parts) -> Result<Query, Problem> {
        let pairs = UrlQuery::<Vec<(String, String)>>::try_from_uri(&parts.uri)
            .map_err(|_| Problem::new(ProblemKind::Malformed, "the query cannot be read"))?;
        let known: Vec<&str> = self.params.iter().filter(|p| p.place == Place::Query).map(|p| p.name).collect();
        Query::new(pairs.0, &known)
    }
}

/// What cannot be decoded names nothing.
async fn path_params(parts: &mut Parts) -> Result<BTreeMap<String, String>, Problem> {
    let params = RawPathParams::from_request_parts(parts, &()).await;
    let params = params.map_err(|_| Problem::new(ProblemKind::NotFound, "the path is not UTF-8 text"))?;
    Ok(params.iter().map(|(name, value)| (name.to_owned(), value.to_owned())).collect())
}

/// JSON by its content type; forms of other sites cannot be sent under it.
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

/// The router of all `operations`.
pub(super) fn router(operations: Vec<Operation>, api: &Arc<Api>) -> Router {
    let mut router = Router::new();
    for operation in operations {
        let (path, filter) = (operation.path, operation.method.filter());
        let (operation, api) = (Arc::new(operation), api.clone());
        let handler = move |request: Request| {
            let (operation, api) = (operation.clone(), api.clone());
            Reached::note(&request, operation.id);
            async move { operation.answer(api, request).await.into_response() }
        };
        let route: MethodRouter = on(filter, handler);
        router = router.route(path, route);
    }
    router
        .fallback(async || {
            Problem::new(ProblemKind::NotFound, "there is nothing here; /openapi.json lists what there is")
        })
        .method_not_allowed_fallback(async || {
            Problem::new(ProblemKind::MethodNotAllowed, "the path is there, the methods it knows stand in Allow")
        })
}

/// `value` as a JSON answer.
pub(super) fn json<T: Serialize>(status: u16, value: &T) -> Result<Response, Problem> {
    let broken = |_| Problem::new(ProblemKind::Internal, "the answer cannot be written");
    let bytes = serde_json::to_vec(value).map_err(broken)?;
    media(status, "application/json", bytes.into())
}

/// `bytes` as an answer of type `media`.
pub(super) fn media(status: u16, media: &'static str, bytes: Bytes) -> Result<Response, Problem> {
    let mut response = Response::new(bytes.into());
    *response.status_mut() =
        status.try_into().map_err(|_| Problem::new(ProblemKind::Internal, "the answer has no status"))?;
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(media));
    Ok(response)
}
