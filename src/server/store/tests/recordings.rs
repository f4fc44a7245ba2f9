//! Recordings left unclosed by a daemon.

use std::fs;

use super::crashes::killed;
use super::*;

fn finished(store: &Store, name: &str, recording: RecordingStatus) -> JobId {
    let id = begin(store, name, "a").row.id;
    store.finish(&id, JobEnd { recording, ..end(JobState::Completed) }).unwrap();
    id
}

#[test]
fn a_recording_that_failed_is_repaired_where_something_is_left_of_it() {
    let (folder, store) = new_store(limits());
    let failed = ["cut", "closed", "none"].map(|name| finished(&store, name, RecordingStatus::Failed));
    let whole = finished(&store, "whole", RecordingStatus::Whole);
    fs::write(store.runs().join("cut/run.rrd.part"), "rerun").unwrap();
    fs::write(store.runs().join("closed/run.rrd"), "rerun").unwrap();
    let (_copy, OpenOutcome { store, recovery }) = killed(folder.path());
    assert_eq!((recovery.repaired.len(), recovery.interrupted.len(), recovery.ended.len()), (1, 0, 0));
    let kept = [RecordingStatus::Recovered, RecordingStatus::Failed, RecordingStatus::Failed];
    assert_eq!(failed.map(|id| job(&store, id).recording), kept);
    assert_eq!(job(&store, whole).recording, RecordingStatus::Whole);
    assert!(store.runs().join("cut/run.rrd").exists());
    let row = job(&store, failed[0]);
    assert_eq!(
        (row.state, row.reason.as_str(), row.finished_at),
        (JobState::Completed, "so it went", Some(fixed_time()))
    );
}

#[test]
fn recording_closed_before_the_end_of_its_run_is_not_whole() {
    let (folder, store) = new_store(limits());
    let runs = [
        ("stopped", r#","code":"recording_stopped""#, "run.rrd", RecordingStatus::Stopped),
        ("lagged", r#","code":"recording_failed""#, "run.rrd", RecordingStatus::Stopped),
        ("unnamed", r#","code":"recording_failed""#, "run.rrd.part", RecordingStatus::Stopped),
        ("whole", "", "run.rrd", RecordingStatus::Whole),
    ];
    let ids = runs.map(|(name, detail, file, _)| {
        let id = begin(&store, name, "a").row.id;
        let event =
            format!("{{\"type\":\"event\",\"at_s\":1.5,\"level\":\"warning\",\"text\":\"so it went\"{detail}}}\n");
        fs::write(store.runs().join(name).join("journal.jsonl"), event.repeat(3)).unwrap();
        fs::write(store.runs().join(name).join(file), "rerun").unwrap();
        id
    });
    let was_whole = |part: &Path, whole: &Path| {
        super::repair(part, whole).map(|mended| RecordingRepair { was_whole: true, ..mended })
    };
    let copy = snapshot(folder.path());
    let store = Store::open(copy.path(), &plates(), limits(), still(fixed_time), &was_whole).unwrap().store;
    assert_eq!(ids.map(|id| job(&store, id).recording), runs.map(|(.., kept)| kept));
}

#[test]
fn a_start_killed_before_a_repaired_file_has_its_name_still_marks_it() {
    let (folder, store) = new_store(limits());
    let id = begin(&store, "one", "a").row.id;
    fs::write(store.runs().join("one/run.rrd.part"), "cut").unwrap();
    let first = snapshot(folder.path());
    let second = tempfile::tempdir().unwrap();
    let repair = |part: &Path, whole: &Path| {
        fs::write(part, "mended").unwrap();
        copy_folder(first.path(), second.path());
        super::repair(part, whole)
    };
    Store::open(first.path(), &plates(), limits(), still(fixed_time), &repair).unwrap();
    let was_whole = |part: &Path, whole: &Path| {
        super::repair(part, whole).map(|mended| RecordingRepair { was_whole: true, ..mended })
    };
    let OpenOutcome { store, recovery } =
        Store::open(second.path(), &plates(), limits(), still(fixed_time), &was_whole).unwrap();
    assert_eq!((recovery.repaired.len(), recovery.interrupted), (1, vec![id]));
    assert_eq!(job(&store, id).recording, RecordingStatus::Recovered);
}

#[test]
#[cfg(target_os = "linux")]
fn fifos_and_links_in_a_run_folder_neither_block_the_start_nor_are_repaired() {
    use std::os::unix::fs::symlink;

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    let (folder, store) = new_store(limits());
    let ids = ["fifo", "link", "dangling"].map(|name| begin(&store, name, "a").row.id);
    let copy = snapshot(folder.path());
    let run = |name: &str| copy.path().join("runs").join(name);
    fs::write(copy.path().join("elsewhere"), "not ours").unwrap();
    for file in ["journal.jsonl", "run.rrd.part"] {
        mknodat(CWD, run("fifo").join(file), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        symlink("../../elsewhere", run("link").join(file)).unwrap();
        symlink("nowhere", run("dangling").join(file)).unwrap();
    }
    let data = copy.path().to_owned();
    let OpenOutcome { store, recovery } = in_time(move || open(&data, limits()));
    assert_eq!(recovery.interrupted, ids);
    assert_eq!(ids.map(|id| job(&store, id).recording), [RecordingStatus::Partial; 3]);
    let reason = "run.rrd.part: expected a regular file in a folder, found something else";
    assert_eq!(recovery.repaired.len(), 3);
    for (path, repaired) in recovery.repaired {
        assert_eq!(repaired, Err(reason.to_owned()), "{}", path.display());
        assert!(!path.exists());
    }
    assert_eq!(fs::read_to_string(copy.path().join("elsewhere")).unwrap(), "not ours");
}
