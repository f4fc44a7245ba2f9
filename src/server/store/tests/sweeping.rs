use std::fs;

use super::*;

/// A wall clock and a monotonic clock that a test sets together, in hours since noon.
macro_rules! turned_clocks {
    ($hours:ident, $clocks:ident) => {
        static $hours: AtomicI64 = AtomicI64::new(0);
        let $clocks = Clocks::new(
            || fixed_time() + Duration::from_secs(3600 * $hours.load(Ordering::SeqCst) as u64),
            Hours(&$hours),
        );
    };
}

fn opened(data: &Path, limits: StoreLimits, clocks: Clocks) -> Store {
    Store::open(data, &plates(), limits, clocks).unwrap().store
}

/// Begins a job whose folder holds that many bytes, on two levels.
fn begin_with(store: &Store, name: &str, bytes: usize) -> JobId {
    let id = begin(store, name, "a").row.id;
    let folder = store.runs().join(name);
    fs::create_dir(folder.join("deep")).unwrap();
    fs::write(folder.join("run.rrd"), vec![0; bytes / 2]).unwrap();
    fs::write(folder.join("deep/more"), vec![0; bytes - bytes / 2]).unwrap();
    id
}

fn names(store: &Store) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(store.runs()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn the_oldest_ended_go_first_when_there_is_too_much() {
    turned_clocks!(HOURS, clocks);
    let data = tempfile::tempdir().unwrap();
    let store = opened(data.path(), StoreLimits { runs_bytes: 25_000, ..limits() }, clocks);
    let running = begin_with(&store, "running", 10_000);
    let ids = ["one", "two", "three", "four"].map(|name| begin_with(&store, name, 5000));
    // they end in another order than they began
    for (hours, id) in [ids[1], ids[0], ids[3], ids[2]].into_iter().enumerate() {
        HOURS.store(hours as i64, Ordering::SeqCst);
        store.finish(&id, end(JobState::Completed)).unwrap();
    }
    let swept = store.sweep().unwrap();
    assert_eq!(names(&store), ["four", "one", "running", "three"]);
    assert_eq!(swept.bytes, 25_000);
    let row = job(&store, ids[1]);
    assert_eq!((row.folder, row.recording, row.report_json), (None, RecordingStatus::Pruned, Some("{}".into())));
    // a running job's folder stays, however large
    fs::write(store.runs().join("running/run.rrd"), vec![0; 100_000]).unwrap();
    assert_eq!(store.sweep().unwrap().deleted, ["one", "four", "three"]);
    assert_eq!((names(&store), job(&store, running).folder), (vec!["running".to_owned()], Some("running".into())));
    assert_eq!(store.sweep().unwrap().deleted, [""; 0]);
}

#[test]
fn undeletable_folder_stays_with_its_job_and_does_not_stop_the_sweep() {
    let data = tempfile::tempdir().unwrap();
    let store = opened(data.path(), StoreLimits { jobs: 1, runs_bytes: 0, ..limits() }, still(fixed_time));
    let ids = ["one", "two", "three"].map(|name| {
        let id = begin_with(&store, name, 10);
        if name == "two" {
            // a file in the place of a folder is not deleted
            fs::remove_dir_all(store.runs().join(name)).unwrap();
            fs::write(store.runs().join(name), "").unwrap();
        }
        id
    });
    ids.iter().for_each(|id| drop(store.finish(id, end(JobState::Completed)).unwrap()));
    store.sweep().unwrap();
    assert_eq!(names(&store), ["two"]);
    let left = all_jobs(&store);
    assert_eq!(left.iter().map(|row| row.id).collect::<Vec<_>>(), [ids[1]], "the others are forgotten all the same");
    assert_eq!((left[0].folder.as_deref(), left[0].recording), (Some("two"), RecordingStatus::Whole));
}

#[test]
fn a_job_is_remembered_as_long_as_its_key() {
    turned_clocks!(HOURS, clocks);
    let data = tempfile::tempdir().unwrap();
    let store = opened(data.path(), StoreLimits { jobs: 0, runs_bytes: 0, ..limits() }, clocks);
    let keyed = || NewJob { key: Some("k".into()), ..new_job("one", "a") };
    let Ok(SubmitOutcome::New(first)) = accept(&store, keyed()) else { panic!("not accepted") };
    store.claim("a", &folder(&store)).unwrap().unwrap();
    fs::write(store.runs().join("one/journal.jsonl"), "{}").unwrap();
    store.finish(&first.id, end(JobState::Completed)).unwrap();
    let plain = begin_with(&store, "plain", 10);
    store.finish(&plain, end(JobState::Completed)).unwrap();
    store.sweep().unwrap();
    assert!(matches!(accept(&store, keyed()), Ok(SubmitOutcome::Replayed(row)) if row.id == first.id));
    assert_eq!(all_jobs(&store).len(), 1);
    HOURS.store(25, Ordering::SeqCst);
    store.sweep().unwrap();
    assert_eq!(all_jobs(&store), []);
}

#[test]
fn jobs_are_remembered_up_to_a_number() {
    let data = tempfile::tempdir().unwrap();
    let store = opened(data.path(), StoreLimits { jobs: 3, runs_bytes: 0, ..limits() }, still(fixed_time));
    for name in ["one", "two", "three", "four"] {
        let id = begin_with(&store, name, 10);
        append(&store, id, "{}").unwrap();
        store.finish(&id, end(JobState::Completed)).unwrap();
    }
    begin_with(&store, "running", 10);
    queue(&store, "queued", "a");
    store.sweep().unwrap();
    let names: Vec<String> = all_jobs(&store).into_iter().map(|row| row.name).collect();
    assert_eq!(names, ["queued", "running", "four"]);
}

#[test]
fn wall_clock_that_jumps_forgets_no_key() {
    static HOURS: AtomicI64 = AtomicI64::new(0);
    static DAYS_AHEAD: AtomicI64 = AtomicI64::new(0);
    let wall = || fixed_time() + jiff::SignedDuration::from_secs(24 * 3600 * DAYS_AHEAD.load(Ordering::SeqCst));
    let data = tempfile::tempdir().unwrap();
    let store = opened(data.path(), limits(), Clocks::new(wall, Hours(&HOURS)));
    let keyed = || NewJob { key: Some("k".into()), ..new_job("one", "a") };
    let Ok(SubmitOutcome::New(first)) = accept(&store, keyed()) else { panic!("not accepted") };
    for days in [60, 0, -7300] {
        DAYS_AHEAD.store(days, Ordering::SeqCst);
        store.sweep().unwrap();
        let again = accept(&store, keyed());
        assert!(matches!(again, Ok(SubmitOutcome::Replayed(row)) if row.id == first.id), "{days} days");
    }
}

#[test]
fn jobs_whose_run_folders_were_removed_by_hand_make_room_for_newer_ones() {
    let data = tempfile::tempdir().unwrap();
    let store = opened(data.path(), StoreLimits { jobs: 3, ..limits() }, still(fixed_time));
    let ended = |name: &str| {
        let id = begin_with(&store, name, 100);
        store.finish(&id, end(JobState::Completed)).unwrap();
        id
    };
    let [one, two, three] = ["one", "two", "three"].map(ended);
    ["one", "two"].iter().for_each(|name| fs::remove_dir_all(store.runs().join(name)).unwrap());
    store.sweep().unwrap();
    assert_eq!(job(&store, one).folder.as_deref(), Some("one"), "while there is room, rows stay as they are");
    let cancelled = queue(&store, "cancelled", "a").id;
    ask(|done| store.cancel_queued(&cancelled, done)).unwrap();
    store.sweep().unwrap();
    assert_eq!(all_jobs(&store).iter().map(|row| row.id).collect::<Vec<_>>(), [cancelled, three, two]);
    assert_eq!(names(&store), ["three"]);
}

#[test]
fn job_ends_no_earlier_than_submitted_when_the_wall_clock_goes_back() {
    static BACK: AtomicI64 = AtomicI64::new(0);
    let wall = || fixed_time() - Duration::from_secs(BACK.load(Ordering::SeqCst).unsigned_abs());
    let data = tempfile::tempdir().unwrap();
    let store = opened(data.path(), limits(), still(wall));
    let submitted = queue(&store, "one", "a").submitted_at;
    BACK.store(20 * 365 * 24 * 3600, Ordering::SeqCst);
    let id = store.claim("a", &folder(&store)).unwrap().unwrap().row.id;
    store.finish(&id, end(JobState::Completed)).unwrap();
    let row = job(&store, id);
    assert_eq!((row.submitted_at, row.started_at, row.finished_at), (submitted, Some(submitted), Some(submitted)));
}
