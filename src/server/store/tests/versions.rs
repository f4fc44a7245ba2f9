//! Stores of older and newer releases.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;

use super::*;
use crate::store::connection::{reading, writing};
use crate::store::layout::DataDir;
use crate::store::schema::{APPLICATION_ID, MIGRATIONS, OLDEST, VERSION, identity, migrate};

/// For each migration the statements that undo it.
const UNDO: [&str; MIGRATIONS.len()] = [
    "DROP INDEX jobs_standing; ALTER TABLE jobs DROP COLUMN standing;",
    "DROP TABLE clock; DROP INDEX keys_by_uptime; CREATE INDEX keys_by_age ON keys (at);
     ALTER TABLE keys DROP COLUMN uptime; ALTER TABLE jobs DROP COLUMN ended_uptime;",
    "DROP TABLE spent_keys;",
    "ALTER TABLE jobs DROP COLUMN turn;",
];

/// Turns a closed store into one of an older version.
fn make_older(data: &Path, version: i32) {
    let connection = writing(&data.join("upm.db")).unwrap();
    let undo = UNDO.iter().skip((version - OLDEST) as usize).rev();
    undo.for_each(|undo| connection.execute_batch(undo).unwrap());
    connection.pragma_update(None, "user_version", version).unwrap();
}

/// All files below a folder with their contents, except SQLite's index of the log, which holds no data and which every
/// reader changes.
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
    assert!(store.close(TIMEOUT));
    drop(store);
    writing(&folder.path().join("upm.db")).unwrap().execute_batch("PRAGMA user_version = 99").unwrap();
    let before = contents(folder.path());
    let fault = try_open(folder.path(), limits()).map(|_| ()).unwrap_err();
    let file = folder.path().join("upm.db").display().to_string();
    assert_eq!(fault, StoreFault::Newer { file, found: 99, known: VERSION });
    assert!(fault.to_string().contains(&format!("version 99, expected version {VERSION} or older")), "{fault}");
    assert!(contents(folder.path()) == before, "something was changed");
}

#[test]
fn store_of_every_older_version_is_copied_and_migrated_with_all_its_jobs() {
    for version in OLDEST..VERSION {
        let (folder, store) = new_store(limits());
        let standing = store.begin_standing(&new_job("standing", "b"), &super::folder(&store)).unwrap().unwrap().row.id;
        let done = begin(&store, "done", "a").row.id;
        for id in [standing, done] {
            store.finish(&id, end(JobState::Completed)).unwrap();
        }
        let keyed = NewJob { key: Some("k".into()), ..new_job("waiting", "a") };
        let Ok(SubmitOutcome::New(waiting)) = accept(&store, keyed.clone()) else { panic!("not accepted") };
        assert!(store.close(TIMEOUT));
        make_older(folder.path(), version);
        let OpenOutcome { store, recovery } = open(folder.path(), limits());
        assert_eq!((recovery.damage, recovery.moved_aside, recovery.clean), (None, None, true), "version {version}");
        let kept: Vec<_> = all_jobs(&store).into_iter().map(|row| (row.id, row.state, row.standing)).collect();
        let was_known = version > OLDEST; // the first version had no standing jobs
        let [completed, queued] = [JobState::Completed, JobState::Queued];
        let expected = [(waiting.id, queued, false), (done, completed, false), (standing, completed, was_known)];
        assert_eq!(kept, expected, "version {version}");
        assert!(matches!(accept(&store, keyed), Ok(SubmitOutcome::Replayed(row)) if row.id == waiting.id));
        assert_eq!(store.claim("a", &super::folder(&store)).unwrap().unwrap().row.id, waiting.id);
        let copy = reading(&folder.path().join(format!("upm.db.v{version}"))).unwrap();
        let queued = "SELECT count(*) FROM jobs WHERE state = 'queued'";
        assert_eq!(
            (identity(&copy), copy.query_row(queued, [], |row| row.get::<_, i64>(0))),
            (Ok((APPLICATION_ID, version)), Ok(1))
        );
    }
}

#[test]
fn readable_data_of_an_older_release_become_private_when_the_store_is_opened() {
    let (folder, store) = new_store(limits());
    assert!(store.close(TIMEOUT));
    let paths = ["", "upm.db", "lock", "runs"].map(|name| folder.path().join(name));
    for path in &paths {
        let mode = if path.is_dir() { 0o755 } else { 0o644 };
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    }
    let _opened = open(folder.path(), limits());
    let modes = paths.map(|path| fs::metadata(path).unwrap().permissions().mode() & 0o777);
    assert_eq!(modes, [0o700, 0o600, 0o600, 0o700]);
}

#[test]
fn migration_that_fails_changes_nothing() {
    let (folder, store) = new_store(limits());
    assert!(store.close(TIMEOUT));
    drop(store);
    let dir = DataDir::in_folder(folder.path()).unwrap();
    let mut connection = writing(&dir.db).unwrap();
    let is_there = |connection: &rusqlite::Connection| connection.prepare("SELECT a FROM extra").is_ok();
    let list = |last: &'static str| [MIGRATIONS, &["CREATE TABLE extra (a INTEGER)", last]].concat();
    assert!(migrate(&mut connection, &dir, &list("CREATE TABLE extra (b INTEGER)")).is_err());
    assert_eq!((identity(&connection), is_there(&connection)), (Ok((APPLICATION_ID, VERSION)), false));
    let copy = migrate(&mut connection, &dir, &list("ALTER TABLE extra ADD COLUMN b INTEGER")).unwrap().unwrap();
    assert_eq!((identity(&connection), is_there(&connection)), (Ok((APPLICATION_ID, VERSION + 2)), true));
    assert_eq!(copy, folder.path().join(format!("upm.db.v{VERSION}")));
    assert!(!is_there(&reading(&copy).unwrap()), "the copy is as it was");
    assert_eq!(migrate(&mut connection, &dir, &list("never reached")).unwrap(), None);
}
