use std::fs;

use super::*;
use crate::store::retention::SweepReport;

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
    assert_eq!(fs::read_dir(data.path().join(".trash")).unwrap().count(), 0);
    // a running job's folder stays, however large
    fs::write(store.runs().join("running/run.rrd"), vec![0; 100_000]).unwrap();
    assert_eq!(store.sweep().unwrap().deleted, ["one", "four", "three"]);
    assert_eq!((names(&store), job(&store, running).folder), (vec!["running".to_owned()], Some("running".into())));
    assert_eq!(store.sweep().unwrap().deleted, [""; 0]);
}

#[test]
fn expired_run_folders_are_deleted() {
    turned_clocks!(HOURS, clocks);
    let data = tempfile::tempdir().unwrap();
    let store = opened(data.path(), StoreLimits { runs_age: Duration::from_secs(10 * 3600), ..limits() }, clocks);
    for (hours, name) in ["one", "two", "three"].into_iter().enumerate() {
        HOURS.store(hours as i64, Ordering::SeqCst);
        let id = begin_with(&store, name, 10);
        store.finish(&id, end(JobState::Failed)).unwrap();
    }
    begin_with(&store, "running", 10);
    // the sweeps requested by the ends of jobs are done before the clock is advanced
    assert_eq!(store.sweep().unwrap().deleted, [""; 0]);
    HOURS.store(11, Ordering::SeqCst);
    assert_eq!(store.sweep().unwrap().deleted, ["one"]);
    HOURS.store(1000, Ordering::SeqCst);
    assert_eq!(store.sweep().unwrap().deleted, ["two", "three"]);
    assert_eq!(names(&store), ["running"]);
}

#[test]
fn folders_without_a_job_go_when_they_are_old_and_never_at_once() {
    turned_clocks!(HOURS, clocks);
    let data = tempfile::tempdir().unwrap();
    // the folder's own time is the machine's, long before this clock's noon
    let store = opened(data.path(), StoreLimits { runs_age: Duration::ZERO, runs_bytes: 0, ..limits() }, clocks);
    fs::create_dir(store.runs().join("left")).unwrap();
    fs::write(data.path().join(".trash/left"), "not a folder").unwrap();
    for hours in [0, 1, 2] {
        HOURS.store(hours, Ordering::SeqCst);
        assert_eq!(store.sweep().unwrap().deleted, [""; 0]);
    }
    fs::remove_file(data.path().join(".trash/left")).unwrap();
    assert_eq!(store.sweep().unwrap().deleted, ["left"]);
}

#[test]
fn a_folder_whose_job_is_just_beginning_stays() {
    let data = tempfile::tempdir().unwrap();
    let store = Arc::new(opened(data.path(), StoreLimits { runs_age: Duration::ZERO, ..limits() }, still(fixed_time)));
    queue(&store, "one", "a");
    let (done, swept) = sync_channel(1);
    let make = folder(&store);
    let sweeping = |row: &JobRow| {
        let name = make(row)?;
        let (store, done) = (Arc::clone(&store), done.clone());
        std::thread::spawn(move || done.send(store.sweep()).unwrap());
        // enough time for a sweep that does not wait
        swept.recv_timeout(Duration::from_millis(500)).expect_err("swept while a job begins");
        Ok(name)
    };
    let claimed = store.claim("a", &sweeping).unwrap().unwrap();
    assert_eq!(swept.recv_timeout(TIMEOUT).unwrap().unwrap().deleted, [""; 0]);
    assert_eq!((claimed.row.folder.as_deref(), names(&store)), (Some("one"), vec!["one".to_owned()]));
}

#[test]
fn a_sweep_that_was_cut_short_is_ended_at_the_next_start() {
    let data = tempfile::tempdir().unwrap();
    let trash = data.path().join(".trash/one/deep");
    fs::create_dir_all(&trash).unwrap();
    fs::write(trash.join("file"), "x").unwrap();
    opened(data.path(), limits(), still(fixed_time));
    assert_eq!(fs::read_dir(data.path().join(".trash")).unwrap().count(), 0);
}

#[test]
fn undeletable_folder_stays_with_its_job_and_does_not_stop_the_sweep() {
    let data = tempfile::tempdir().unwrap();
    let store = opened(data.path(), StoreLimits { jobs: 1, runs_bytes: 0, ..limits() }, still(fixed_time));
    // no folder can be moved to a path that a file occupies
    let in_the_way = data.path().join(".trash/two");
    fs::write(&in_the_way, "not a folder").unwrap();
    let ids = ["one", "two", "three"].map(|name| {
        let id = begin_with(&store, name, 10);
        store.finish(&id, end(JobState::Completed)).unwrap();
        id
    });
    store.sweep().unwrap();
    assert_eq!(names(&store), ["two"]);
    let left = all_jobs(&store);
    assert_eq!(left.iter().map(|row| row.id).collect::<Vec<_>>(), [ids[1]], "the others are forgotten all the same");
    assert_eq!((left[0].folder.as_deref(), left[0].recording), (Some("two"), RecordingStatus::Whole));
    fs::remove_file(in_the_way).unwrap();
    assert_eq!(store.sweep().unwrap().deleted, ["two"]);
    assert_eq!(job(&store, ids[1]).recording, RecordingStatus::Pruned);
}

#[test]
#[cfg(target_os = "linux")]
fn run_folders_on_another_disk_go_too() {
    use std::os::unix::fs::{MetadataExt, symlink};

    let data = tempfile::tempdir().unwrap();
    let Ok(disk) = tempfile::tempdir_in("/dev/shm") else { return };
    if fs::metadata(disk.path()).unwrap().dev() == fs::metadata(data.path()).unwrap().dev() {
        eprintln!("there is one disk alone: not tested");
        return;
    }
    symlink(disk.path(), data.path().join("runs")).unwrap();
    let store = opened(data.path(), StoreLimits { runs_bytes: 0, ..limits() }, still(fixed_time));
    let id = begin_with(&store, "one", 10);
    store.finish(&id, end(JobState::Completed)).unwrap();
    store.sweep().unwrap();
    assert!(!store.runs().join("one").exists());
    assert_eq!(job(&store, id).recording, RecordingStatus::Pruned);
    // no part of it counts as a run folder, or survives a start
    let half = store.runs().join(".trash/half");
    fs::create_dir_all(&half).unwrap();
    fs::write(half.join("run.rrd"), "x").unwrap();
    assert_eq!(store.sweep().unwrap(), SweepReport::default());
    assert!(store.close(TIMEOUT));
    let OpenOutcome { recovery, .. } = open(data.path(), limits());
    assert_eq!((recovery.orphans.len(), half.exists()), (0, false));
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
fn wall_clock_that_jumps_makes_nothing_old() {
    static HOURS: AtomicI64 = AtomicI64::new(0);
    static DAYS_AHEAD: AtomicI64 = AtomicI64::new(0);
    const DAY: i64 = 24 * 3600;
    let wall = || fixed_time() + jiff::SignedDuration::from_secs(DAY * DAYS_AHEAD.load(Ordering::SeqCst));
    let data = tempfile::tempdir().unwrap();
    let limits = StoreLimits { runs_age: Duration::from_secs(30 * DAY as u64), ..limits() };
    let store = opened(data.path(), limits, Clocks::new(wall, Hours(&HOURS)));
    let keyed = || NewJob { key: Some("k".into()), ..new_job("one", "a") };
    let Ok(SubmitOutcome::New(first)) = accept(&store, keyed()) else { panic!("not accepted") };
    store.claim("a", &folder(&store)).unwrap().unwrap();
    store.finish(&first.id, end(JobState::Completed)).unwrap();
    store.sweep().unwrap();
    assert!(!store.health().deletion_suspended);
    for days in [60, 0, -7300] {
        DAYS_AHEAD.store(days, Ordering::SeqCst);
        assert_eq!(store.sweep().unwrap().deleted, [""; 0], "{days} days");
        assert!(store.health().deletion_suspended);
        assert!(
            matches!(accept(&store, keyed()), Ok(SubmitOutcome::Replayed(row)) if row.id == first.id),
            "{days} days"
        );
    }
    // hour by hour: a wall clock that does not advance for longer counts as a jump, too
    let pass_days = |days| {
        (0..24 * days).for_each(|_| {
            HOURS.fetch_add(1, Ordering::SeqCst);
            store.health();
        })
    };
    pass_days(1);
    assert!(!store.health().deletion_suspended);
    assert_eq!(store.sweep().unwrap().deleted, [""; 0]);
    pass_days(30);
    assert_eq!(store.sweep().unwrap().deleted, ["one"]);
    assert!(matches!(accept(&store, keyed()), Ok(SubmitOutcome::New(_))));
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
