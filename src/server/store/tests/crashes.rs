use std::fs;

use super::*;
use crate::states::PauseCause;
use crate::store::RecoveryReport;
use crate::store::VERSION;
use crate::store::schema::APPLICATION_ID;

/// Names of the plates that are paused.
fn paused(recovery: &RecoveryReport) -> Vec<String> {
    recovery.paused.iter().map(|(plate, _)| plate.clone()).collect()
}

#[test]
fn nothing_that_was_answered_is_lost_and_nothing_runs_twice() {
    let (folder, store) = new_store(limits());
    let begun = begin(&store, "one", "a");
    let (running, waiting) = (begun.id, queue(&store, "two", "a").id);
    fs::write(self::folder(&store, &begun).join("journal.jsonl"), "{}\n").unwrap();
    let (_copy, (again, recovery)) = killed(folder.path());
    assert_eq!((paused(&recovery), &recovery.known), (plates(), &plates()));
    assert_eq!((recovery.clean, recovery.interrupted, recovery.ended), (false, vec![running], vec![]));
    let row = job(&again, running);
    assert_eq!((row.state, row.reason.as_str()), (JobState::Interrupted, "the daemon ended while it ran"));
    assert_eq!((row.finished_at.is_some(), row.recording), (true, RecordingStatus::None));
    assert_eq!(fs::read_to_string(self::folder(&again, &row).join("journal.jsonl")).unwrap(), "{}\n");
    assert_eq!(claim(&again, "a").unwrap().id, waiting);
    assert_eq!(claim(&again, "a"), None);
}

#[test]
fn store_killed_after_any_write_opens_with_that_write() {
    let (folder, store) = new_store(limits());
    let states = |data: &Path| -> Vec<JobState> { killed(data).1.0.all_jobs().iter().map(|row| row.state).collect() };
    assert_eq!(states(folder.path()), []);
    let id = queue(&store, "one", "a").id;
    assert_eq!(states(folder.path()), [JobState::Queued]);
    claim(&store, "a").unwrap();
    assert_eq!(states(folder.path()), [JobState::Interrupted]);
    finish(&store, &id, JobState::Completed).unwrap();
    assert_eq!(states(folder.path()), [JobState::Completed]);
    fs::remove_file(folder.path().join("upm.db-shm")).unwrap();
    assert_eq!(states(folder.path()), [JobState::Completed], "the index of the log is made anew");
}

#[test]
fn empty_folder_of_a_claim_that_was_never_stored_goes_and_a_run_stays() {
    let (folder, store) = new_store(limits());
    let name = queue(&store, "one", "a").run_folder();
    fs::create_dir_all(store.runs().join(&name)).unwrap();
    let (copy, (again, _)) = killed(folder.path());
    assert!(!again.runs().join(&name).exists());
    fs::create_dir_all(again.runs().join(&name)).unwrap();
    fs::write(again.runs().join(&name).join("journal.jsonl"), "{}\n").unwrap();
    let (_copy, (again, _)) = killed(copy.path());
    assert!(again.runs().join(&name).join("journal.jsonl").exists());
}

#[test]
fn store_cut_off_while_it_is_made_is_made_again() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("upm.db"), "").unwrap();
    queue(&open(folder.path(), limits()).0, "one", "a");
}

/// Killed between the last page of the database and the end of its rollback journal.
#[test]
fn store_killed_at_the_end_of_its_making_is_made_again() {
    let (made, folder) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let copy = |name: &str| fs::copy(made.path().join(name), folder.path().join(name)).unwrap();
    let connection = rusqlite::Connection::open(made.path().join("upm.db")).unwrap();
    let header = format!("PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION};");
    // so large that pages are written before the end, and the journal before them
    let begun =
        "PRAGMA cache_size = 1; BEGIN; CREATE TABLE of_then (x); INSERT INTO of_then VALUES (zeroblob(100000));";
    connection.execute_batch(&(begun.to_owned() + &header)).unwrap();
    copy("upm.db-journal");
    connection.execute_batch("COMMIT").unwrap();
    copy("upm.db");
    queue(&open(folder.path(), limits()).0, "one", "a");
}

#[test]
fn after_an_orderly_end_only_plates_with_work_or_a_pause_are_paused() {
    let (folder, store) = new_store(limits());
    queue(&store, "one", "b");
    assert!(store.close(TIMEOUT));
    let (store, recovery) = open(folder.path(), limits());
    assert_eq!((recovery.clean, recovery.paused), (true, vec![("b".to_owned(), PauseCause::restarted())]));
    let set_pause = |store: &Store, act, pause: Option<&PauseCause>| {
        store.set_pause("b", pause, &AuditEntry::of_plate("b", act, "why")).unwrap();
    };
    set_pause(&store, AuditEntry::RESUME, None);
    let id = claim(&store, "b").unwrap().id;
    finish(&store, &id, JobState::Completed).unwrap();
    assert!(store.close(TIMEOUT));
    let (store, recovery) = open(folder.path(), limits());
    assert_eq!((recovery.clean, recovery.paused), (true, vec![]));
    let pause = PauseCause::new("part_lost", "a part is lost", "put it back");
    set_pause(&store, AuditEntry::PAUSE, Some(&pause));
    assert!(store.close(TIMEOUT));
    let (_, recovery) = open(folder.path(), limits());
    assert_eq!((recovery.clean, recovery.paused), (true, vec![("b".to_owned(), pause)]));
}

#[test]
fn job_left_on_its_plate_at_an_orderly_end_pauses_all() {
    let (folder, store) = new_store(limits());
    let id = begin(&store, "one", "a").id;
    assert!(store.close(TIMEOUT));
    let (_, recovery) = open(folder.path(), limits());
    assert_eq!((recovery.clean, paused(&recovery), recovery.interrupted), (false, plates(), vec![id]));
}

#[test]
fn run_that_had_ended_keeps_its_outcome_and_a_damaged_folder_harms_its_job_alone() {
    let (folder, store) = new_store(limits());
    let stopped = |code: &str| format!(r#"{{"outcome": "cancelled", "reason": "why", "stop": {{"code": "{code}"}}}}"#);
    let runs = [
        ("done", r#"{"outcome": "completed", "reason": "all there"}"#.to_owned(), JobState::Completed, "all there"),
        (
            "lost",
            r#"{"outcome": "failed", "reason": "a part was lost"}"#.to_owned(),
            JobState::Failed,
            "a part was lost",
        ),
        ("asked", stopped("cancelled"), JobState::Cancelled, "why"),
        ("ended", stopped("shutdown"), JobState::Interrupted, "why"),
        ("cut", r#"{"outcome": "comp"#.to_owned(), JobState::Interrupted, "the daemon ended while it ran"),
        ("odd", r#"{"outcome": "running"}"#.to_owned(), JobState::Interrupted, "the daemon ended while it ran"),
    ];
    let ids = runs.each_ref().map(|(name, report, ..)| {
        let row = begin(&store, name, "a");
        fs::write(self::folder(&store, &row).join("report.json"), report).unwrap();
        row.id
    });
    let gone = begin(&store, "gone", "a");
    fs::remove_dir(self::folder(&store, &gone)).unwrap();
    let (_copy, (store, recovery)) = killed(folder.path());
    assert_eq!((recovery.ended.len(), recovery.interrupted.len()), (3, 4));
    for ((name, _, state, reason), id) in runs.into_iter().zip(ids) {
        let row = job(&store, id);
        assert_eq!((row.state, row.reason.as_str()), (state, reason), "{name}");
        assert_eq!(row.progress, if state == JobState::Completed { 1.0 } else { 0.0 });
    }
    assert_eq!(job(&store, gone.id).state, JobState::Interrupted);
}

#[test]
#[cfg(target_os = "linux")]
fn recording_is_as_its_report_says_and_fifos_do_not_block_the_start() {
    use rustix::fs::{CWD, FileType, Mode, mknodat};

    let (folder, store) = new_store(limits());
    let failed = r#"{"outcome": "completed", "recording": "it lags"}"#;
    let runs = [
        ("failed", Some(failed), RecordingStatus::Failed),
        ("whole", Some(r#"{"outcome": "completed"}"#), RecordingStatus::Whole),
        ("cut", None, RecordingStatus::Partial),
    ];
    let ids = runs.map(|(name, report, _)| {
        let row = begin(&store, name, "a");
        let run = self::folder(&store, &row);
        fs::write(run.join("run.rrd"), "rerun").unwrap();
        report.into_iter().for_each(|report| fs::write(run.join("report.json"), report).unwrap());
        row.id
    });
    let fifo = begin(&store, "fifo", "a");
    drop(store);
    for file in ["journal.jsonl", "run.rrd", "report.json"] {
        let path = folder.path().join("runs").join(fifo.folder.as_ref().unwrap()).join(file);
        mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    }
    let store = open(folder.path(), limits()).0;
    assert_eq!(ids.map(|id| job(&store, id).recording), runs.map(|(.., kept)| kept));
    assert_eq!(job(&store, fifo.id).recording, RecordingStatus::Partial);
}

#[test]
fn data_folder_belongs_to_one_daemon_and_one_that_cannot_be_made_is_named() {
    let (folder, store) = new_store(limits());
    let refused = try_open(folder.path(), limits()).unwrap_err();
    assert!(refused.to_string().contains("belongs to another daemon that is running"), "{refused}");
    assert!(store.close(TIMEOUT));
    try_open(folder.path(), limits()).unwrap();
    let refused = try_open(&folder.path().join("upm.db/data"), limits()).unwrap_err().to_string();
    assert!(refused.contains("upm.db/data"), "{refused}");
}

#[test]
fn file_that_is_no_store_of_this_version_is_refused_and_left_untouched() {
    let (folder, store) = new_store(limits());
    queue(&store, "one", "a");
    assert!(store.close(TIMEOUT));
    let path = folder.path().join("upm.db");
    let mut sound = fs::read(&path).unwrap();
    let other = |at: usize, bytes: &[u8]| {
        let mut text = sound.clone();
        text[at..at + bytes.len()].copy_from_slice(bytes);
        text
    };
    let files = [
        (other(60, &[0, 0, 0, 9]), "expected a job store of version 4, found version 9: choose another data folder"),
        (other(68, b"song"), "expected a job store of version 4, found another database: choose another data folder"),
        (
            b"notes of a person".to_vec(),
            "expected a job store of version 4, found no database: choose another data folder",
        ),
    ];
    for (text, wanted) in files {
        fs::write(&path, &text).unwrap();
        let refused = try_open(folder.path(), limits()).unwrap_err().to_string();
        assert_eq!(refused, format!("{}: {wanted}", path.display()));
        assert_eq!(fs::read(&path).unwrap(), text);
    }
    sound.iter_mut().skip(4096).for_each(|byte| *byte = 0x5a);
    fs::write(&path, &sound).unwrap();
    fs::remove_file(folder.path().join("upm.db-wal")).ok();
    assert!(matches!(try_open(folder.path(), limits()), Err(StoreError::Corrupt(_))));
    assert_eq!(fs::read(&path).unwrap(), sound, "a damaged store stays as it is");
}

#[test]
fn audit_log_is_append_only() {
    let (_folder, store) = new_store(limits());
    store.audit(&AuditEntry::of_plate("a", AuditEntry::PAUSE, "why")).unwrap();
    for sql in ["DELETE FROM audit", "UPDATE audit SET act = ''"] {
        assert!(store.read(|connection| connection.execute(sql, [])).is_err(), "{sql}");
    }
    assert_eq!(store.audit_log(), [("pause".to_owned(), String::new())]);
}

#[test]
fn writes_survive_a_power_cut() {
    assert!(rusqlite::version_number() >= 3_051_003, "without the fix for resets of the log: {}", rusqlite::version());
    let (_folder, store) = new_store(limits());
    let pragma = |name| store.read(|connection| connection.pragma_query_value(None, name, |row| row.get(0)));
    assert_eq!(pragma("synchronous"), Ok(2));
    let mode: String =
        store.read(|connection| connection.pragma_query_value(None, "journal_mode", |row| row.get(0))).unwrap();
    assert_eq!(mode, "wal");
}

#[test]
fn ids_rise_across_a_clock_set_back() {
    let (folder, store) = new_store(limits());
    let first = queue(&store, "one", "a").id;
    assert!(store.close(TIMEOUT));
    let store = Store::open(folder.path(), &plates(), QUEUE, limits(), || Timestamp::UNIX_EPOCH).unwrap().0;
    let row = queue(&store, "two", "a");
    assert!(row.id > first);
    claim(&store, "a").unwrap();
}
