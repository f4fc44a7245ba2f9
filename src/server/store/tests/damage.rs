use std::fs;
use std::path::PathBuf;

use super::*;

/// A store with a queued, a running and an ended job, a used key and an audit entry, as a kill leaves it.
fn left_behind() -> (tempfile::TempDir, [JobId; 3]) {
    let (folder, store) = new_store(limits());
    let done = begin(&store, "done", "a").row.id;
    let run = store.runs().join("done");
    let effective =
        |name, plate| format!(r#"{{"version": "0", "job": {{"name": "{name}", "seed": 5, "plate": "{plate}"}}}}"#);
    fs::write(run.join("effective.json"), effective("done", "a")).unwrap();
    fs::write(run.join("report.json"), r#"{"outcome": "completed", "reason": "all there"}"#).unwrap();
    fs::write(run.join("run.rrd"), "rerun").unwrap();
    store.finish(&done, JobEnd { reason: "all there".into(), ..end(JobState::Completed) }).unwrap();
    let running = begin(&store, "running", "b").row.id;
    fs::write(store.runs().join("running/effective.json"), effective("running", "b")).unwrap();
    fs::write(store.runs().join("running/run.rrd"), "rerun").unwrap();
    let keyed = NewJob { key: Some("k".into()), ..new_job("queued", "a") };
    let Ok(SubmitOutcome::New(queued)) = accept(&store, keyed) else { panic!("not accepted") };
    store.audit(act("ann"));
    set_paused(&store, "a", false);
    set_paused(&store, "a", false);
    (snapshot(folder.path()), [done, running, queued.id])
}

/// The states of all jobs by name.
fn states(store: &Store) -> Vec<(String, JobState)> {
    let mut states: Vec<_> = all_jobs(store).into_iter().map(|row| (row.name, row.state)).collect();
    states.sort_by(|a, b| a.0.cmp(&b.0));
    states
}

/// The jobs and states that can be recovered from the run folders alone.
fn jobs_by_folders() -> [(String, JobState); 2] {
    [("done".to_owned(), JobState::Completed), ("running".to_owned(), JobState::Interrupted)]
}

/// Moves the log into the database file, so that a test can damage it.
fn into_one_file(data: &Path) {
    let connection = crate::store::connection::writing(&data.join("upm.db")).unwrap();
    crate::store::connection::empty_log(&connection).unwrap();
}

fn damaged(data: &Path) -> (Store, PathBuf, String) {
    let OpenOutcome { store, recovery } = open(data, limits());
    assert_eq!((recovery.clean, &recovery.paused), (false, &plates()));
    let (aside, damage) = (recovery.moved_aside.unwrap(), recovery.damage.unwrap());
    assert!(aside.exists() && aside.file_name().unwrap().to_str().unwrap().starts_with("upm.db.corrupt-2027"));
    assert_eq!(accept(&store, new_job("new", "a")).map(|answer| matches!(answer, SubmitOutcome::New(_))), Ok(true));
    let new = all_jobs(&store).remove(0).id;
    ask(|done| store.cancel_queued(&new, done)).unwrap();
    (store, aside, damage)
}

fn without_the_new_one(states: Vec<(String, JobState)>) -> Vec<(String, JobState)> {
    states.into_iter().filter(|(name, _)| name != "new").collect()
}

#[test]
fn garbage_is_moved_aside_and_history_recovered_from_run_folders() {
    let (data, _) = left_behind();
    fs::write(data.path().join("upm.db"), "garbage".repeat(1000)).unwrap();
    let log = fs::read(data.path().join("upm.db-wal")).unwrap();
    let (store, aside, damage) = damaged(data.path());
    assert!(damage.contains("not a database"), "{damage}");
    assert_eq!(without_the_new_one(states(&store)), jobs_by_folders());
    let kept = all_jobs(&store).into_iter().find(|row| row.name == "running").unwrap();
    assert_eq!((kept.plate.as_str(), kept.seed, kept.recording), ("b", 5, RecordingStatus::Partial));
    assert_eq!(fs::read(&aside).unwrap(), "garbage".repeat(1000).into_bytes());
    let log_aside = PathBuf::from(format!("{}-wal", aside.display()));
    assert_eq!(fs::read(log_aside).unwrap(), log);
}

#[test]
fn store_with_another_application_id_keeps_all_its_jobs() {
    let (data, ids) = left_behind();
    crate::store::connection::writing(&data.path().join("upm.db"))
        .unwrap()
        .execute_batch("PRAGMA application_id = 0")
        .unwrap();
    let (store, _, damage) = damaged(data.path());
    assert!(damage.contains("application id 00000000, expected 75706d31"), "{damage}");
    assert_eq!(ids.map(|id| job(&store, id).state), [JobState::Completed, JobState::Interrupted, JobState::Queued]);
    let keyed = NewJob { key: Some("k".into()), ..new_job("queued", "a") };
    assert!(matches!(accept(&store, keyed), Ok(SubmitOutcome::Replayed(row)) if row.id == ids[2]));
    let lines = ask(|done| store.audit_tail(10, done)).unwrap();
    assert_eq!(lines.into_iter().map(|line| line.entry.operator).collect::<Vec<_>>(), ["ann"]);
    let claimed = store.claim("a", &super::folder(&store)).unwrap().unwrap();
    assert_eq!((claimed.row.id, claimed.spec_json.as_str()), (ids[2], r#"{"name": "queued"}"#));
}

#[test]
fn zeroed_page_never_hides_a_run_or_starts_a_job() {
    let (left, _) = left_behind();
    into_one_file(left.path());
    let whole = fs::read(left.path().join("upm.db")).unwrap();
    let (mut noticed, pages) = (0, whole.len() / 4096);
    for page in 0..pages {
        let data = snapshot(left.path());
        let mut bytes = whole.clone();
        bytes[page * 4096..(page + 1) * 4096].fill(0);
        fs::write(data.path().join("upm.db"), bytes).unwrap();
        let OpenOutcome { store, recovery } = open(data.path(), limits());
        assert_eq!((recovery.clean, recovery.paused), (false, plates()), "page {page}");
        noticed += usize::from(recovery.damage.is_some());
        let ran: Vec<_> = states(&store).into_iter().filter(|(name, _)| name != "queued").collect();
        assert_eq!(ran, jobs_by_folders(), "page {page}");
    }
    assert!(noticed > pages / 2, "{noticed} of {pages}");
}

#[test]
fn store_truncated_anywhere_keeps_past_runs_and_starts_no_job() {
    let (left, _) = left_behind();
    into_one_file(left.path());
    let whole = fs::read(left.path().join("upm.db")).unwrap();
    for length in [0, 1, 100, 511, 512, 4095, 4096, 5000, whole.len() / 2, whole.len() - 4096, whole.len() - 1] {
        let data = snapshot(left.path());
        fs::write(data.path().join("upm.db"), &whole[..length]).unwrap();
        let (store, aside, _) = damaged(data.path());
        assert_eq!(fs::metadata(aside).unwrap().len(), length as u64);
        let ran: Vec<_> =
            without_the_new_one(states(&store)).into_iter().filter(|(name, _)| name != "queued").collect();
        assert_eq!(ran, jobs_by_folders(), "{length} bytes");
    }
}

#[test]
fn missing_log_is_reported() {
    let (data, ids) = left_behind();
    into_one_file(data.path());
    for ending in ["-wal", "-shm"] {
        fs::remove_file(data.path().join(format!("upm.db{ending}"))).unwrap();
    }
    let OpenOutcome { store, recovery } = open(data.path(), limits());
    assert_eq!((recovery.clean, recovery.moved_aside, recovery.paused), (false, None, plates()));
    assert!(recovery.damage.unwrap().contains("upm.db-wal is missing"));
    assert_eq!(job(&store, ids[2]).state, JobState::Queued);
}

#[test]
fn jobs_lost_with_the_log_are_recovered_from_their_folders() {
    let (data, _) = left_behind();
    for ending in ["-wal", "-shm"] {
        fs::remove_file(data.path().join(format!("upm.db{ending}"))).unwrap();
    }
    // as old as its creation: only the tables
    let OpenOutcome { store, recovery } = open(data.path(), limits());
    assert_eq!(recovery.paused, plates());
    assert_eq!(states(&store), jobs_by_folders());
}

#[test]
fn missing_database_is_recovered_from_run_folders() {
    let (data, _) = left_behind();
    fs::remove_file(data.path().join("upm.db")).unwrap();
    let OpenOutcome { store, recovery } = open(data.path(), limits());
    assert_eq!((recovery.damage.as_deref(), recovery.paused), (Some("upm.db is missing"), plates()));
    assert_eq!(states(&store), jobs_by_folders());
    let aside = recovery.moved_aside.unwrap();
    assert!(!aside.exists() && PathBuf::from(format!("{}-wal", aside.display())).exists());
}

#[test]
fn moving_aside_cut_short_is_taken_up_again() {
    let (left, ids) = left_behind();
    let version = |data: &Path| {
        crate::store::connection::writing(&data.join("upm.db"))
            .unwrap()
            .execute_batch("PRAGMA application_id = 0")
            .unwrap();
    };
    version(left.path());
    let done = snapshot(left.path());
    let (store, ..) = damaged(done.path());
    assert!(store.close(TIMEOUT));
    let next = fs::read(done.path().join("upm.db")).unwrap();
    for stage in ["drafted", "next", "moved"] {
        let data = snapshot(left.path());
        match stage {
            "drafted" => fs::write(data.path().join("upm.db.draft"), &next[..5000]).unwrap(),
            _ => fs::write(data.path().join("upm.db.next"), &next).unwrap(),
        }
        if stage == "moved" {
            fs::rename(data.path().join("upm.db"), data.path().join("upm.db.corrupt-1")).unwrap();
        }
        let OpenOutcome { store, recovery } = open(data.path(), limits());
        assert_eq!((recovery.clean, recovery.paused), (false, plates()), "{stage}");
        assert_eq!(ids.map(|id| job(&store, id).id), ids, "{stage}");
        assert_eq!(job(&store, ids[2]).state, JobState::Queued);
        assert!(!data.path().join("upm.db.next").exists() && !data.path().join("upm.db.draft").exists());
        assert!(store.close(TIMEOUT));
    }
}

#[test]
fn plates_are_known_from_the_second_start_on_and_after_damage() {
    let folder = tempfile::tempdir().unwrap();
    let OpenOutcome { store, recovery } = open(folder.path(), limits());
    assert_eq!(recovery.known, [""; 0]);
    assert!(store.close(TIMEOUT));
    let OpenOutcome { store, recovery } = open(folder.path(), limits());
    assert_eq!(recovery.known, plates());
    begin(&store, "run", "a");
    assert!(store.close(TIMEOUT));
    fs::remove_file(folder.path().join("upm.db")).unwrap();
    assert_eq!(open(folder.path(), limits()).recovery.known, plates());
}
