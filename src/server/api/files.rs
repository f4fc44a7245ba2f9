use std::fs::File;
use std::io::ErrorKind;
use std::sync::Arc;
use std::time::Duration;

use aide::openapi::OpenApi;
use axum::body::Body;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_TYPE, HeaderName};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use tokio::io::AsyncReadExt;
use tokio::time::sleep;
use tokio_util::io::ReaderStream;

use super::extract::ApiState;
use super::jobs::JobPath;
use super::state::{conflict, unknown};
use crate::http::Problem;
use crate::states::{JobState, RecordingStatus};
use crate::store::{JobRow, open_run_file};
use upm_runner::config::is_plain_name;

pub(super) const RRD: &str = "application/octet-stream";

/// Header with the wall time since a picture was taken, ms.
const UPM_AGE_MS: HeaderName = HeaderName::from_static("upm-age-ms");

/// Attempts to get a picture that is still being made, and the pause between two of them.
const PICTURE_TRIES: usize = 10;
const PICTURE_AGAIN: Duration = Duration::from_millis(100);

/// Bytes read from a file at a time.
const CHUNK_BYTES: usize = 64 << 10;

/// The newest picture of a job that is on a plate, or was the last there.
pub(super) async fn frame(State(api): ApiState, Path(job): Path<JobPath>) -> Result<Response, Problem> {
    // pictures are only made on request, so the first takes a moment
    for _ in 0..PICTURE_TRIES {
        let picture = api.on_job(&job.id, |daemon, id| Ok(daemon.plate_under(&id, "a picture")?.picture()));
        if let Some((png, age)) = picture.await? {
            let headers = [(CONTENT_TYPE, "image/png".to_owned()), (UPM_AGE_MS, age.as_millis().to_string())];
            return Ok((headers, png).into_response());
        }
        sleep(PICTURE_AGAIN).await;
    }
    Err(Problem::busy("there is no picture yet", 1))
}

pub(super) async fn openapi(Extension(document): Extension<Arc<OpenApi>>) -> Response {
    Json(&*document).into_response()
}

/// The recording of a job that has ended.
pub(super) async fn recording(State(api): ApiState, Path(job): Path<JobPath>) -> Result<Response, Problem> {
    let opened = api.on_job(&job.id, |daemon, id| {
        let row = daemon.row(&id)?;
        Ok((open(daemon.store.runs(), &row)?, row.job.name))
    });
    let ((bytes, file), name) = opened.await?;
    let chunks = ReaderStream::with_capacity(tokio::fs::File::from_std(file).take(bytes), CHUNK_BYTES);
    let coded = || name.bytes().map(|byte| format!("%{byte:02X}")).collect::<String>();
    let named = if is_plain_name(&name) { format!("=\"{name}.rrd\"") } else { format!("*=UTF-8''{}.rrd", coded()) };
    let headers = [
        (CONTENT_TYPE, RRD.to_owned()),
        (CONTENT_LENGTH, bytes.to_string()),
        (CONTENT_DISPOSITION, format!("attachment; filename{named}")),
    ];
    Ok((headers, Body::from_stream(chunks)).into_response())
}

/// The size of the recording of a job that has ended, and the opened file. Waits for the disk.
fn open(runs: &std::path::Path, row: &JobRow) -> Result<(u64, File), Problem> {
    let none = match (row.state, row.recording) {
        (JobState::Queued, _) => return Err(unknown("the job has not begun")),
        (JobState::Running, _) => return Err(conflict("the recording is still being written")),
        (_, RecordingStatus::None) => return Err(unknown("the job was not recorded")),
        (_, RecordingStatus::Pruned) => return Err(unknown("the recording was deleted to make room")),
        // the part written before the failure may be there
        (_, RecordingStatus::Failed) => "the recording could not be written",
        (_, RecordingStatus::Whole | RecordingStatus::Partial) => "the recording is gone",
    };
    let folder = runs.join(row.folder.as_deref().ok_or_else(|| unknown(none))?);
    let opened = open_run_file(&folder, "run.rrd").and_then(|file| Ok((file.metadata()?.len(), file)));
    opened.map_err(|error| match error.kind() {
        ErrorKind::NotFound => unknown(none),
        ErrorKind::InvalidInput => conflict(format!("the recording is not served: {error}")),
        _ => {
            tracing::error!("a recording cannot be read: {error}");
            Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "the recording cannot be read")
        }
    })
}
