//! Stores of older and newer releases.

use std::collections::BTreeMap;
use std::fs;

use super::*;
use crate::store::migrate::{MIGRATIONS, VERSION, migrate, version_of};
use crate::store::places::Places;
use crate::store::schema::{reading, writing};

/// Makes a closed store one of version 1.
fn make_oldest(data: &Path) {
    let connection = writing(&data.join("upm.db")).unwrap();
    let undo = "DROP TABLE clock; DROP INDEX keys_by_uptime; CREATE INDEX keys_by_age ON keys (at);
                ALTER TABLE keys DROP COLUMN uptime; ALTER TABLE jobs DROP COLUMN ended_uptime; DROP INDEX jobs_standing; ALTER TABLE jobs DROP COLUMN standing; PRAGMA user_version = 1";
    connection.execute_batch(undo).unwrap();
}

/// All files below a folder with their contents, but for SQLite's index of the log, which holds no data and which every
/// reader takes part in.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => found.extend(contents(&path)),
            false if path.ends_with("upm.db-shm") => {}
            false => _ = found.insert(path.display().to_string(), fs::read(&path).unwrap()),
        }
    }
    found
}

#[test]
fn newer_store_is_refused_and_left_untouched() {
    let (folder, store) = new_store(limits());
    queue(&store, "one", "a");
    assert!(store.close(PATIENCE));
    drop(store);
    writing(&folder.path().join("upm.db")).unwrap().execute_batch("PRAGMA user_version = 99").unwrap();
    fs::write(folder.path().join(".trash/left"), "by an earlier sweep").unwrap();
    fs::remove_file(folder.path().join("reserve")).unwrap();
    let before = contents(folder.path());
    let fault = try_open(folder.path(), limits()).map(|_| ()).unwrap_err();
    let file = folder.path().join("upm.db").display().to_string();
    assert_eq!(fault, StoreFault::Newer { file, found: 99, known: VERSION });
    assert!(fault.to_string().contains(&format!("version 99, expected version {VERSION} or older")), "{fault}");
    assert!(contents(folder.path()) == before, "something was changed");
}

#[test]
fn older_store_is_copied_and_migrated_with_all_its_jobs() {
    let (folder, store) = new_store(limits());
    let [done, waiting] = ["done", "waiting"].map(|name| queue(&store, name, "a").id);
    store.claim("a", &super::folder(&store)).unwrap().unwrap();
    store.ended(&done, end(JobState::Completed)).unwrap();
    assert!(store.close(PATIENCE));
    make_oldest(folder.path());
    let Opened { store, recovery } = open(folder.path(), limits());
    assert_eq!((recovery.damage, recovery.moved_aside, recovery.clean), (None, None, true));
    let rows = all_jobs(&store);
    let kept: Vec<_> = rows.iter().map(|row| (row.id, row.state, row.standing)).collect();
    assert_eq!(kept, [(waiting, JobState::Queued, false), (done, JobState::Completed, false)]);
    assert_eq!(store.claim("a", &super::folder(&store)).unwrap().unwrap().row.id, waiting);
    let copy = reading(&folder.path().join("upm.db.v1")).unwrap();
    let queued = "SELECT count(*) FROM jobs WHERE state = 'queued'";
    assert_eq!((version_of(&copy), copy.query_row(queued, [], |row| row.get::<_, i64>(0))), (Ok(1), Ok(1)));
}

#[test]
fn migration_that_fails_changes_nothing() {
    let (folder, store) = new_store(limits());
    assert!(store.close(PATIENCE));
    drop(store);
    let places = Places::in_folder(folder.path()).unwrap();
    let mut connection = writing(&places.db).unwrap();
    let is_there = |connection: &rusqlite::Connection| connection.prepare("SELECT a FROM extra").is_ok();
    let list = |last: &'static str| [MIGRATIONS, &["CREATE TABLE extra (a INTEGER)", last]].concat();
    assert!(migrate(&mut connection, &places, &list("CREATE TABLE extra (b INTEGER)")).is_err());
    assert_eq!((version_of(&connection), is_there(&connection)), (Ok(VERSION), false));
    let copy = migrate(&mut connection, &places, &list("ALTER TABLE extra ADD COLUMN b INTEGER")).unwrap().unwrap();
    assert_eq!((version_of(&connection), is_there(&connection)), (Ok(VERSION + 2), true));
    assert_eq!(copy, folder.path().join(format!("upm.db.v{VERSION}")));
    assert!(!is_there(&reading(&copy).unwrap()), "the copy is as it was");
    assert_eq!(migrate(&mut connection, &places, &list("never reached")).unwrap(), None);
}
