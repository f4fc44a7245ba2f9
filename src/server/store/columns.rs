use jiff::Timestamp;
use rusqlite::types::{FromSql, FromSqlResult, ToSql, ToSqlOutput, Type, ValueRef};
use rusqlite::{Connection, Error, ErrorCode, Params, Row};

use super::{Job, JobId, JobRow, JobState, Pace, RecordingStatus, StoreFault};

/// Columns that [`job_of`] reads, in its order.
pub(super) const JOB: &str = "id, name, plate, state, seed, pace, rig, submitted_at, started_at, finished_at, \
                              progress, reason, report, folder, recording, standing, turn";

/// The job in a row of [`JOB`].
pub(super) fn job_of(row: &Row<'_>) -> rusqlite::Result<JobRow> {
    let id: JobId = row.get(0)?;
    let report: Option<String> = row.get(12)?;
    let job = Job {
        id: id.to_string(),
        name: row.get(1)?,
        plate: row.get(2)?,
        state: coded(row, 3, JobState::of_code)?,
        seed: row.get::<_, i64>(4)?.cast_unsigned(),
        pace: coded(row, 5, Pace::of_code)?,
        submitted_at: row.get(7)?,
        started_at: row.get(8)?,
        finished_at: row.get(9)?,
        progress: row.get(10)?,
        reason: row.get(11)?,
        report: report.and_then(|text| serde_json::from_str(&text).ok()),
        recording: coded(row, 14, RecordingStatus::of_code)?,
        standing: row.get(15)?,
        turn: row.get(16)?,
    };
    Ok(JobRow { id, job, rig_fingerprint: row.get(6)?, folder: row.get(13)? })
}

/// The value whose code a column has.
pub(super) fn coded<T>(row: &Row<'_>, column: usize, of_code: fn(&str) -> Option<T>) -> rusqlite::Result<T> {
    let code: String = row.get(column)?;
    of_code(&code).ok_or_else(|| Error::InvalidColumnType(column, code, Type::Text))
}

/// A time as the store and clients have it. Texts of times compare as the times do.
pub(super) fn text_of_time(time: Timestamp) -> String {
    format!("{time:.6}")
}

/// All rows of a query, each read by `read`.
pub(super) fn rows<T>(
    connection: &Connection,
    sql: &str,
    params: impl Params,
    read: impl FnMut(&Row<'_>) -> rusqlite::Result<T>,
) -> rusqlite::Result<Vec<T>> {
    connection.prepare(sql)?.query_map(params, read)?.collect()
}

/// A limit or number as SQLite's integer, saturated.
pub(super) fn sql_limit(most: impl TryInto<i64>) -> i64 {
    most.try_into().unwrap_or(i64::MAX)
}

impl ToSql for JobId {
    fn to_sql(&self) -> rusqlite::Result<ToSqlOutput<'_>> {
        Ok(self.as_bytes().as_slice().into())
    }
}

impl FromSql for JobId {
    fn column_result(value: ValueRef<'_>) -> FromSqlResult<Self> {
        <[u8; 16]>::column_result(value).map(Self::from_bytes)
    }
}

impl From<rusqlite::Error> for StoreFault {
    fn from(error: rusqlite::Error) -> Self {
        use Error::{FromSqlConversionFailure, IntegralValueOutOfRange, InvalidColumnType, SqliteFailure};
        match &error {
            SqliteFailure(code, _) => match code.code {
                ErrorCode::DiskFull => Self::Full,
                // the index of the log could not grow
                _ if code.extended_code == rusqlite::ffi::SQLITE_IOERR_SHMSIZE => Self::Full,
                ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase => Self::Corrupt(error.to_string()),
                _ => Self::Io(error.to_string()),
            },
            FromSqlConversionFailure(..) | IntegralValueOutOfRange(..) | InvalidColumnType(..) => {
                Self::Corrupt(error.to_string())
            }
            _ => Self::Io(error.to_string()),
        }
    }
}

impl From<std::io::Error> for StoreFault {
    fn from(error: std::io::Error) -> Self {
        match error.kind() {
            std::io::ErrorKind::StorageFull => Self::Full,
            _ => Self::Io(error.to_string()),
        }
    }
}
