use axum::http::header::LOCATION;
use axum::http::{HeaderMap, HeaderName, HeaderValue};
use bytes::Bytes;

use super::cursor::JobsQuery;
use super::desk::Order;
use super::table::{Call, Outcome, json};
use crate::service::http::{Problem, ProblemKind};

pub(super) const IDEMPOTENCY_KEY: &str = "Idempotency-Key";
const LONGEST_KEY: usize = 255;
static REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");

pub(super) fn submit(call: Call) -> Outcome {
    Box::pin(async move {
        let order = Order {
            text: text_of(call.body)?,
            pace: call.query.pace()?,
            key: key_of(&call.headers)?,
            caller: call.caller,
        };
        let submitted = call.desk.submit(order).await?;
        let mut response = json(201, &submitted.job)?;
        if let Ok(location) = HeaderValue::from_str(&format!("/v1/jobs/{}", submitted.job.id)) {
            response.headers_mut().insert(LOCATION, location);
        }
        if submitted.replayed {
            response.headers_mut().insert(REPLAYED.clone(), HeaderValue::from_static("true"));
        }
        Ok(response)
    })
}

pub(super) fn list(call: Call) -> Outcome {
    Box::pin(async move { json(200, &call.desk.jobs(JobsQuery::of(&call.query)?).await?) })
}

pub(super) fn show(call: Call) -> Outcome {
    Box::pin(async move { json(200, &call.desk.job(call.job_id()?).await?) })
}

pub(super) fn cancel(call: Call) -> Outcome {
    Box::pin(async move { json(200, &call.desk.cancel(call.job_id()?, call.caller.clone()).await?) })
}

/// A body as text.
pub(super) fn text_of(body: Bytes) -> Result<String, Problem> {
    String::from_utf8(body.into()).map_err(|error| {
        let found = format!("a byte that is not UTF-8 at offset {}", error.utf8_error().valid_up_to());
        Problem::new(ProblemKind::Malformed, "1 fault").with_fault("$", found, "UTF-8 text")
    })
}

fn key_of(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let mut values = headers.get_all(IDEMPOTENCY_KEY).iter();
    let Some(value) = values.next() else { return Ok(None) };
    let bytes = value.as_bytes();
    let is_key = (1..=LONGEST_KEY).contains(&bytes.len()) && bytes.iter().all(u8::is_ascii_graphic);
    match value.to_str() {
        Ok(key) if is_key && values.next().is_none() => Ok(Some(key.to_owned())),
        _ => {
            let detail = format!("{IDEMPOTENCY_KEY} is one word of 1 to {LONGEST_KEY} visible ASCII characters");
            Err(Problem::new(ProblemKind::Malformed, detail))
        }
    }
}
