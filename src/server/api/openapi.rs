use std::collections::BTreeMap;

use schemars::SchemaGenerator;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

use super::operation::{MediaType, Operation, Param, ParamIn, ResponseSpec};
use crate::http::{PROBLEM_JSON, ProblemDocument, ProblemKind};

/// The OpenAPI 3.1 document of `operations`. Its schemas are JSON Schema 2020-12, generated from the types.
pub(super) fn document(operations: &[Operation], version: &str) -> Value {
    let settings = SchemaSettings::draft2020_12().with(|settings| {
        settings.definitions_path = "/components/schemas".into();
        settings.meta_schema = None;
    });
    let mut bodies = settings.clone().for_deserialize().into_generator();
    let mut answers = settings.for_serialize().into_generator();
    let mut paths: BTreeMap<&str, Map<String, Value>> = BTreeMap::new();
    for operation in operations {
        let described = describe(operation, &mut bodies, &mut answers);
        paths.entry(operation.path).or_default().insert(operation.method.name().to_owned(), described);
    }
    let problem = answers.subschema_for::<ProblemDocument>().to_value();
    let mut schemas = bodies.take_definitions(true);
    schemas.extend(answers.take_definitions(true));
    let responses: Map<String, Value> =
        ProblemKind::ALL.into_iter().map(|kind| (problem_name(kind), problem_response(kind, &problem))).collect();
    json!({
        "openapi": "3.1.0",
        "info": {
            "title": "upm",
            "version": version,
            "description": INTRODUCTION,
            "license": {"name": "MIT OR Apache-2.0", "identifier": "MIT OR Apache-2.0"},
        },
        "servers": [{"url": "/"}],
        "paths": paths,
        "components": {
            "schemas": schemas,
            "responses": responses,
            "securitySchemes": {"token": {
                "type": "http",
                "scheme": "bearer",
                "description": "Asked for when the daemon has tokens; it must have some to listen beyond loopback.",
            }},
        },
    })
}

const INTRODUCTION: &str = "\
Jobs for plates that move coins. Errors are problem documents (RFC 9457); `X-Request-Id` names the request in them and \
in the log. Methods a path does not know are answered 405 with `Allow`, other paths 404. What is no HTTP request at \
all, or has more than 32 KiB of header, is answered 400 or 431 without a body; a header that does not come within 5 s \
ends the connection.";

fn describe(operation: &Operation, bodies: &mut SchemaGenerator, answers: &mut SchemaGenerator) -> Value {
    let mut responses: Map<String, Value> =
        operation.answers.iter().map(|answer| (answer.status.to_string(), response(answer, answers))).collect();
    for kind in operation.all_problems() {
        let reference = format!("#/components/responses/{}", problem_name(kind));
        responses.insert(kind.status().as_u16().to_string(), json!({"$ref": reference}));
    }
    let security = match operation.scope {
        Some(scope) => json!([{}, {"token": [scope.name()]}]),
        None => json!([]),
    };
    let mut described = json!({
        "operationId": operation.id,
        "summary": operation.summary,
        "security": security,
        "parameters": operation.params.iter().map(parameter).collect::<Vec<_>>(),
        "responses": responses,
    });
    if let (Some(schema), Some(described)) = (operation.body, described.as_object_mut()) {
        let content = json!({"application/json": {"schema": schema(bodies).to_value()}});
        described.insert("requestBody".to_owned(), json!({"required": true, "content": content}));
    }
    described
}

fn parameter(param: &Param) -> Value {
    json!({
        "name": param.name,
        "in": param.location,
        "description": param.description,
        "required": param.location == ParamIn::Path,
        "schema": (param.schema)(),
    })
}

fn response(answer: &ResponseSpec, generator: &mut SchemaGenerator) -> Value {
    let header = |what: &str| json!({"description": what, "schema": {"type": "string"}});
    let mut described = json!({"description": answer.description});
    let content = match answer.content {
        MediaType::Nothing => None,
        MediaType::Json(schema) => Some(json!({"application/json": {"schema": schema(generator).to_value()}})),
        MediaType::Media(media) => Some(json!({media: {}})),
    };
    if let Some(described) = described.as_object_mut() {
        described.extend(content.map(|content| ("content".to_owned(), content)));
        let headers: Map<String, Value> =
            answer.headers.iter().map(|(name, what)| ((*name).to_owned(), header(what))).collect();
        described.extend((!headers.is_empty()).then(|| ("headers".to_owned(), headers.into())));
    }
    described
}

fn problem_name(kind: ProblemKind) -> String {
    format!("Problem{}", kind.status().as_u16())
}

fn problem_response(kind: ProblemKind, schema: &Value) -> Value {
    let mut described = json!({
        "description": format!("{}.", kind.title()),
        "content": {PROBLEM_JSON: {"schema": schema}},
    });
    let header = match kind {
        ProblemKind::QueueFull => Some(("Retry-After", "Seconds after which a place may be free.")),
        ProblemKind::Unavailable => Some(("Retry-After", "Seconds after which to try again, where that is known.")),
        ProblemKind::Unauthorized => Some(("WWW-Authenticate", "`Bearer`.")),
        ProblemKind::MethodNotAllowed => Some(("Allow", "The methods the path knows.")),
        ProblemKind::RangeNotSatisfiable => Some(("Content-Range", "The size of the file.")),
        _ => None,
    };
    if let (Some((name, what)), Some(described)) = (header, described.as_object_mut()) {
        let header = json!({name: {"description": what, "schema": {"type": "string"}}});
        described.insert("headers".to_owned(), header);
    }
    described
}
