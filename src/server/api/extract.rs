//! Inputs of handlers: the state that all share, and typed parts of a request. One that does not have its type is
//! refused by a problem document with every fault.

use std::marker::PhantomData;
use std::sync::Arc;
use std::time::Duration;

use aide::OperationInput;
use aide::generate::GenContext;
use aide::openapi::Operation;
use aide::operation::{ParamLocation, add_parameters, parameters_from_schema};
use axum::extract::{FromRequest, FromRequestParts, Path, Query, Request, State};
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::http::request::Parts;
use axum::{Extension, Json};
use bytes::Bytes;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use upm_core::document::{Diagnostic, DiagnosticClass, parse, schema_of};

use super::state::{DaemonState, no_job, unheard};
use crate::http::{Caller, Confirmations, Problem, too_large};
use crate::store::JobId;

/// State that all handlers share.
pub(super) struct Api {
    pub daemon: Arc<DaemonState>,
    /// Ends event streams.
    pub stop: CancellationToken,
    /// The OpenAPI document.
    pub document: Bytes,
    /// Places for checks of jobs.
    pub checks: Arc<Semaphore>,
    pub confirmations: Confirmations,
    pub downloads: Arc<Semaphore>,
}

/// Most jobs checked at once.
pub(super) const CHECKS: usize = 2;

impl Api {
    /// The answer of `work`, which may wait for the disk. The work gets a test of whether the client still waits, and
    /// is left out when it does not.
    pub async fn blocking<T: Send + 'static>(
        &self,
        work: impl FnOnce(&DaemonState, &dyn Fn() -> bool) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let (daemon, gone) = (Arc::clone(&self.daemon), CancellationToken::new());
        let _awaited = gone.clone().drop_guard();
        let answer = spawn_blocking(move || {
            let is_awaited = || !gone.is_cancelled();
            if is_awaited() { work(&daemon, &is_awaited) } else { Err(unheard()) }
        });
        let broken = |_| Err(Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "internal error"));
        answer.await.unwrap_or_else(broken)
    }

    /// The answer of `work`, which checks a job. Its place is free once the work has ended, whether or not its client
    /// waits.
    pub async fn checking<T: Send + 'static>(
        &self,
        work: impl FnOnce(&DaemonState, &dyn Fn() -> bool) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let place = Arc::clone(&self.checks).acquire_owned().await;
        self.blocking(move |daemon, is_awaited| {
            let answer = work(daemon, is_awaited);
            drop(place);
            answer
        })
        .await
    }

    /// The answer of `work` on the job with the id `text`.
    pub async fn on_job<T: Send + 'static>(
        &self,
        text: &str,
        work: impl FnOnce(&DaemonState, JobId) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let id = JobId::parse(text).ok_or_else(no_job)?;
        self.blocking(move |daemon, _| work(daemon, id)).await
    }
}

pub(super) type ApiState = State<Arc<Api>>;
pub(super) type RequestCaller = Extension<Caller>;
pub(super) type Answer<T> = Result<Json<T>, Problem>;

/// Longest time for a complete body to arrive.
const BODY_TIME: Duration = Duration::from_secs(5);

/// Parameters of the path. Text that is not UTF-8 names nothing.
pub(super) struct FromPath<T>(pub T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for FromPath<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let path = Path::from_request_parts(parts, state).await;
        path.map(|Path(path)| Self(path)).map_err(|error| Problem::new(StatusCode::NOT_FOUND, error.body_text()))
    }
}

impl<T: JsonSchema> OperationInput for FromPath<T> {
    fn operation_input(context: &mut GenContext, operation: &mut Operation) {
        Path::<T>::operation_input(context, operation);
    }
}

/// Parameters of the query, each at most once, and none but those of `T`.
pub(super) struct FromQuery<T>(pub T);

impl<T: DeserializeOwned + JsonSchema + 'static, S: Send + Sync> FromRequestParts<S> for FromQuery<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        let query = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri);
        let Query(pairs) = query.map_err(|error| Problem::new(StatusCode::BAD_REQUEST, error.body_text()))?;
        read_texts("query", &pairs).map(Self)
    }
}

impl<T: JsonSchema> OperationInput for FromQuery<T> {
    fn operation_input(context: &mut GenContext, operation: &mut Operation) {
        Query::<T>::operation_input(context, operation);
    }
}

/// The headers that are members of `T`, each at most once.
pub(super) struct FromHeaders<T>(pub T);

impl<T: DeserializeOwned + JsonSchema + 'static, S: Send + Sync> FromRequestParts<S> for FromHeaders<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        let schema = schema_of::<T>();
        let names = schema.get("properties").and_then(Value::as_object).into_iter().flat_map(|members| members.keys());
        let lines = names.flat_map(|name| parts.headers.get_all(name).iter().map(move |value| (name, value)));
        let texts = lines.map(|(name, value)| match value.to_str() {
            Ok(text) if text.bytes().all(|b| b.is_ascii_graphic()) => Ok((name.clone(), text.to_owned())),
            _ => Err(Problem::new(StatusCode::BAD_REQUEST, format!("{name} is one word of visible ASCII"))),
        });
        read_texts("header", &texts.collect::<Result<Vec<_>, _>>()?).map(Self)
    }
}

impl<T: JsonSchema> OperationInput for FromHeaders<T> {
    fn operation_input(context: &mut GenContext, operation: &mut Operation) {
        let schema = context.schema.subschema_for::<T>();
        let parameters = parameters_from_schema(context, schema, ParamLocation::Header);
        add_parameters(context, operation, parameters);
    }
}

/// `T` from texts by name.
fn read_texts<T: DeserializeOwned + JsonSchema + 'static>(
    place: &str,
    texts: &[(String, String)],
) -> Result<T, Problem> {
    let schema = schema_of::<T>();
    let members = texts.iter().map(|(name, text)| {
        let is_number = schema.pointer(&format!("/properties/{name}/type")).is_some_and(|of| of == "integer");
        let number = text.parse::<u64>().ok().filter(|_| is_number);
        format!("{}: {}", Value::from(name.as_str()), number.map_or_else(|| Value::from(text.as_str()), Value::from))
    });
    let object = format!("{{{}}}", members.collect::<Vec<_>>().join(", "));
    parse(&object, place).map_err(|faults| Problem::of_faults(StatusCode::BAD_REQUEST, faults))
}

/// The text of a body that is JSON in the form of `T`.
pub(super) struct JsonBody<T> {
    pub text: String,
    form: PhantomData<fn() -> T>,
}

impl<T: DeserializeOwned + JsonSchema + 'static> JsonBody<T> {
    /// 400 for text that is not JSON, 422 for JSON that is not a valid `T`.
    pub fn read(&self) -> Result<T, Problem> {
        parse(&self.text, "body").map_err(|faults| {
            let is_json = faults.iter().all(|fault| fault.class != DiagnosticClass::Syntax);
            Problem::of_faults(if is_json { StatusCode::UNPROCESSABLE_ENTITY } else { StatusCode::BAD_REQUEST }, faults)
        })
    }
}

impl<T, S: Send + Sync> FromRequest<S> for JsonBody<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        // forms of other sites cannot send this type
        let media = request.headers().get(CONTENT_TYPE).and_then(|value| value.to_str().ok()?.split(';').next());
        if !media.is_some_and(|media| media.trim().eq_ignore_ascii_case("application/json")) {
            let detail = "the body must come as `Content-Type: application/json`";
            return Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, detail));
        }
        let body = timeout(BODY_TIME, Bytes::from_request(request, state)).await.map_err(|_| {
            let detail = format!("the body was not here after {} s", BODY_TIME.as_secs());
            Problem::new(StatusCode::REQUEST_TIMEOUT, detail)
        })?;
        let body = body.map_err(|error| match error.status() {
            StatusCode::PAYLOAD_TOO_LARGE => too_large(),
            _ => Problem::new(StatusCode::BAD_REQUEST, "the body broke off"),
        })?;
        let text = String::from_utf8(body.into()).map_err(|error| {
            let found = format!("a byte that is not UTF-8 at offset {}", error.utf8_error().valid_up_to());
            Problem::of_faults(StatusCode::BAD_REQUEST, vec![Diagnostic::new("body", "$", found, "UTF-8 text")])
        })?;
        Ok(Self { text, form: PhantomData })
    }
}

impl<T: JsonSchema> OperationInput for JsonBody<T> {
    fn operation_input(context: &mut GenContext, operation: &mut Operation) {
        Json::<T>::operation_input(context, operation);
    }
}
