use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::thread;

use rusqlite::{Connection, OptionalExtension};

use super::ages::AgeClock;
use super::connection::{reading, restart_log, writing};
use super::handle::Store;
use super::ids::Ids;
use super::layout::{DataDir, beside};
use super::options::OpenOptions;
use super::quarantine::{damage_of, quarantine};
use super::reader::Readers;
use super::recover::{recover, uptime};
use super::retention::{Retention, Sweeper};
use super::schema::{create_as, is_clean, refuse_other_version};
use super::write_queue::{MOST_WAITING, StoreWriterStatus, WriteQueue};
use super::writer::Writer;
use super::{Clocks, JobId, RecoveryReport, StoreFault, StoreLimits};
use upm_core::thread_priority::lower_thread_priority;
use upm_core::time::MonotonicClock;

/// An open store with the report of its recovery.
#[derive(Debug)]
pub struct OpenOutcome {
    /// Store in the state that recovery left.
    pub store: Store,
    /// Findings of the start.
    pub recovery: RecoveryReport,
}

impl Store {
    /// Opens the store in the folder `data`, creating it if needed, and recovers the state that a crash left. A damaged
    /// store is moved aside and a new one made of the readable data. Fails when another process has the store open,
    /// when the folder is not writable, when its disk is full, and, with nothing changed, when the store has another
    /// schema version.
    pub fn open(
        data: &Path,
        plates: &[String],
        limits: StoreLimits,
        clocks: Clocks,
    ) -> Result<OpenOutcome, StoreFault> {
        let dir = DataDir::in_folder(data)?;
        let lock = dir.lock()?;
        [&dir.db, &dir.next].into_iter().try_for_each(|db| refuse_other_version(db))?;
        dir.make_runs()?;
        let options = OpenOptions { plates, limits: &limits, clocks: &clocks };
        let (connection, recovery) = options.start(&dir)?;
        let ids = Ids::above(last_id(&connection)?);
        let reading = vec![reading(&dir.db)?, reading(&dir.db)?];
        let readers = Readers::start(reading, Arc::clone(&clocks.monotonic))?;
        let (sender, waiting) = sync_channel(MOST_WAITING);
        let status = Arc::new(StoreWriterStatus::new(MonotonicClock::new()));
        let queue = WriteQueue { sender, status: Arc::clone(&status) };
        let ages = AgeClock::after(uptime(&connection)?, clocks.clone());
        let sweeper = Sweeper::new(dir.runs.clone(), limits.clone(), queue.clone());
        let (runs, uncounted, now) = (dir.runs.clone(), Cell::new(0), clocks.wall);
        let writer = Writer { connection, queue: waiting, status, ids, limits, runs, now, ages, uncounted, lock };
        thread::Builder::new().name("store-write".into()).spawn(move || {
            lower_thread_priority();
            writer.run();
        })?;
        let retention = Retention::start(sweeper)?;
        Ok(OpenOutcome { store: Store { queue, readers, runs: dir.runs, now, retention }, recovery })
    }
}

impl OpenOptions<'_> {
    /// The writing connection, to a store that has been recovered.
    fn start(&self, dir: &DataDir) -> Result<(Connection, RecoveryReport), StoreFault> {
        let mut found = self.make_whole(dir)?;
        let made = writing(&dir.db).map_err(StoreFault::from);
        let made = made.and_then(|connection| self.recovered(connection, dir, &mut found));
        match made {
            Ok(connection) => Ok((connection, found)),
            // damage that the first check missed and that the writes of the start met
            Err(StoreFault::Corrupt(damage)) if found.moved_aside.is_none() => {
                let mut found = quarantine(dir, (self.clocks.wall)(), &damage)?;
                let connection = self.recovered(writing(&dir.db)?, dir, &mut found)?;
                Ok((connection, found))
            }
            Err(fault) => Err(fault),
        }
    }

    /// Ensures that there is a sound database.
    fn make_whole(&self, dir: &DataDir) -> Result<RecoveryReport, StoreFault> {
        if dir.next.exists() {
            return quarantine(dir, (self.clocks.wall)(), "putting a damaged store aside was cut short");
        }
        let (there, runs) = (dir.db.exists(), !dir.run_names()?.is_empty());
        let log = beside(&dir.db, "-wal").exists();
        if !there && !runs && !log {
            create_as(&dir.draft, &dir.db)?;
            dir.sync()?;
            return Ok(RecoveryReport { clean: true, ..RecoveryReport::default() });
        }
        let damage = if there { damage_of(&dir.db)? } else { Some("upm.db is missing".to_owned()) };
        if let Some(damage) = damage {
            return quarantine(dir, (self.clocks.wall)(), &damage);
        }
        // after a crash there is a log; without it the database is sound but may be outdated
        let lost = !log && !is_clean(&reading(&dir.db)?)?;
        let damage = lost.then(|| "upm.db-wal is missing: the jobs accepted last may be lost".to_owned());
        damage.iter().for_each(|damage| tracing::error!("{damage}"));
        Ok(RecoveryReport { clean: true, damage, ..RecoveryReport::default() })
    }

    fn recovered(
        &self,
        mut connection: Connection,
        dir: &DataDir,
        found: &mut RecoveryReport,
    ) -> Result<Connection, StoreFault> {
        restart_log(&connection)?;
        found.clean &= found.damage.is_none() && is_clean(&connection)?;
        recover(&mut connection, dir, self, found)?;
        // writes to the database file itself that the store is open now, in case the log is lost
        restart_log(&connection)?;
        Ok(connection)
    }
}

fn last_id(connection: &Connection) -> Result<Option<JobId>, StoreFault> {
    let sql = "SELECT id FROM jobs ORDER BY id DESC LIMIT 1";
    Ok(connection.query_row(sql, [], |row| row.get(0)).optional()?)
}
