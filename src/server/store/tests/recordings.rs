//! Recordings left by a daemon that was killed.

use std::fs;

use super::crashes::killed;
use super::*;

#[test]
fn recording_is_as_its_report_says_and_not_closed_without_a_report() {
    let (folder, store) = new_store(limits());
    let failed = r#"{"outcome": "completed", "recording": {"code": "recording_failed", "text": "it lags"}}"#;
    let runs = [
        ("failed", Some(failed), RecordingStatus::Failed),
        ("whole", Some(r#"{"outcome": "completed"}"#), RecordingStatus::Whole),
        ("cut", None, RecordingStatus::Partial),
    ];
    let ids = runs.map(|(name, report, _)| {
        let (id, run) = (begin(&store, name, "a").row.id, store.runs().join(name));
        fs::write(run.join("run.rrd"), "rerun").unwrap();
        report.into_iter().for_each(|report| fs::write(run.join("report.json"), report).unwrap());
        id
    });
    let none = begin(&store, "none", "a").row.id;
    let (_copy, OpenOutcome { store, .. }) = killed(folder.path());
    assert_eq!(ids.map(|id| job(&store, id).recording), runs.map(|(.., kept)| kept));
    assert_eq!(job(&store, none).recording, RecordingStatus::None);
}

#[test]
#[cfg(target_os = "linux")]
fn fifos_and_links_in_a_run_folder_do_not_block_the_start() {
    use std::os::unix::fs::symlink;

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    let (folder, store) = new_store(limits());
    let ids = ["fifo", "link", "dangling"].map(|name| begin(&store, name, "a").row.id);
    let copy = snapshot(folder.path());
    let run = |name: &str| copy.path().join("runs").join(name);
    fs::write(copy.path().join("elsewhere"), "not ours").unwrap();
    for file in ["journal.jsonl", "run.rrd"] {
        mknodat(CWD, run("fifo").join(file), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        symlink("../../elsewhere", run("link").join(file)).unwrap();
        symlink("nowhere", run("dangling").join(file)).unwrap();
    }
    let data = copy.path().to_owned();
    let OpenOutcome { store, recovery } = in_time(move || open(&data, limits()));
    assert_eq!(recovery.interrupted, ids);
    assert_eq!(ids.map(|id| job(&store, id).recording), [RecordingStatus::Partial; 3]);
    assert_eq!(fs::read_to_string(copy.path().join("elsewhere")).unwrap(), "not ours");
}
