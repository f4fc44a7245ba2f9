//! Inputs of handlers: typed parts of a request. One that does not have its type is
//! refused by a problem document with every fault.

use std::marker::PhantomData;
use std::sync::Arc;
use std::time::Duration;

use aide::OperationInput;
use aide::generate::GenContext;
use aide::openapi::Operation;
use axum::extract::{FromRequest, FromRequestParts, Query, Request, State};
use axum::http::header::CONTENT_TYPE;
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode};
use axum::{Extension, Json};
use bytes::Bytes;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio::time::timeout;
use upm_core::document::{Diagnostic, parse, schema_of};

use super::state::DaemonState;
use crate::http::{Caller, Problem, too_large};

pub(super) type ApiState = State<Arc<DaemonState>>;
pub(super) type RequestCaller = Extension<Caller>;
pub(super) type Answer<T> = Result<Json<T>, Problem>;

/// Longest time for a complete body to arrive.
const BODY_TIME: Duration = Duration::from_secs(5);

/// Parameters of the query, each at most once, and none but those of `T`.
pub(super) struct FromQuery<T>(pub T);

impl<T: DeserializeOwned + JsonSchema + 'static, S: Send + Sync> FromRequestParts<S> for FromQuery<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        let query = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri);
        let Query(pairs) = query.map_err(|error| Problem::new(StatusCode::BAD_REQUEST, error.body_text()))?;
        let schema = schema_of::<T>();
        let members = pairs.iter().map(|(name, text)| {
            let is_number = schema.pointer(&format!("/properties/{name}/type")).is_some_and(|of| of == "integer");
            let number = text.parse::<u64>().ok().filter(|_| is_number);
            let value = number.map_or_else(|| Value::from(text.as_str()), Value::from);
            format!("{}: {value}", Value::from(name.as_str()))
        });
        let object = format!("{{{}}}", members.collect::<Vec<_>>().join(", "));
        parse(&object, "query").map(Self).map_err(|faults| Problem::of_faults(StatusCode::BAD_REQUEST, faults))
    }
}

impl<T: JsonSchema> OperationInput for FromQuery<T> {
    fn operation_input(context: &mut GenContext, operation: &mut Operation) {
        Query::<T>::operation_input(context, operation);
    }
}

/// The value of the header called `name`, which comes at most once and is one word of at most `most` characters; `None`
/// without one.
pub(super) fn one_word<'h>(headers: &'h HeaderMap, name: &str, most: usize) -> Result<Option<&'h str>, Problem> {
    let mut values = headers.get_all(name).iter();
    let Some(value) = values.next() else { return Ok(None) };
    let is_word = |text: &&str| (1..=most).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_graphic());
    let word = value.to_str().ok().filter(is_word).filter(|_| values.next().is_none());
    let wrong = || format!("{name}: expected one word of 1 to {most} visible ASCII characters, once");
    word.map(Some).ok_or_else(|| Problem::new(StatusCode::BAD_REQUEST, wrong()))
}

/// The text of a body that is JSON in the form of `T`.
pub(super) struct JsonBody<T> {
    pub text: String,
    form: PhantomData<fn() -> T>,
}

impl<T: DeserializeOwned + JsonSchema + 'static> JsonBody<T> {
    /// 400 for text that is not JSON, 422 for JSON that is not a valid `T`.
    pub fn read(&self) -> Result<T, Problem> {
        parse(&self.text, "body").map_err(Problem::of_document)
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
