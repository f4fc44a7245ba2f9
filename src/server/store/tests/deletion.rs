//! Deletion of jobs on request.

use super::*;
use crate::store::DeleteOutcome;

fn delete(store: &Store, id: JobId) -> DeleteOutcome {
    ask(|done| store.delete(&id, done)).unwrap()
}

#[test]
fn ended_job_is_deleted_with_its_events_and_its_run_folder() {
    let (_folder, store) = new_store(limits());
    let [gone, kept] = ["gone", "kept"].map(|name| begin(&store, name, "a").row.id);
    for id in [gone, kept] {
        append(&store, id, "{}").unwrap();
        store.finish(&id, end(JobState::Completed)).unwrap();
    }
    assert!(matches!(delete(&store, gone), DeleteOutcome::Now(row, None) if row.id == gone));
    assert_eq!(all_jobs(&store).iter().map(|row| row.id).collect::<Vec<_>>(), [kept]);
    assert!(ask(|done| store.replay(&gone, 0, 10, done)).unwrap().is_none());
    store.sweep().unwrap();
    assert!(!store.runs().join("gone").exists() && store.runs().join("kept").exists());
    assert_eq!(delete(&store, gone), DeleteOutcome::Unknown);
}

#[test]
fn deleted_queued_job_never_runs_and_reports_its_end() {
    let (_folder, store) = new_store(limits());
    let [first, second] = ["first", "second"].map(|name| queue(&store, name, "a").id);
    let DeleteOutcome::Now(row, Some(finished)) = delete(&store, first) else { panic!("not deleted") };
    assert_eq!((row.id, row.state, finished.kind.as_str()), (first, JobState::Cancelled, FINISHED));
    assert_eq!(store.claim("a", &super::folder(&store)).unwrap().unwrap().row.id, second);
}

#[test]
fn running_job_is_not_deleted() {
    let (_folder, store) = new_store(limits());
    let id = begin(&store, "runs", "a").row.id;
    assert!(matches!(delete(&store, id), DeleteOutcome::Not(row) if row.state == JobState::Running));
    store.sweep().unwrap();
    assert!(store.runs().join("runs").exists());
    store.finish(&id, end(JobState::Completed)).unwrap();
    assert!(matches!(delete(&store, id), DeleteOutcome::Now(..)));
}

#[test]
fn request_of_a_deleted_job_is_not_run_again_when_it_is_repeated() {
    let (folder, store) = new_store(limits());
    let keyed = || NewJob { key: Some("k".into()), ..new_job("one", "a") };
    let Ok(SubmitOutcome::New(row)) = accept(&store, keyed()) else { panic!("not accepted") };
    assert!(matches!(delete(&store, row.id), DeleteOutcome::Now(..)));
    assert_eq!(accept(&store, keyed()), Ok(SubmitOutcome::KeyReused));
    assert!(store.close(TIMEOUT));
    drop(store);
    let store = open(folder.path(), limits()).store;
    assert_eq!(accept(&store, keyed()), Ok(SubmitOutcome::KeyReused), "after a restart, too");
    assert!(matches!(accept(&store, new_job("one", "a")), Ok(SubmitOutcome::New(_))));
}

#[test]
fn key_of_a_deleted_job_stays_spent_when_a_damaged_store_is_replaced() {
    let (folder, store) = new_store(limits());
    let keyed = || NewJob { key: Some("k".into()), ..new_job("one", "a") };
    let Ok(SubmitOutcome::New(row)) = accept(&store, keyed()) else { panic!("not accepted") };
    delete(&store, row.id);
    assert!(store.close(TIMEOUT));
    drop(store);
    let database = folder.path().join("upm.db");
    crate::store::connection::writing(&database).unwrap().execute_batch("PRAGMA application_id = 0").unwrap();
    let OpenOutcome { store, recovery } = open(folder.path(), limits());
    assert!(recovery.damage.is_some());
    assert_eq!(accept(&store, keyed()), Ok(SubmitOutcome::KeyReused));
}

#[test]
fn key_of_a_deleted_job_is_forgotten_with_age() {
    static HOURS: AtomicI64 = AtomicI64::new(0);
    let folder = tempfile::tempdir().unwrap();
    let wall = || fixed_time() + Duration::from_secs(3600 * HOURS.load(Ordering::SeqCst).unsigned_abs());
    let store = Store::open(folder.path(), &plates(), limits(), Clocks::new(wall, Hours(&HOURS))).unwrap().store;
    let keyed = || NewJob { key: Some("k".into()), ..new_job("one", "a") };
    let Ok(SubmitOutcome::New(row)) = accept(&store, keyed()) else { panic!("not accepted") };
    delete(&store, row.id);
    HOURS.store(23, Ordering::SeqCst);
    assert_eq!(accept(&store, keyed()), Ok(SubmitOutcome::KeyReused));
    HOURS.store(25, Ordering::SeqCst);
    store.sweep().unwrap();
    assert!(matches!(accept(&store, keyed()), Ok(SubmitOutcome::New(_))));
}
