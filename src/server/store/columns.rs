use jiff::Timestamp;
use rusqlite::types::{FromSql, FromSqlError, FromSqlResult, ToSql, ToSqlOutput, ValueRef};
use rusqlite::{Connection, ErrorCode, Params, Row};

use super::{JobId, JobRow, JobState, Pace, RecordingStatus, StoreFault};

/// Columns that [`job_of`] reads, in its order.
pub(super) const JOB: &str = "id, name, plate, state, seed, pace, rig, submitted_at, started_at, finished_at, \
                              progress, reason, report, folder, recording, standing, turn";

/// The job in a row of [`JOB`].
pub(super) fn job_of(row: &Row<'_>) -> rusqlite::Result<JobRow> {
    Ok(JobRow {
        id: row.get(0)?,
        name: row.get(1)?,
        plate: row.get(2)?,
        state: row.get(3)?,
        seed: row.get::<_, i64>(4)?.cast_unsigned(),
        pace: pace(row.get_ref(5)?)?,
        rig_fingerprint: row.get(6)?,
        submitted_at: row.get::<_, Micros>(7)?.0,
        started_at: row.get::<_, Option<Micros>>(8)?.map(|at| at.0),
        finished_at: row.get::<_, Option<Micros>>(9)?.map(|at| at.0),
        progress: row.get(10)?,
        reason: row.get(11)?,
        report_json: row.get(12)?,
        folder: row.get(13)?,
        recording: row.get(14)?,
        standing: row.get(15)?,
        turn: row.get(16)?,
    })
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

/// A time in a column, in whole microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Micros(pub Timestamp);

impl Micros {
    /// The time rounded as the store returns it.
    pub fn rounded(time: Timestamp) -> Timestamp {
        Timestamp::from_microsecond(time.as_microsecond()).unwrap_or(time)
    }
}

impl ToSql for Micros {
    fn to_sql(&self) -> rusqlite::Result<ToSqlOutput<'_>> {
        Ok(self.0.as_microsecond().into())
    }
}

impl FromSql for Micros {
    fn column_result(value: ValueRef<'_>) -> FromSqlResult<Self> {
        let us = value.as_i64()?;
        Timestamp::from_microsecond(us).map(Self).map_err(|_| FromSqlError::OutOfRange(us))
    }
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

/// A pace, stored by its name.
fn pace(value: ValueRef<'_>) -> FromSqlResult<Pace> {
    Pace::of_code(value.as_str()?).ok_or(FromSqlError::InvalidType)
}

/// Implements the conversions of kinds that are stored by their names.
macro_rules! named {
    ($($kind:ty),*) => {$(
        impl ToSql for $kind {
            fn to_sql(&self) -> rusqlite::Result<ToSqlOutput<'_>> {
                Ok(self.code().into())
            }
        }

        impl FromSql for $kind {
            fn column_result(value: ValueRef<'_>) -> FromSqlResult<Self> {
                Self::of_code(value.as_str()?).ok_or(FromSqlError::InvalidType)
            }
        }
    )*};
}

named!(JobState, RecordingStatus);

impl From<rusqlite::Error> for StoreFault {
    fn from(error: rusqlite::Error) -> Self {
        use rusqlite::Error::{FromSqlConversionFailure, IntegralValueOutOfRange, InvalidColumnType, SqliteFailure};
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
