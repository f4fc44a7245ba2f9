use std::fs;

use super::*;

/// A store killed now and opened again: everything it had answered is on the disk.
pub(super) fn killed(data: &Path) -> (tempfile::TempDir, OpenOutcome) {
    let copy = snapshot(data);
    let opened = open(copy.path(), limits());
    (copy, opened)
}

#[test]
fn nothing_that_was_answered_is_lost() {
    let (folder, store) = new_store(limits());
    let running = begin(&store, "one", "a").row.id;
    let waiting = queue(&store, "two", "a").id;
    assert_eq!(append(&store, running, "{}"), Ok(1));
    fs::write(store.runs().join("one/journal.jsonl"), "{}\n").unwrap();
    let (_copy, OpenOutcome { store: again, recovery }) = killed(folder.path());
    assert_eq!((recovery.clean, recovery.damage, recovery.moved_aside), (false, None, None));
    assert_eq!((recovery.interrupted, recovery.ended), (vec![running], vec![]));
    assert_eq!(recovery.paused, plates());
    let row = job(&again, running);
    assert_eq!((row.state, row.reason.as_str()), (JobState::Interrupted, "the daemon ended while it ran"));
    assert_eq!((row.finished_at.is_some(), row.recording), (true, RecordingStatus::None));
    assert_eq!(fs::read_to_string(again.runs().join("one/journal.jsonl")).unwrap(), "{}\n");
    assert_eq!(job(&again, waiting).state, JobState::Queued);
    let events = ask(|done| again.replay(&running, 1, 9, done)).unwrap().unwrap().events;
    assert_eq!(events.iter().map(|event| (event.seq, event.kind.as_str())).collect::<Vec<_>>(), [(2, FINISHED)]);
    assert!(events[0].body.contains(r#""state":"interrupted""#), "{events:?}");
    assert_eq!(append(&again, running, "{}"), Ok(3));
    // the queued job runs on demand, the other never again
    assert_eq!(again.claim("a", &super::folder(&again)).unwrap().unwrap().row.id, waiting);
    assert_eq!(again.claim("a", &super::folder(&again)), Ok(None));
}

#[test]
fn a_store_dropped_or_forgotten_was_not_closed_in_order() {
    let (folder, store) = new_store(limits());
    queue(&store, "one", "b");
    drop(store);
    let OpenOutcome { store, recovery } = open(folder.path(), limits());
    assert_eq!((recovery.clean, recovery.paused, recovery.damage), (false, plates(), None));
    std::mem::forget(store);
    let (_copy, opened) = killed(folder.path());
    assert_eq!((opened.recovery.clean, all_jobs(&opened.store).len()), (false, 1));
}

#[test]
fn after_an_orderly_end_only_plates_with_work_are_paused() {
    let (folder, store) = new_store(limits());
    queue(&store, "one", "b");
    assert!(store.close(TIMEOUT));
    let OpenOutcome { store, recovery } = open(folder.path(), limits());
    assert_eq!((recovery.clean, recovery.paused), (true, vec!["b".to_owned()]));
    set_paused(&store, "b", false);
    let id = store.claim("b", &super::folder(&store)).unwrap().unwrap().row.id;
    store.finish(&id, end(JobState::Completed)).unwrap();
    assert!(store.close(TIMEOUT));
    let OpenOutcome { recovery, .. } = open(folder.path(), limits());
    assert_eq!((recovery.clean, recovery.paused), (true, vec![]));
}

#[test]
fn a_job_left_on_its_plate_at_an_orderly_end_pauses_all() {
    let (folder, store) = new_store(limits());
    let id = begin(&store, "one", "a").row.id;
    assert!(store.close(TIMEOUT));
    let OpenOutcome { recovery, .. } = open(folder.path(), limits());
    assert_eq!((recovery.clean, recovery.paused), (false, plates()));
    assert_eq!(recovery.interrupted, [id]);
}

#[test]
fn a_run_that_the_daemon_ended_is_interrupted_and_one_that_a_person_ended_cancelled() {
    let (folder, store) = new_store(limits());
    let ends = [
        ("daemon", "shutdown", JobState::Interrupted),
        ("asked", "cancelled", JobState::Cancelled),
        ("stopped", "estop", JobState::Cancelled),
    ];
    let ids = ends.map(|(name, code, _)| {
        let id = begin(&store, name, "a").row.id;
        let report = format!(r#"{{"outcome": "cancelled", "reason": "why", "stop": {{"code": "{code}"}}}}"#);
        fs::write(store.runs().join(name).join("report.json"), report).unwrap();
        id
    });
    let (_copy, OpenOutcome { store, recovery }) = killed(folder.path());
    assert_eq!((recovery.interrupted, recovery.ended), (ids[..1].to_vec(), ids[1..].to_vec()));
    for ((_, _, state), id) in ends.into_iter().zip(ids) {
        let row = job(&store, id);
        assert_eq!((row.state, row.reason.as_str(), row.report_json.is_some()), (state, "why", true));
    }
}

#[test]
fn a_run_that_had_ended_keeps_its_outcome() {
    let (folder, store) = new_store(limits());
    let reports = [
        ("done", r#"{"outcome": "completed", "reason": "all there"}"#, JobState::Completed, "all there"),
        ("lost", r#"{"outcome": "failed", "reason": "a part was lost"}"#, JobState::Failed, "a part was lost"),
        ("cut", r#"{"outcome": "comp"#, JobState::Interrupted, "the daemon ended while it ran"),
        ("odd", r#"{"outcome": "running"}"#, JobState::Interrupted, "the daemon ended while it ran"),
    ];
    let ids = reports.map(|(name, report, ..)| {
        let id = begin(&store, name, "a").row.id;
        fs::write(store.runs().join(name).join("report.json"), report).unwrap();
        id
    });
    let (_copy, OpenOutcome { store, recovery }) = killed(folder.path());
    assert_eq!((recovery.ended, recovery.interrupted), (ids[..2].to_vec(), ids[2..].to_vec()));
    for ((_, report, state, reason), id) in reports.into_iter().zip(ids) {
        let row = job(&store, id);
        assert_eq!((row.state, row.reason.as_str()), (state, reason));
        assert_eq!(row.report_json.as_deref(), (state != JobState::Interrupted).then_some(report));
        assert_eq!(row.progress, if state == JobState::Completed { 1.0 } else { 0.0 });
    }
}

#[test]
fn folders_made_for_claims_that_never_were_go_when_they_are_empty() {
    let (folder, store) = new_store(limits());
    let id = queue(&store, "one", "a").id;
    ["one", "other"].into_iter().for_each(|name| fs::create_dir(store.runs().join(name)).unwrap());
    fs::write(store.runs().join("other/notes"), "a person's").unwrap();
    let (copy, OpenOutcome { store: again, recovery }) = killed(folder.path());
    assert_eq!(recovery.orphans, [copy.path().join("runs/other")]);
    assert!(!copy.path().join("runs/one").exists());
    assert_eq!(job(&again, id).state, JobState::Queued);
}

#[test]
fn a_data_folder_belongs_to_one_daemon() {
    let (folder, store) = new_store(limits());
    let refused = try_open(folder.path(), limits()).unwrap_err();
    assert!(refused.to_string().contains("belongs to another daemon that is running"), "{refused}");
    queue(&store, "one", "a");
    assert!(store.close(TIMEOUT));
    assert_eq!(all_jobs(&try_open(folder.path(), limits()).unwrap().store).len(), 1);
}

#[test]
fn a_data_folder_that_cannot_be_made_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let refused = try_open(&file.join("data"), limits()).unwrap_err().to_string();
    assert!(refused.contains("file/data"), "{refused}");
}

#[test]
fn ids_rise_across_a_clock_set_back() {
    let (folder, store) = new_store(limits());
    let first = queue(&store, "one", "a").id;
    assert!(store.close(TIMEOUT));
    let store = Store::open(folder.path(), &plates(), limits(), still(|| Timestamp::UNIX_EPOCH)).unwrap().store;
    assert!(queue(&store, "two", "a").id > first);
}
