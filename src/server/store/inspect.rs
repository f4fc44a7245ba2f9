use std::path::Path;

use super::columns::rows;
use super::connection::inspecting;
use super::schema::{APPLICATION_ID, VERSION, identity, is_clean, refuse_newer};
use super::{AuditRow, JobId, JobRow, JobSelection, JobState, StoreFault, StoredEvent, history, jobs};

/// Largest numbers of rows that [`inspect`] returns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InspectLimits {
    /// Most jobs, the newest first; at most [`JobSelection::MOST`].
    pub jobs: usize,
    /// Most events, the newest first.
    pub events: usize,
    /// Most entries of the audit log, the newest first.
    pub audit: usize,
}

/// Contents of a store, read beside a daemon that may have it open.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoreSnapshot {
    /// Number of jobs of each plate in each state.
    pub counts: Vec<(String, JobState, u64)>,
    /// Jobs, newest first.
    pub jobs: Vec<JobRow>,
    /// Events of the newest jobs, newest first.
    pub events: Vec<(JobId, StoredEvent)>,
    /// The audit log, newest first.
    pub audit: Vec<AuditRow>,
    /// Plates with true where they are noted as paused.
    pub paused: Vec<(String, bool)>,
    /// True when the store was closed in order; false while a daemon has it open, and after a crash.
    pub is_closed: bool,
}

/// Reads the store of the data folder `data`, whether a daemon has it open or not. Writes nothing that the next start
/// would detect, and blocks no writer: each part is read in one short transaction.
pub fn inspect(data: &Path, most: InspectLimits) -> Result<StoreSnapshot, StoreFault> {
    let db = data.join("upm.db");
    refuse_newer(&db)?;
    let connection = inspecting(&db)?;
    let (id, version) = identity(&connection)?;
    if (id, version) != (APPLICATION_ID, VERSION) {
        return Err(StoreFault::Corrupt(format!("upm.db is of kind {id:08x} and version {version}, not of {VERSION}")));
    }
    let newest = JobSelection { limit: most.jobs, ..JobSelection::default() };
    Ok(StoreSnapshot {
        counts: jobs::counts(&connection)?,
        jobs: jobs::list(&connection, &newest)?.rows,
        events: history::newest_events(&connection, most.events)?,
        audit: history::audit_tail(&connection, most.audit)?,
        paused: rows(&connection, "SELECT name, paused FROM plates ORDER BY name", [], |row| {
            Ok((row.get(0)?, row.get(1)?))
        })?,
        is_closed: is_clean(&connection)?,
    })
}
