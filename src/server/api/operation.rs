use std::pin::Pin;

use axum::response::Response;
use axum::routing::MethodFilter;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Serialize;

use super::request::RequestContext;
use crate::http::{Problem, ProblemKind, Scope};

/// HTTP method of an operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum HttpMethod {
    Get,
    Post,
    Delete,
}

impl HttpMethod {
    pub fn name(self) -> &'static str {
        match self {
            Self::Get => "get",
            Self::Post => "post",
            Self::Delete => "delete",
        }
    }

    pub fn filter(self) -> MethodFilter {
        match self {
            Self::Get => MethodFilter::GET,
            Self::Post => MethodFilter::POST,
            Self::Delete => MethodFilter::DELETE,
        }
    }
}

/// Place of a parameter in a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ParamIn {
    Path,
    Query,
    Header,
}

/// A parameter of an operation.
pub(super) struct Param {
    pub name: &'static str,
    pub location: ParamIn,
    pub description: &'static str,
    /// Makes the JSON Schema that its values must match.
    pub schema: fn() -> serde_json::Value,
}

/// Generates the schema of a type; schemas of its parts are added to the generator's definitions.
pub(super) type SchemaOf = fn(&mut SchemaGenerator) -> Schema;

pub(super) fn schema_of<T: JsonSchema>(generator: &mut SchemaGenerator) -> Schema {
    generator.subschema_for::<T>()
}

/// Body of an answer.
#[derive(Clone, Copy)]
pub(super) enum MediaType {
    Nothing,
    Json(SchemaOf),
    /// Text or bytes of this media type.
    Media(&'static str),
}

/// A successful answer of an operation. Failures are problem documents.
pub(super) struct ResponseSpec {
    pub status: u16,
    pub description: &'static str,
    pub content: MediaType,
    /// Names and descriptions of its headers.
    pub headers: &'static [(&'static str, &'static str)],
}

/// The future of a response or problem.
pub(super) type HandlerFuture = Pin<Box<dyn Future<Output = Result<Response, Problem>> + Send>>;

/// Handler of one operation: any function from [`RequestContext`] to a future.
pub(super) trait Handler: Send + Sync + 'static {
    fn answer(&self, call: RequestContext) -> HandlerFuture;
}

impl<H, F> Handler for H
where
    H: Fn(RequestContext) -> F + Send + Sync + 'static,
    F: Future<Output = Result<Response, Problem>> + Send + 'static,
{
    fn answer(&self, call: RequestContext) -> HandlerFuture {
        Box::pin(self(call))
    }
}

/// One row of the API's table, from which router, OpenAPI document and counters are made.
pub(super) struct Operation {
    /// `operationId` in the OpenAPI document.
    pub id: &'static str,
    pub method: HttpMethod,
    pub path: &'static str,
    /// Scope that the token needs; `None` for operations without a token.
    pub scope: Option<Scope>,
    pub summary: &'static str,
    pub params: &'static [Param],
    /// Schema of the JSON body, if it takes one.
    pub body: Option<SchemaOf>,
    pub answers: &'static [ResponseSpec],
    /// Problems in addition to those of the layers.
    pub problems: &'static [ProblemKind],
    pub handler: Box<dyn Handler>,
}

impl Operation {
    /// Every problem it can answer with: its own, and those of the layers before the handler.
    pub fn all_problems(&self) -> Vec<ProblemKind> {
        use ProblemKind as P;
        let mut kinds = vec![P::Malformed, P::Forbidden, P::UriTooLong, P::HeaderTooLarge, P::Internal, P::Unavailable];
        kinds.extend(self.scope.map(|_| P::Unauthorized));
        kinds.extend(self.body.iter().flat_map(|_| [P::RequestTimeout, P::ContentTooLarge, P::UnsupportedMediaType]));
        kinds.extend(self.path.contains('{').then_some(P::NotFound));
        kinds.extend(self.problems);
        ProblemKind::ALL.into_iter().filter(|kind| kinds.contains(kind)).collect()
    }
}
