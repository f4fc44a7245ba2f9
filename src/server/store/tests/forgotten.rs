//! Jobs that ran, although the store has lost the record of it.

use std::fs;

use super::crashes::killed;
use super::*;

/// Fills the folder that a plate makes for a job.
fn run_of(store: &Store, row: &JobRow) -> std::path::PathBuf {
    let folder = store.runs().join(row.run_folder());
    fs::create_dir(&folder).unwrap();
    let effective = format!(r#"{{"version": "0", "job": {{"name": "{}", "seed": 5, "plate": "a"}}}}"#, row.name);
    fs::write(folder.join("effective.json"), effective).unwrap();
    folder
}

/// The job texts in the store.
fn texts(store: &Store) -> Vec<String> {
    let read = |tx: &crate::store::write_tx::WriteTx<'_>| {
        let mut statement = tx.connection.prepare("SELECT spec FROM specs ORDER BY job")?;
        statement.query_map([], |row| row.get(0))?.collect::<Result<Vec<String>, _>>()
    };
    store.queue.written(read).unwrap()
}

#[test]
fn a_job_that_waits_and_has_run_is_ended_and_never_run_again() {
    let (folder, store) = new_store(limits());
    let [cut, done, waiting, made] = ["cut", "done", "waiting", "made"].map(|name| queue(&store, name, "a"));
    run_of(&store, &cut);
    let report = r#"{"outcome": "completed", "reason": "all there"}"#;
    fs::write(run_of(&store, &done).join("report.json"), report).unwrap();
    fs::create_dir(store.runs().join(made.run_folder())).unwrap();
    let (_copy, OpenOutcome { store, recovery }) = killed(folder.path());
    assert_eq!((recovery.interrupted, recovery.ended), (vec![cut.id], vec![done.id]));
    assert_eq!((recovery.clean, recovery.paused, recovery.orphans.len()), (false, plates(), 0));
    let row = job(&store, cut.id);
    assert_eq!(
        (row.state, row.folder, row.started_at.is_some()),
        (JobState::Interrupted, Some(cut.run_folder()), true)
    );
    assert_eq!(job(&store, done.id).report_json.as_deref(), Some(report));
    let next = std::iter::from_fn(|| store.claim("a", &super::folder(&store)).unwrap());
    assert_eq!(next.map(|claimed| claimed.row.id).collect::<Vec<_>>(), [waiting.id, made.id]);
    assert_eq!(all_jobs(&store).len(), 4);
}

#[test]
fn run_is_recovered_as_one_job_after_a_lost_log() {
    let (folder, store) = new_store(limits());
    let row = queue(&store, "one", "a");
    run_of(&store, &row);
    let data = snapshot(folder.path());
    let connection = crate::store::connection::writing(&data.path().join("upm.db")).unwrap();
    crate::store::connection::empty_log(&connection).unwrap();
    drop(connection);
    for ending in ["-wal", "-shm"] {
        fs::remove_file(data.path().join(format!("upm.db{ending}"))).unwrap();
    }
    let OpenOutcome { store, recovery } = open(data.path(), limits());
    assert!(recovery.damage.unwrap().contains("upm.db-wal is missing"));
    let rows = all_jobs(&store);
    assert_eq!(rows.iter().map(|row| (row.id, row.state)).collect::<Vec<_>>(), [(row.id, JobState::Interrupted)]);
}

#[test]
fn run_is_recovered_as_one_job_after_the_store_is_moved_aside() {
    let (folder, store) = new_store(limits());
    let row = queue(&store, "one", "a");
    run_of(&store, &row);
    let data = snapshot(folder.path());
    crate::store::connection::writing(&data.path().join("upm.db"))
        .unwrap()
        .execute_batch("PRAGMA application_id = 0")
        .unwrap();
    let OpenOutcome { store, .. } = open(data.path(), limits());
    let rows = all_jobs(&store);
    assert_eq!(rows.iter().map(|row| (row.id, row.state)).collect::<Vec<_>>(), [(row.id, JobState::Interrupted)]);
}

#[test]
fn a_job_whose_folder_is_another_ones_ends_and_the_next_begins() {
    let (_folder, store) = new_store(limits());
    let first = begin(&store, "first", "a").row;
    let [blocked, next] = ["blocked", "next"].map(|name| queue(&store, name, "a").id);
    let make = folder(&store);
    let claimed = store.claim("a", &|row| if row.id == blocked { Ok("first".into()) } else { make(row) });
    assert_eq!(claimed.unwrap().unwrap().row.id, next);
    let row = job(&store, blocked);
    assert_eq!((row.state, row.folder), (JobState::Interrupted, None));
    assert!(row.reason.contains("belongs to another job"), "{}", row.reason);
    assert_eq!(job(&store, first.id).state, JobState::Running);
    assert!(store.runs().join("first").exists());
}

#[test]
fn the_text_of_a_job_stays_until_its_folder_has_it() {
    let (folder, store) = new_store(limits());
    let [failed, ran, cut] = ["failed", "ran", "cut"].map(|name| begin(&store, name, "a").row);
    fs::write(store.runs().join("ran/effective.json"), "{}").unwrap();
    store.finish(&failed.id, end(JobState::Failed)).unwrap();
    store.finish(&ran.id, end(JobState::Completed)).unwrap();
    let cancelled = queue(&store, "cancelled", "a");
    ask(|done| store.cancel_queued(&cancelled.id, done)).unwrap();
    let kept = [&failed, &cut].map(|row| format!("{{\"name\": {:?}}}", row.name));
    assert_eq!(texts(&store), kept);
    let (copy, OpenOutcome { store, .. }) = killed(folder.path());
    assert_eq!(texts(&store), kept, "a start keeps it, too");
    assert!(store.close(TIMEOUT));
    let version = crate::store::connection::writing(&copy.path().join("upm.db")).unwrap();
    version.execute_batch("PRAGMA application_id = 0").unwrap();
    drop(version);
    let limits = StoreLimits { jobs: 0, runs_bytes: 0, ..limits() };
    let OpenOutcome { store, recovery } = open(copy.path(), limits);
    assert_eq!((recovery.moved_aside.is_some(), texts(&store).as_slice()), (true, kept.as_slice()));
    store.sweep().unwrap();
    assert_eq!(texts(&store), [""; 0], "forgotten with the job");
}
