//! Runs of standing jobs: they are never queued, and only a few of them are kept.

use std::fs;

use super::*;

/// Begins a run of the standing job of plate `a`, in a folder called `name`.
fn begin_standing(store: &Store, name: &str) -> Option<ClaimedJob> {
    let runs = store.runs().to_owned();
    let make = move |_: &JobRow| {
        fs::create_dir(runs.join(name))?;
        Ok(name.to_owned())
    };
    store.begin_standing(&new_job("standing", "a"), &make).unwrap()
}

fn run_folders(store: &Store) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(store.runs()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn standing_run_begins_only_while_nothing_is_queued_for_its_plate() {
    let (_folder, store) = new_store(limits());
    queue(&store, "other", "b");
    let run = begin_standing(&store, "run-1").unwrap();
    assert_eq!((run.row.state, run.row.standing, run.row.folder.as_deref()), (JobState::Running, true, Some("run-1")));
    assert_eq!((job(&store, run.row.id), run.spec_json.as_str()), (run.row.clone(), r#"{"name": "standing"}"#));
    store.finish(&run.row.id, end(JobState::Completed)).unwrap();
    let queued = queue(&store, "queued", "a");
    assert_eq!(begin_standing(&store, "run-2"), None);
    assert_eq!(run_folders(&store), ["run-1"], "no folder is left of it");
    assert!(!queued.standing);
}

#[test]
fn job_queued_while_a_standing_run_is_about_to_begin_comes_first() {
    let (_folder, store) = new_store(limits());
    let runs = store.runs().to_owned();
    let begun = store.begin_standing(&new_job("standing", "a"), &|_| {
        queue(&store, "queued", "a");
        fs::create_dir(runs.join("run"))?;
        Ok("run".to_owned())
    });
    assert_eq!((begun, run_folders(&store)), (Ok(None), Vec::new()));
    assert_eq!(all_jobs(&store).iter().map(|row| row.name.as_str()).collect::<Vec<_>>(), ["queued"]);
}

#[test]
fn all_but_the_newest_ended_standing_runs_go_with_folder_events_and_row() {
    let (_folder, store) = new_store(StoreLimits { standing_runs: 2, ..limits() });
    let other = begin(&store, "other", "a").row.id;
    store.finish(&other, end(JobState::Completed)).unwrap();
    let mut runs = Vec::new();
    for number in 1..=5 {
        let id = begin_standing(&store, &format!("run-{number}")).unwrap().row.id;
        append(&store, id, "{}").unwrap();
        fs::write(store.runs().join(format!("run-{number}/journal.jsonl")), "{}").unwrap();
        if number < 5 {
            store.finish(&id, end(JobState::Completed)).unwrap();
        }
        runs.push(id);
    }
    store.sweep().unwrap();
    assert_eq!(run_folders(&store), ["other", "run-3", "run-4", "run-5"]);
    let left: Vec<JobId> = all_jobs(&store).iter().map(|row| row.id).collect();
    assert_eq!(left, [runs[4], runs[3], runs[2], other], "what others ran stays, and what runs");
    assert_eq!(ask(|done| store.replay(&runs[0], 0, 9, done)).unwrap(), None);
    assert_eq!(ask(|done| store.replay(&runs[2], 0, 9, done)).unwrap().unwrap().events.len(), 2);
}

#[test]
fn killed_standing_run_is_interrupted_like_any_other() {
    let (folder, store) = new_store(limits());
    let id = begin_standing(&store, "run").unwrap().row.id;
    fs::write(store.runs().join("run/journal.jsonl"), "{}\n").unwrap();
    let (_copy, OpenOutcome { store, recovery }) = super::crashes::killed(folder.path());
    assert_eq!((recovery.interrupted, recovery.paused), (vec![id], plates()));
    let row = job(&store, id);
    assert_eq!((row.state, row.standing), (JobState::Interrupted, true));
    assert_eq!(store.claim("a", &super::folder(&store)), Ok(None), "it is not run again");
}
