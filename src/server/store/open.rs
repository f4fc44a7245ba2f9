use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::thread;

use rusqlite::{Connection, OptionalExtension};

use super::ages::AgeClock;
use super::aside::{damage_of, set_aside};
use super::ballast::Ballast;
use super::handle::Store;
use super::ids::Ids;
use super::migrate::{MIGRATIONS, migrate, refuse_newer};
use super::orders::Orders;
use super::places::{Lock, Places, beside};
use super::private::make_private;
use super::reader::Readers;
use super::recover::{recover, uptime};
use super::retention::{Begins, Retention, Sweeper, empty_trash};
use super::schema;
use super::writer::{MOST_WAITING, Shown, Writer};
use super::{Clocks, JobId, Limits, Mended, Recovery, StoreFault};
use upm_core::priority::step_back;
use upm_core::time::MonotonicClock;

/// Repairs a recording that was not closed, first path, into a whole one, second path.
pub type RepairRecording<'a> = &'a dyn Fn(&Path, &Path) -> Result<Mended, String>;

/// A store and what was found when it was opened.
#[derive(Debug)]
pub struct Opened {
    /// The store.
    pub store: Store,
    /// What was found.
    pub recovery: Recovery,
}

/// What opening needs to know.
#[derive(Clone, Copy)]
pub(super) struct Opening<'a> {
    pub plates: &'a [String],
    pub limits: &'a Limits,
    pub clocks: &'a Clocks,
    pub repair: RepairRecording<'a>,
}

impl Store {
    /// Opens the store in the folder `data`, made if need be, and puts in order what a crash left behind. A damaged
    /// store is moved aside and a new one made of what can be saved; an older one is migrated, after a copy of it was
    /// made. Fails when another process has it, when the folder cannot be written, when its disk is full, and, with
    /// nothing changed, when a newer release wrote it.
    pub fn open(
        data: &Path,
        plates: &[String],
        limits: Limits,
        clocks: Clocks,
        repair: RepairRecording<'_>,
    ) -> Result<Opened, StoreFault> {
        let places = Places::in_folder(data)?;
        let folder = places.lock_folder()?;
        [&places.db, &places.next].into_iter().try_for_each(|db| refuse_newer(db))?;
        let lock = Lock { folder, file: places.lock_file()? };
        make_private(&places.data);
        places.make_folders()?;
        [&places.trash, &places.runs_trash].into_iter().for_each(|trash| empty_trash(trash));
        let mut ballast = Ballast::at(&places.reserve, limits.reserve_bytes);
        let opening = Opening { plates, limits: &limits, clocks: &clocks, repair };
        let mut made = opening.start(&places);
        if matches!(made, Err(StoreFault::Full)) && ballast.throw_off() {
            made = opening.start(&places);
        }
        let (connection, recovery) = made?;
        let held = places.held(&lock)?;
        let ids = Ids::above(last_id(&connection)?);
        let reading = vec![schema::reading(&places.db)?, schema::reading(&places.db)?];
        let readers = Readers::start(reading, Arc::clone(&clocks.monotonic))?;
        let (sender, waiting) = sync_channel(MOST_WAITING);
        let shown = Arc::new(Shown::new(MonotonicClock::new()));
        let orders = Orders { sender, shown: Arc::clone(&shown) };
        let begins = Begins::default();
        let ages = Arc::new(AgeClock::after(uptime(&connection)?, clocks.clone()));
        let sweeper =
            Sweeper::new(places.clone(), limits.clone(), Arc::clone(&ages), orders.clone(), Arc::clone(&begins));
        let (runs, told, now) = (places.runs.clone(), Cell::new(0), clocks.wall);
        let writer = Writer {
            connection,
            orders: waiting,
            shown,
            ids,
            limits,
            runs,
            now,
            ages: Arc::clone(&ages),
            ballast,
            told,
            lock,
        };
        thread::Builder::new().name("store-write".into()).spawn(move || {
            step_back();
            writer.run();
        })?;
        let retention = Retention::start(sweeper)?;
        Ok(Opened { store: Store { orders, readers, runs: places.runs, now, ages, retention, begins, held }, recovery })
    }
}

impl Opening<'_> {
    /// The connection that writes, to a store that is in order.
    fn start(&self, places: &Places) -> Result<(Connection, Recovery), StoreFault> {
        let mut found = self.make_whole(places)?;
        let made = schema::writing(&places.db).map_err(StoreFault::from);
        let made = made.and_then(|connection| self.recovered(connection, places, &mut found));
        match made {
            Ok(connection) => Ok((connection, found)),
            // hidden from the first look: what a start writes came upon it
            Err(StoreFault::Corrupt(damage)) if found.moved_aside.is_none() => {
                let mut found = set_aside(places, self, &damage)?;
                let connection = self.recovered(schema::writing(&places.db)?, places, &mut found)?;
                Ok((connection, found))
            }
            Err(fault) => Err(fault),
        }
    }

    /// Sees to it that there is a database, and a sound one.
    fn make_whole(&self, places: &Places) -> Result<Recovery, StoreFault> {
        if places.next.exists() {
            return set_aside(places, self, "putting a damaged store aside was cut short");
        }
        let (there, runs) = (places.db.exists(), !places.run_names()?.is_empty());
        let log = beside(&places.db, "-wal").exists();
        if !there && !runs && !log {
            schema::create_as(&places.draft, &places.db)?;
            places.sync()?;
            return Ok(Recovery { clean: true, ..Recovery::default() });
        }
        let damage = if there { damage_of(&places.db)? } else { Some("upm.db is missing".to_owned()) };
        if let Some(damage) = damage {
            return set_aside(places, self, &damage);
        }
        // after a crash the log is there; without it the store is as sound as it is old
        let lost = !log && !is_clean(&schema::reading(&places.db)?)?;
        let damage = lost.then(|| "upm.db-wal is missing: what was accepted last may be lost".to_owned());
        damage.iter().for_each(|damage| tracing::error!("{damage}"));
        Ok(Recovery { clean: true, damage, ..Recovery::default() })
    }

    fn recovered(
        &self,
        mut connection: Connection,
        places: &Places,
        found: &mut Recovery,
    ) -> Result<Connection, StoreFault> {
        schema::restart_log(&connection)?;
        migrate(&mut connection, places, MIGRATIONS)?;
        found.clean &= found.damage.is_none() && is_clean(&connection)?;
        recover(&mut connection, places, self, found)?;
        // that it is open now must be known without the log, too
        schema::restart_log(&connection)?;
        Ok(connection)
    }
}

/// True when the store was closed in order.
pub(super) fn is_clean(connection: &Connection) -> Result<bool, StoreFault> {
    Ok(connection.query_row("SELECT clean_shutdown FROM meta", [], |row| row.get(0))?)
}

fn last_id(connection: &Connection) -> Result<Option<JobId>, StoreFault> {
    let sql = "SELECT id FROM jobs ORDER BY id DESC LIMIT 1";
    Ok(connection.query_row(sql, [], |row| row.get(0)).optional()?)
}
