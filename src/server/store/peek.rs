use std::path::Path;

use rusqlite::{Connection, OpenFlags};

use super::migrate::{VERSION, refuse_newer};
use super::places::beside;
use super::schema::{APPLICATION_ID, reading};
use super::{AuditRow, JobId, JobRow, JobState, Page, StoreFault, StoredEvent, audit, events, jobs};

/// How much of a store to look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PeekMost {
    /// Newest jobs, at most [`Page::MOST`].
    pub jobs: usize,
    /// Newest events.
    pub events: usize,
    /// Last lines of the audit log.
    pub audit: usize,
}

/// What a look into a store from outside shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Peeked {
    /// How many jobs there are of each plate in each state.
    pub counts: Vec<(String, JobState, u64)>,
    /// Jobs, newest first.
    pub jobs: Vec<JobRow>,
    /// Events of the newest jobs, newest first.
    pub events: Vec<(JobId, StoredEvent)>,
    /// The audit log, newest first.
    pub audit: Vec<AuditRow>,
    /// Plates that are noted as paused, or as not.
    pub paused: Vec<(String, bool)>,
    /// True when the store was closed in order; false while a daemon has it, and after a crash.
    pub is_closed: bool,
}

/// Looks into the store of the data folder `data`, whether a daemon has it or not. Writes nothing a store would miss and
/// holds nobody up: each answer is read in one short transaction.
pub fn peek(data: &Path, most: PeekMost) -> Result<Peeked, StoreFault> {
    let db = data.join("upm.db");
    refuse_newer(&db)?;
    let connection = open(&db)?;
    let number = |name: &str| connection.pragma_query_value(None, name, |row| row.get::<_, i32>(0));
    let (id, version) = (number("application_id")?, number("user_version")?);
    if (id, version) != (APPLICATION_ID, VERSION) {
        return Err(StoreFault::Corrupt(format!("upm.db is of kind {id:08x} and version {version}, not of {VERSION}")));
    }
    let newest = Page { limit: most.jobs, ..Page::default() };
    Ok(Peeked {
        counts: jobs::counts(&connection)?,
        jobs: jobs::list(&connection, &newest)?.rows,
        events: events::newest(&connection, most.events)?,
        audit: audit::tail(&connection, most.audit)?,
        paused: paused(&connection)?,
        is_closed: super::open::is_clean(&connection)?,
    })
}

/// Where there is no log, an ordinary reader would make one, and the next start could no longer tell that it had been
/// lost. Then the file is read as it lies there.
pub(super) fn open(db: &Path) -> Result<Connection, StoreFault> {
    if beside(db, "-wal").exists() {
        return Ok(reading(db)?);
    }
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_URI;
    let connection = Connection::open_with_flags(still(db), flags)?;
    connection.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA query_only = ON;")?;
    Ok(connection)
}

/// The address of a file that nobody changes.
fn still(db: &Path) -> String {
    use std::fmt::Write as _;
    use std::os::unix::ffi::OsStrExt;
    let mut address = "file:".to_owned();
    for byte in db.as_os_str().as_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'.' | b'-' | b'_' => address.push(char::from(*byte)),
            // a string takes all that is written to it
            other => write!(address, "%{other:02x}").unwrap_or_default(),
        }
    }
    address + "?immutable=1"
}

fn paused(connection: &Connection) -> Result<Vec<(String, bool)>, StoreFault> {
    let mut statement = connection.prepare("SELECT name, paused FROM plates ORDER BY name")?;
    let plates = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?;
    Ok(plates.collect::<Result<_, _>>()?)
}
