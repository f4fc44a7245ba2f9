use std::fs;

use super::*;

/// Begins a run of the standing job of plate `a`.
fn begin_standing(store: &Store, name: &str) -> Option<JobRow> {
    store.begin_standing(&new_job(name, "a")).unwrap()
}

/// Names of the jobs that have a run folder.
fn run_folders(store: &Store) -> Vec<String> {
    let entries = fs::read_dir(store.runs()).unwrap();
    let name = |folder: String| folder.rsplit_once('-').unwrap().0.to_owned();
    let mut names: Vec<String> = entries.map(|entry| name(entry.unwrap().file_name().into_string().unwrap())).collect();
    names.sort();
    names
}

/// Runs a job that leaves so many bytes.
fn run(store: &Store, name: &str, bytes: usize) -> JobId {
    let row = begin(store, name, "a");
    fs::write(folder(store, &row).join("journal.jsonl"), vec![b'x'; bytes]).unwrap();
    finish(store, &row.id, JobState::Completed).unwrap();
    row.id
}

#[test]
fn oldest_run_folders_are_deleted_while_all_are_too_large() {
    let (folder, store) = new_store(KeepSpec { runs_bytes: 1000, ..limits() });
    let first = run(&store, "first", 400);
    run(&store, "second", 400);
    assert_eq!((run_folders(&store).len(), store.runs_bytes()), (2, 800));
    run(&store, "third", 400);
    assert_eq!((run_folders(&store), store.runs_bytes()), (vec!["second".to_owned(), "third".to_owned()], 800));
    let row = job(&store, first);
    assert_eq!((row.folder.as_ref(), row.recording, row.report.is_some()), (None, RecordingStatus::Pruned, true));
    let running = begin(&store, "running", "a");
    fs::write(self::folder(&store, &running).join("journal.jsonl"), [b'x'; 5000]).unwrap();
    run(&store, "small", 1);
    assert_eq!(run_folders(&store), ["running", "second", "small", "third"], "what runs stays, and does not count");
    drop(store);
    let store = open(folder.path(), KeepSpec { runs_bytes: 500, ..limits() }).0;
    assert_eq!(run_folders(&store), ["small"], "the sizes are known after a restart");
    assert_eq!(job(&store, running.id).state, JobState::Interrupted);
}

#[test]
fn oldest_jobs_without_a_folder_are_forgotten() {
    let (_folder, store) = new_store(KeepSpec { jobs: 3, runs_bytes: 0, ..limits() });
    let ids = ["one", "two", "three", "four", "five"].map(|name| run(&store, name, 10));
    assert_eq!(store.all_jobs().iter().map(|row| row.id).collect::<Vec<_>>(), ids[2..]);
}

#[test]
fn standing_run_begins_only_while_nothing_is_queued_for_its_plate() {
    let (_folder, store) = new_store(limits());
    queue(&store, "other", "b");
    let run = begin_standing(&store, "run-1").unwrap();
    assert_eq!(
        (run.state, run.standing, run.folder.as_deref()),
        (JobState::Running, true, Some(run.run_folder().as_str()))
    );
    assert_eq!((job(&store, run.id), run.spec_json.as_str()), (without_spec(run.clone()), r#"{"name": "run-1"}"#));
    finish(&store, &run.id, JobState::Completed).unwrap();
    let queued = queue(&store, "queued", "a");
    assert_eq!(begin_standing(&store, "run-2"), None);
    assert_eq!(run_folders(&store), ["run-1"], "no folder is left of it");
    assert!(!queued.standing);
}

#[test]
fn all_but_the_newest_ended_standing_runs_go_with_folder_and_row() {
    let (_folder, store) = new_store(KeepSpec { standing_runs: 2, ..limits() });
    let other = run(&store, "other", 10);
    let mut runs = Vec::new();
    for number in 1..=5 {
        let id = begin_standing(&store, &format!("run-{number}")).unwrap().id;
        if number < 5 {
            finish(&store, &id, JobState::Completed).unwrap();
        }
        runs.push(id);
    }
    assert_eq!(run_folders(&store), ["other", "run-3", "run-4", "run-5"]);
    let left: Vec<JobId> = store.all_jobs().iter().map(|row| row.id).collect();
    assert_eq!(left, [other, runs[2], runs[3], runs[4]], "what others ran stays, and what runs");
}
