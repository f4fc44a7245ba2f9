use std::io::SeekFrom;
use std::time::Duration;

use axum::body::Body;
use axum::http::header::{
    ACCEPT_RANGES, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_SECURITY_POLICY,
    CONTENT_TYPE, ETAG, HeaderName, IF_NONE_MATCH, IF_RANGE, RANGE,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use bytes::{Bytes, BytesMut};
use futures_util::stream;
use tokio::fs::File;
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::sleep;

use super::backend::Refusal;
use super::request::RequestContext;
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

/// Content security policy of the operator page: its own script, images it creates, calls to its own daemon.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

pub(super) async fn frame(call: RequestContext) -> Result<Response, Problem> {
    let id = call.job_id()?;
    let mut picture = call.backend.frame(id).await;
    // pictures are only made on request, so the first takes a moment
    for _ in 0..PICTURE_TRIES {
        let Err(Refusal::Busy { .. }) = picture else { break };
        sleep(PICTURE_AGAIN).await;
        picture = call.backend.frame(id).await;
    }
    let picture = picture?;
    let headers = [(CONTENT_TYPE, "image/png".to_owned()), (UPM_AGE_MS, picture.age.as_millis().to_string())];
    Ok((headers, picture.png).into_response())
}

pub(super) async fn openapi(call: RequestContext) -> Result<Response, Problem> {
    Ok(([(CONTENT_TYPE, "application/json")], call.api.document.clone()).into_response())
}

pub(super) async fn page(call: RequestContext) -> Result<Response, Problem> {
    asset_called(&call, "index.html")
}

pub(super) async fn asset(call: RequestContext) -> Result<Response, Problem> {
    asset_called(&call, call.file())
}

fn asset_called(call: &RequestContext, name: &str) -> Result<Response, Problem> {
    let found = Some(name).filter(|name| is_plain_name(name)).and_then(|name| call.backend.asset(name));
    let asset = found.ok_or_else(|| Problem::new(ProblemKind::NotFound, "the operator page has no such file"))?;
    let known = call.headers.get(IF_NONE_MATCH).is_some_and(|tag| tag.as_bytes() == asset.etag.as_bytes());
    let content = match known {
        true => StatusCode::NOT_MODIFIED.into_response(),
        false => ([(CONTENT_TYPE, asset.media)], asset.bytes).into_response(),
    };
    let headers = [(ETAG, asset.etag.as_str()), (CACHE_CONTROL, "no-cache"), (CONTENT_SECURITY_POLICY, POLICY)];
    Ok((headers, content).into_response())
}

/// The recording, or the requested byte range of it.
pub(super) async fn recording(call: RequestContext) -> Result<Response, Problem> {
    let id = call.job_id()?;
    let permit = call.api.downloads.clone().try_acquire_owned();
    let full = |_| Problem::new(ProblemKind::Unavailable, "too many recordings are being sent").retry_after(10);
    let permit = permit.map_err(full)?;
    let recording = call.backend.recording(id).await?;
    let etag = format!("\"{id}-{}\"", recording.bytes);
    let range = asked(&call.headers, &etag, recording.bytes)?;
    let (first, length) = range.unwrap_or((0, recording.bytes));
    let mut file = File::from_std(recording.file);
    let unread = |_| Problem::new(ProblemKind::Internal, "the recording cannot be read");
    file.seek(SeekFrom::Start(first)).await.map_err(unread)?;
    let part = range.map(|_| {
        let last = first + length.saturating_sub(1);
        (StatusCode::PARTIAL_CONTENT, [(CONTENT_RANGE, format!("bytes {first}-{last}/{}", recording.bytes))])
    });
    let name = Some(recording.name.as_str()).filter(|name| is_plain_name(name)).unwrap_or("run.rrd");
    let headers = [
        (CONTENT_TYPE, RRD.to_owned()),
        (CONTENT_LENGTH, length.to_string()),
        (CONTENT_DISPOSITION, format!("attachment; filename=\"{name}\"")),
        (ACCEPT_RANGES, "bytes".to_owned()),
        (ETAG, etag),
    ];
    let whole = (headers, body_of(file, length, permit));
    Ok(match part {
        Some((status, range)) => (status, range, whole).into_response(),
        None => whole.into_response(),
    })
}

/// First byte and length of the requested range. `None` for the complete file: anything except a single range of bytes
/// is ignored.
fn asked(headers: &HeaderMap, etag: &str, bytes: u64) -> Result<Option<(u64, u64)>, Problem> {
    let same = headers.get(IF_RANGE).is_none_or(|tag| tag.as_bytes() == etag.as_bytes());
    let text = headers.get(RANGE).filter(|_| same).and_then(|value| value.to_str().ok());
    let Some((first, last)) = text.and_then(|text| text.strip_prefix("bytes=")?.split_once('-')) else {
        return Ok(None);
    };
    let number = |text: &str| text.bytes().all(|b| b.is_ascii_digit()).then(|| text.parse::<u64>().ok()).flatten();
    let range = match (number(first), number(last)) {
        (Some(first), Some(last)) if first <= last => (first, last.min(bytes.saturating_sub(1))),
        (Some(first), None) if last.is_empty() => (first, bytes.saturating_sub(1)),
        (None, Some(suffix)) if first.is_empty() && suffix > 0 => {
            (bytes.saturating_sub(suffix), bytes.saturating_sub(1))
        }
        (None, Some(0)) if first.is_empty() => (bytes, 0),
        _ => return Ok(None),
    };
    if range.0 >= bytes {
        let size = HeaderValue::from_str(&format!("bytes */{bytes}")).unwrap_or(HeaderValue::from_static("bytes */*"));
        let problem = Problem::new(ProblemKind::RangeNotSatisfiable, format!("the recording has {bytes} bytes"));
        return Err(problem.with_header(CONTENT_RANGE, size));
    }
    Ok(Some((range.0, range.1 - range.0 + 1)))
}

/// `length` bytes of the file from its position, read chunk by chunk as the client takes them.
fn body_of(file: File, length: u64, permit: OwnedSemaphorePermit) -> Body {
    let chunks = stream::try_unfold((file, length, permit), |(mut file, left, permit)| async move {
        if left == 0 {
            return Ok(None);
        }
        let mut chunk = BytesMut::with_capacity(CHUNK_BYTES);
        let most = left.min(CHUNK_BYTES as u64);
        let read = (&mut file).take(most).read_buf(&mut chunk).await? as u64;
        if read == 0 {
            return Err(std::io::Error::from(std::io::ErrorKind::UnexpectedEof));
        }
        Ok(Some((Bytes::from(chunk), (file, left - read, permit))))
    });
    Body::from_stream(chunks)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(text: &str, bytes: u64) -> Result<Option<(u64, u64)>, ()> {
        let headers = HeaderMap::from_iter([(RANGE, HeaderValue::from_str(text).unwrap())]);
        asked(&headers, "\"x\"", bytes).map_err(|_| ())
    }

    #[test]
    fn one_range_of_bytes_is_understood() {
        for (text, wanted) in [
            ("bytes=0-0", Ok(Some((0, 1)))),
            ("bytes=2-5", Ok(Some((2, 4)))),
            ("bytes=2-", Ok(Some((2, 8)))),
            ("bytes=9-99999999999999999", Ok(Some((9, 1)))),
            ("bytes=-3", Ok(Some((7, 3)))),
            ("bytes=-99", Ok(Some((0, 10)))),
            ("bytes=10-", Err(())),
            ("bytes=10-11", Err(())),
            ("bytes=-0", Err(())),
            ("bytes=5-2", Ok(None)),
            ("bytes=-", Ok(None)),
            ("bytes=+1-2", Ok(None)),
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
            asked(&HeaderMap::from_iter(headers), "\"x\"", 10)
        };
        assert_eq!(of("\"x\""), Ok(Some((1, 2))));
        assert_eq!(of("\"y\""), Ok(None));
    }
}
