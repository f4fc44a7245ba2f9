use std::io::SeekFrom;
use std::time::Duration;

use axum::body::Body;
use axum::extract::State;
use axum::http::header::{
    ACCEPT_RANGES, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE, ETAG, HeaderName, IF_RANGE, RANGE,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use tokio::fs::File;
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio::time::sleep;
use tokio_util::io::ReaderStream;

use super::backend::Refusal;
use super::extract::{ApiState, FromPath};
use super::jobs::JobPath;
use crate::http::{Problem, ProblemKind};
use upm_runner::config::is_plain_name;

pub(super) const RRD: &str = "application/octet-stream";

/// Header with the wall time since a picture was taken, ms.
const UPM_AGE_MS: HeaderName = HeaderName::from_static("upm-age-ms");

/// Attempts to get a picture that is still being made, and the pause between two of them.
const PICTURE_TRIES: usize = 10;
const PICTURE_AGAIN: Duration = Duration::from_millis(100);

/// Most recordings sent at once.
pub(super) const DOWNLOADS: usize = 8;

/// Bytes read from a file at a time.
const CHUNK_BYTES: usize = 64 << 10;

pub(super) async fn frame(State(api): ApiState, FromPath(job): FromPath<JobPath>) -> Result<Response, Problem> {
    let mut picture = api.backend.frame(&job.id).await;
    // pictures are only made on request, so the first takes a moment
    for _ in 0..PICTURE_TRIES {
        let Err(Refusal::Busy { .. }) = picture else { break };
        sleep(PICTURE_AGAIN).await;
        picture = api.backend.frame(&job.id).await;
    }
    let picture = picture?;
    let headers = [(CONTENT_TYPE, "image/png".to_owned()), (UPM_AGE_MS, picture.age.as_millis().to_string())];
    Ok((headers, picture.png).into_response())
}

pub(super) async fn openapi(State(api): ApiState) -> Response {
    ([(CONTENT_TYPE, "application/json")], api.document.clone()).into_response()
}

/// The recording, or the requested byte range of it.
pub(super) async fn recording(
    State(api): ApiState,
    FromPath(job): FromPath<JobPath>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let full = |_| Problem::new(ProblemKind::Unavailable, "too many recordings are being sent").retry_after(10);
    let permit = api.downloads.clone().try_acquire_owned().map_err(full)?;
    let recording = api.backend.recording(&job.id).await?;
    let etag = format!("\"{}-{}\"", job.id, recording.bytes);
    let range = requested(&headers, &etag, recording.bytes)?;
    let (first, length) = range.unwrap_or((0, recording.bytes));
    let mut file = File::from_std(recording.file);
    let unread = |_| Problem::new(ProblemKind::Internal, "the recording cannot be read");
    file.seek(SeekFrom::Start(first)).await.map_err(unread)?;
    let chunks = ReaderStream::with_capacity(file.take(length), CHUNK_BYTES);
    let name = Some(recording.name.as_str()).filter(|name| is_plain_name(name)).unwrap_or("run.rrd");
    let headers = [
        (CONTENT_TYPE, RRD.to_owned()),
        (CONTENT_LENGTH, length.to_string()),
        (CONTENT_DISPOSITION, format!("attachment; filename=\"{name}\"")),
        (ACCEPT_RANGES, "bytes".to_owned()),
        (ETAG, etag),
    ];
    // the permit is held until the client has taken the file, or has gone
    let whole = (headers, Body::from_stream(chunks.inspect(move |_| _ = &permit)));
    let Some(_) = range else { return Ok(whole.into_response()) };
    let last = first + length.saturating_sub(1);
    let part = [(CONTENT_RANGE, format!("bytes {first}-{last}/{}", recording.bytes))];
    Ok((StatusCode::PARTIAL_CONTENT, part, whole).into_response())
}

/// First byte and length of the range `bytes=FIRST-` or `bytes=FIRST-LAST`. `None`, for the complete file: any other
/// range is ignored.
fn requested(headers: &HeaderMap, etag: &str, bytes: u64) -> Result<Option<(u64, u64)>, Problem> {
    let is_same = headers.get(IF_RANGE).is_none_or(|tag| tag.as_bytes() == etag.as_bytes());
    let text = headers.get(RANGE).filter(|_| is_same).and_then(|value| value.to_str().ok());
    let Some((first, last)) = text.and_then(|text| text.strip_prefix("bytes=")?.split_once('-')) else {
        return Ok(None);
    };
    let last = if last.is_empty() { Ok(u64::MAX) } else { last.parse() };
    let (Ok(first), Ok(last)) = (first.parse::<u64>(), last) else { return Ok(None) };
    if first > last {
        return Ok(None);
    }
    if first >= bytes {
        let size = HeaderValue::from_str(&format!("bytes */{bytes}")).unwrap_or(HeaderValue::from_static("bytes */*"));
        let problem = Problem::new(ProblemKind::RangeNotSatisfiable, format!("the recording has {bytes} bytes"));
        return Err(problem.with_header(CONTENT_RANGE, size));
    }
    Ok(Some((first, last.min(bytes - 1) - first + 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(text: &str, bytes: u64) -> Result<Option<(u64, u64)>, ()> {
        let headers = HeaderMap::from_iter([(RANGE, HeaderValue::from_str(text).unwrap())]);
        requested(&headers, "\"x\"", bytes).map_err(|_| ())
    }

    #[test]
    fn one_range_of_bytes_is_understood() {
        for (text, wanted) in [
            ("bytes=0-0", Ok(Some((0, 1)))),
            ("bytes=2-5", Ok(Some((2, 4)))),
            ("bytes=2-", Ok(Some((2, 8)))),
            ("bytes=9-99999999999999999", Ok(Some((9, 1)))),
            ("bytes=10-", Err(())),
            ("bytes=10-11", Err(())),
            ("bytes=-3", Ok(None)),
            ("bytes=5-2", Ok(None)),
            ("bytes=-", Ok(None)),
            ("bytes=0-1,4-5", Ok(None)),
            ("bytes=99999999999999999999-", Ok(None)),
            ("lines=1-2", Ok(None)),
            ("", Ok(None)),
        ] {
            assert_eq!(range(text, 10), wanted, "{text:?}");
        }
        assert_eq!(range("bytes=0-", 0), Err(()));
    }

    #[test]
    fn a_range_of_another_file_is_the_whole_file() {
        let of = |tag| {
            let headers = [(RANGE, HeaderValue::from_static("bytes=1-2")), (IF_RANGE, HeaderValue::from_static(tag))];
            requested(&HeaderMap::from_iter(headers), "\"x\"", 10)
        };
        assert_eq!(of("\"x\""), Ok(Some((1, 2))));
        assert_eq!(of("\"y\""), Ok(None));
    }
}
