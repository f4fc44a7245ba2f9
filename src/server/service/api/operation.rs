use std::pin::Pin;

use axum::response::Response;
use axum::routing::MethodFilter;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Serialize;

use super::request::Call;
use crate::service::http::{Problem, ProblemKind, Scope};

/// How an operation is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    Get,
    Post,
    Delete,
}

impl Method {
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

/// The part of a request that holds a parameter.
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
    /// Its JSON Schema.
    pub schema: fn() -> serde_json::Value,
}

/// Makes the schema of a type and leaves its parts with the generator.
pub(super) type SchemaOf = fn(&mut SchemaGenerator) -> Schema;

pub(super) fn schema_of<T: JsonSchema>(generator: &mut SchemaGenerator) -> Schema {
    generator.subschema_for::<T>()
}

/// Content of an answer.
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
    pub description: &'static str,
    pub content: Content,
    /// Names and meanings of its headers.
    pub headers: &'static [(&'static str, &'static str)],
}

/// An answer on its way.
pub(super) type HandlerFuture = Pin<Box<dyn Future<Output = Result<Response, Problem>> + Send>>;

/// Answers the requests of one operation: any function from [`Call`] to a future.
pub(super) trait Handler: Send + Sync + 'static {
    fn answer(&self, call: Call) -> HandlerFuture;
}

impl<H, F> Handler for H
where
    H: Fn(Call) -> F + Send + Sync + 'static,
    F: Future<Output = Result<Response, Problem>> + Send + 'static,
{
    fn answer(&self, call: Call) -> HandlerFuture {
        Box::pin(self(call))
    }
}

/// An operation of the API: the row from which router, document and counters are made.
pub(super) struct Operation {
    /// Its name in the document.
    pub id: &'static str,
    pub method: Method,
    pub path: &'static str,
    /// Scope that a token needs; `None` for operations without a token.
    pub scope: Option<Scope>,
    pub summary: &'static str,
    pub params: &'static [Param],
    /// Schema of the JSON body, where there is one.
    pub body: Option<SchemaOf>,
    pub answers: &'static [Answer],
    /// Problems besides those of the layers.
    pub problems: &'static [ProblemKind],
    pub handler: Box<dyn Handler>,
}

impl Operation {
    /// Every problem it can be answered with: its own, and those of what a request passes on its way to the handler.
    pub fn all_problems(&self) -> Vec<ProblemKind> {
        use ProblemKind as P;
        let mut kinds = vec![P::Malformed, P::Forbidden, P::UriTooLong, P::HeaderTooLarge, P::Internal, P::Unavailable];
        kinds.extend(self.scope.map(|_| P::Unauthorized));
        kinds.extend(self.body.iter().flat_map(|_| [P::RequestTimeout, P::ContentTooLarge, P::UnsupportedMediaType]));
        kinds.extend(self.path.contains('{').then_some(P::NotFound));
        kinds.extend(self.problems);
        ProblemKind::ALL.into_iter().filter(|kind| kinds.contains(kind)).collect()
    }

    /// Every status it can be answered with.
    pub fn statuses(&self) -> Vec<u16> {
        let problems = self.all_problems().into_iter().map(|kind| kind.status().as_u16());
        self.answers.iter().map(|answer| answer.status).chain(problems).collect()
    }
}
