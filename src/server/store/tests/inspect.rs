use std::collections::BTreeSet;
use std::fs;

use super::*;
use crate::store::{InspectLimits, StoreSnapshot, inspect};

const MOST: InspectLimits = InspectLimits { jobs: 10, events: 3, audit: 10 };

fn names(folder: &Path) -> BTreeSet<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// Two jobs, the second with four events and one audit entry; returns the second.
fn filled(store: &Store) -> JobId {
    queue(store, "one", "a");
    let id = begin(store, "two", "b").row.id;
    (1..=4).for_each(|seq| assert_eq!(append(store, id, "{}"), Ok(seq)));
    store.audit(act("me"));
    while ask(|done| store.audit_tail(1, done)).unwrap().is_empty() {
        std::thread::yield_now();
    }
    id
}

fn assert_filled(snapshot: &StoreSnapshot, id: JobId) {
    assert_eq!(snapshot.jobs.iter().map(|row| row.name.as_str()).collect::<Vec<_>>(), ["two", "one"]);
    let seen: Vec<(JobId, u64)> = snapshot.events.iter().map(|(job, event)| (*job, event.seq)).collect();
    assert_eq!(seen, [(id, 4), (id, 3), (id, 2)]);
    assert_eq!(snapshot.audit[0].entry.operator, "me");
    assert_eq!(snapshot.counts, [("a".into(), JobState::Queued, 1), ("b".into(), JobState::Running, 1)]);
    assert!(!snapshot.is_closed);
}

#[test]
fn a_store_that_is_in_use_is_seen_and_not_held_up() {
    let (folder, store) = new_store(limits());
    let id = filled(&store);
    assert_filled(&inspect(folder.path(), MOST).unwrap(), id);
    queue(&store, "three", "a");
    assert_eq!(inspect(folder.path(), InspectLimits { jobs: 1, ..MOST }).unwrap().jobs[0].name, "three");
}

#[test]
fn peek_after_a_crash_sees_the_log_and_leaves_it() {
    let (folder, store) = new_store(limits());
    let id = filled(&store);
    let left = tempfile::tempdir().unwrap();
    for name in ["upm.db", "upm.db-wal"] {
        fs::copy(folder.path().join(name), left.path().join(name)).unwrap();
    }
    drop(store);
    let bytes = |name: &str| fs::read(left.path().join(name)).unwrap();
    let before = [bytes("upm.db"), bytes("upm.db-wal")];
    assert_filled(&inspect(left.path(), MOST).unwrap(), id);
    assert!(before == [bytes("upm.db"), bytes("upm.db-wal")]);
    assert_eq!(open(left.path(), limits()).recovery.interrupted, [id]);
}

/// Peeking must not create a log: the next start treats a missing log as a loss.
#[test]
fn no_log_is_made() {
    let (folder, store) = new_store(limits());
    assert!(store.close(TIMEOUT));
    drop(store);
    let left = tempfile::tempdir().unwrap();
    let odd = left.path().join("100 % öd?");
    fs::create_dir(&odd).unwrap();
    fs::copy(folder.path().join("upm.db"), odd.join("upm.db")).unwrap();
    inspect(&odd, MOST).unwrap();
    assert_eq!(names(&odd), BTreeSet::from(["upm.db".to_owned()]));
}

#[test]
fn non_store_file_is_reported_and_left_untouched() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(inspect(folder.path(), MOST), Err(StoreFault::Io(_))));
    assert_eq!(names(folder.path()).len(), 0);
    fs::write(folder.path().join("upm.db"), "no database".repeat(500)).unwrap();
    assert!(matches!(inspect(folder.path(), MOST), Err(StoreFault::Corrupt(_))));
    assert_eq!(names(folder.path()).len(), 1);
}
