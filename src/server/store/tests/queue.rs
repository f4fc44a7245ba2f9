use std::collections::BTreeSet;
use std::sync::Arc;

use proptest::prelude::*;
use proptest::test_runner::TestRunner;

use super::*;
use crate::store::CancelOutcome;

#[test]
fn a_thousand_at_once_are_accepted_or_refused_and_none_is_lost() {
    let (_folder, store) = new_store(StoreLimits { queued: 300, ..limits() });
    let store = Arc::new(store);
    let (sender, answers) = sync_channel(1000);
    let threads: Vec<_> = (0..8)
        .map(|thread| {
            let (store, sender) = (Arc::clone(&store), sender.clone());
            std::thread::spawn(move || {
                for number in 0..125 {
                    let (plate, sender) = (if number % 2 == 0 { "a" } else { "b" }, sender.clone());
                    let job = new_job(&format!("job-{thread}-{number}"), plate);
                    store.accept(job, move |answer| sender.send(answer).unwrap());
                }
            })
        })
        .collect();
    threads.into_iter().for_each(|thread| thread.join().unwrap());
    let answers: Vec<_> = (0..1000).map(|_| answers.recv_timeout(TIMEOUT).unwrap().unwrap()).collect();
    let mut accepted: Vec<JobId> = answers
        .iter()
        .filter_map(|answer| match answer {
            SubmitOutcome::New(row) => Some(row.id),
            SubmitOutcome::QueueFull { queued: 300 } => None,
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(accepted.len(), 600);
    accepted.sort();
    accepted.reverse();
    assert_eq!(all_jobs(&store).iter().map(|row| row.id).collect::<Vec<_>>(), accepted);
    let counts = ask(|done| store.counts(done)).unwrap();
    assert_eq!(counts, [("a".into(), JobState::Queued, 300), ("b".into(), JobState::Queued, 300)]);
}

#[test]
fn job_moved_to_the_front_runs_first_also_after_a_restart() {
    let (folder, store) = new_store(limits());
    let [first, second, third] = ["first", "second", "third"].map(|name| queue(&store, name, "a").id);
    let elsewhere = queue(&store, "elsewhere", "b").id;
    let to_front = |store: &Store, id: JobId| ask(|done| store.move_to_front(&id, done)).unwrap().map(|row| row.turn);
    assert_eq!(to_front(&store, second), Some(-1));
    assert_eq!(to_front(&store, third), Some(-2));
    assert_eq!([third, elsewhere].map(|id| to_front(&store, id)), [Some(-2), Some(0)], "they are first already");
    assert_eq!(to_front(&store, JobId::from_bytes([9; 16])), None);
    drop(store);
    let store = open(folder.path(), limits()).store;
    let claimed = |store: &Store| store.claim("a", &super::folder(store)).unwrap().unwrap().row;
    let next = claimed(&store);
    assert_eq!((next.id, next.turn), (third, -2));
    assert_eq!(to_front(&store, third), Some(-2), "a running job stays as it is");
    assert_eq!([claimed(&store).id, claimed(&store).id], [second, first]);
}

#[test]
fn answered_job_is_the_stored_one() {
    let (folder, store) = new_store(limits());
    let row = queue(&store, "one", "a");
    assert_eq!(job(&store, row.id), row);
    assert_eq!((row.seed, row.pace, row.submitted_at), (u64::MAX, Pace::Max, fixed_time()));
    let claimed = store.claim("a", &super::folder(&store)).unwrap().unwrap();
    assert_eq!(claimed.spec_json, r#"{"name": "one"}"#);
    assert_eq!((claimed.row.state, claimed.row.started_at), (JobState::Running, Some(fixed_time())));
    store.progress(&row.id, 0.25);
    let finished = store.finish(&row.id, end(JobState::Failed)).unwrap().unwrap();
    assert_eq!((finished.seq, finished.kind.as_str(), finished.plate_time), (1, FINISHED, PlateTime::from_secs(2.5)));
    assert_eq!(&*finished.body, r#"{"at_s":2.5,"state":"failed","reason":"so it went"}"#);
    assert_eq!(store.finish(&row.id, end(JobState::Completed)), Ok(None));
    let ended = JobRow {
        last_event: 1,
        state: JobState::Failed,
        finished_at: Some(fixed_time()),
        reason: "so it went".into(),
        report_json: Some("{}".into()),
        recording: RecordingStatus::Whole,
        progress: job(&store, row.id).progress,
        ..claimed.row
    };
    assert_eq!(job(&store, row.id), ended);
    assert!(store.close(TIMEOUT));
    assert_eq!(job(&open(folder.path(), limits()).store, row.id), ended);
}

#[test]
fn each_job_is_claimed_once_in_the_order_of_submission() {
    let (_folder, store) = new_store(limits());
    let queued: Vec<JobId> = (0..40).map(|number| queue(&store, &format!("job-{number}"), "a").id).collect();
    let claimed: Vec<Vec<JobId>> = std::thread::scope(|scope| {
        let claim = || {
            let folder = super::folder(&store);
            std::iter::from_fn(|| store.claim("a", &|row| folder(row).or(Ok(row.name.clone()))).unwrap())
                .map(|claimed| claimed.row.id)
                .collect()
        };
        [scope.spawn(claim), scope.spawn(claim)].map(|thread| thread.join().unwrap()).to_vec()
    });
    assert!(claimed.iter().all(|ids| ids.is_sorted()));
    let once: BTreeSet<JobId> = claimed.iter().flatten().copied().collect();
    assert_eq!(claimed.iter().map(Vec::len).sum::<usize>(), 40);
    assert_eq!(once, queued.into_iter().collect());
}

#[test]
fn only_queued_jobs_are_cancelled() {
    let (_folder, store) = new_store(limits());
    let [running, waiting] = ["one", "two"].map(|name| queue(&store, name, "a").id);
    store.claim("a", &super::folder(&store)).unwrap().unwrap();
    let cancel = |id: JobId| ask(|done| store.cancel_queued(&id, done)).unwrap();
    assert!(matches!(cancel(running), CancelOutcome::Not(row) if row.state == JobState::Running));
    let CancelOutcome::Now(row, finished) = cancel(waiting) else { panic!("it waited") };
    assert_eq!((row.state, row.last_event, finished.seq), (JobState::Cancelled, 1, 1));
    assert_eq!(
        &*finished.body,
        r#"{"at_s":0.0,"state":"cancelled","stop":"cancelled","reason":"cancelled before it began"}"#
    );
    assert!(matches!(cancel(waiting), CancelOutcome::Not(row) if row.state == JobState::Cancelled));
    assert_eq!(cancel(JobId::from_bytes([1; 16])), CancelOutcome::Unknown);
    assert_eq!(store.claim("a", &super::folder(&store)), Ok(None));
    assert!(store.finish(&JobId::from_bytes([1; 16]), end(JobState::Failed)).is_err());
}

#[test]
fn a_job_cancelled_while_its_folder_is_made_does_not_begin() {
    let (_folder, store) = new_store(limits());
    let first = queue(&store, "one", "a").id;
    let second = queue(&store, "two", "a").id;
    let make = folder(&store);
    let claimed = store.claim("a", &|row| {
        if row.id == first {
            ask(|done| store.cancel_queued(&first, done)).unwrap();
        }
        make(row)
    });
    assert_eq!(claimed.unwrap().unwrap().row.id, second);
    assert_eq!(job(&store, first).state, JobState::Cancelled);
    assert!(!store.runs().join("one").exists());
}

#[test]
fn a_folder_that_cannot_be_made_leaves_the_job_queued() {
    let (_folder, store) = new_store(limits());
    let row = queue(&store, "one", "a");
    let full = |_: &JobRow| Err(io::Error::from(io::ErrorKind::StorageFull));
    assert_eq!(store.claim("a", &full), Err(StoreFault::Full));
    assert_eq!(job(&store, row.id), row);
}

#[test]
fn a_repeated_key_gives_the_first_job_again() {
    let (folder, store) = new_store(StoreLimits { queued: 2, ..limits() });
    let keyed = |key: &str, body| NewJob { key: Some(key.into()), body_sha256: [body; 32], ..new_job("one", "a") };
    let Ok(SubmitOutcome::New(first)) = accept(&store, keyed("k", 1)) else { panic!("not accepted") };
    assert_eq!(accept(&store, keyed("k", 1)), Ok(SubmitOutcome::Replayed(first.clone())));
    assert_eq!(accept(&store, keyed("k", 2)), Ok(SubmitOutcome::KeyReused));
    let (sender, answers) = sync_channel(20);
    for _ in 0..20 {
        let sender = sender.clone();
        store.accept(keyed("many", 1), move |answer| sender.send(answer.unwrap()).unwrap());
    }
    let answers: Vec<_> = (0..20).map(|_| answers.recv_timeout(TIMEOUT).unwrap()).collect();
    let new = answers.iter().filter(|answer| matches!(answer, SubmitOutcome::New(_))).count();
    let replayed = answers.iter().filter(|answer| matches!(answer, SubmitOutcome::Replayed(_))).count();
    assert_eq!((new, replayed, all_jobs(&store).len()), (1, 19, 2));
    // a full queue refuses new jobs, and answers repeated keys
    assert_eq!(accept(&store, keyed("new", 1)), Ok(SubmitOutcome::QueueFull { queued: 2 }));
    ask(|done| store.cancel_queued(&first.id, done)).unwrap();
    assert!(store.close(TIMEOUT));
    let store = open(folder.path(), limits()).store;
    let again = accept(&store, keyed("k", 1));
    assert!(
        matches!(&again, Ok(SubmitOutcome::Replayed(row)) if row.id == first.id && row.state == JobState::Cancelled)
    );
    assert!(matches!(accept(&store, keyed("new", 1)), Ok(SubmitOutcome::New(_))));
}

#[test]
fn keys_are_forgotten_with_age_not_counting_time_between_starts() {
    static HOURS: AtomicI64 = AtomicI64::new(0);
    let folder = tempfile::tempdir().unwrap();
    let keyed = || NewJob { key: Some("k".into()), ..new_job("one", "a") };
    let open = || {
        let wall = || fixed_time() + Duration::from_secs(3600 * HOURS.load(Ordering::SeqCst).unsigned_abs());
        Store::open(folder.path(), &plates(), limits(), Clocks::new(wall, Hours(&HOURS))).unwrap().store
    };
    let store = open();
    let Ok(SubmitOutcome::New(first)) = accept(&store, keyed()) else { panic!("not accepted") };
    let replayed = |store: &Store| match accept(store, keyed()).unwrap() {
        SubmitOutcome::New(row) => row.id == first.id,
        SubmitOutcome::Replayed(row) => row.id == first.id,
        other => panic!("{other:?}"),
    };
    HOURS.store(20, Ordering::SeqCst);
    assert!(replayed(&store));
    assert!(store.close(TIMEOUT));
    HOURS.store(1000, Ordering::SeqCst);
    let store = open();
    assert!(replayed(&store));
    HOURS.store(1004, Ordering::SeqCst);
    assert!(replayed(&store));
    HOURS.store(1005, Ordering::SeqCst);
    assert!(!replayed(&store));
}

#[test]
fn pages_joined_are_the_whole_list() {
    let (_folder, store) = new_store(StoreLimits { queued: 1000, ..limits() });
    for number in 0..30 {
        queue(&store, &format!("job-{number}"), ["a", "b"][number % 2]);
    }
    for _ in 0..7 {
        let id = store.claim("a", &super::folder(&store)).unwrap().unwrap().row.id;
        store.finish(&id, end(JobState::Completed)).unwrap();
    }
    let all = all_jobs(&store);
    assert_eq!(all.len(), 30);
    assert!(all.is_sorted_by(|newer, older| newer.id > older.id));
    let states = prop::option::of(prop::sample::select(JobState::ALL.to_vec()));
    let law = |(limit, state): (usize, Option<JobState>)| {
        let (mut joined, mut cursor) = (Vec::new(), None);
        loop {
            let page = ask(|done| store.list(JobSelection { state, limit, cursor }, done)).unwrap();
            prop_assert!(page.rows.len() <= limit.max(1));
            joined.extend(page.rows);
            cursor = page.next;
            if cursor.is_none() {
                break;
            }
        }
        let wanted: Vec<&JobRow> = all.iter().filter(|row| state.is_none_or(|state| row.state == state)).collect();
        prop_assert_eq!(joined.iter().collect::<Vec<_>>(), wanted);
        Ok(())
    };
    TestRunner::deterministic().run(&(0_usize..40, states), law).unwrap();
    let below_all = JobSelection { state: None, limit: 5, cursor: Some(JobId::from_bytes([0; 16])) };
    assert_eq!(ask(|done| store.list(below_all, done)).unwrap().rows, []);
}

#[test]
fn closed_store_reports_that_it_is_closed() {
    let (_folder, store) = new_store(limits());
    let id = queue(&store, "one", "a").id;
    assert!(store.health().heartbeat < TIMEOUT);
    assert_eq!(store.health().fault, None);
    assert!(store.close(TIMEOUT));
    assert!(!store.close(TIMEOUT));
    assert_eq!(accept(&store, new_job("two", "a")), Err(StoreFault::Closed));
    assert_eq!(store.claim("a", &folder(&store)), Err(StoreFault::Closed));
    assert_eq!(append(&store, id, "{}"), Err(StoreFault::Closed));
    assert_eq!(store.health().fault, Some(StoreFault::Closed));
    assert_eq!(job(&store, id).id, id);
}

#[test]
fn a_queue_too_long_is_refused_at_once() {
    let (_folder, store) = new_store(limits());
    let held = store.hold();
    let (sender, answers) = sync_channel(5000);
    let refused = (0..5000)
        .filter(|_| {
            let sender = sender.clone();
            store.queue.write(wish(move |answer| sender.send(answer).unwrap()));
            matches!(answers.try_recv(), Ok(Err(StoreFault::Busy)))
        })
        .count();
    assert!((5000 - 1024 - 257..5000).contains(&refused), "{refused}");
    drop(held);
    for _ in refused..5000 {
        assert_eq!(answers.recv_timeout(TIMEOUT).unwrap(), Ok(()));
    }
}

#[test]
fn stuck_reader_shows_in_health() {
    static HOURS: AtomicI64 = AtomicI64::new(0);
    let folder = tempfile::tempdir().unwrap();
    let clocks = Clocks::new(fixed_time, Hours(&HOURS));
    let store = Store::open(folder.path(), &plates(), limits(), clocks).unwrap().store;
    let ((began, begun), (let_go, gate)) = (sync_channel(0), sync_channel::<()>(0));
    let hang = move |_: Result<(), StoreFault>| {
        began.send(()).unwrap();
        gate.recv().ok();
    };
    store.readers.ask(|_| Ok(()), hang);
    begun.recv_timeout(TIMEOUT).unwrap();
    HOURS.store(1, Ordering::SeqCst);
    let busy = store.health().reader_busy;
    assert!(Duration::from_secs(3599) < busy && busy <= Duration::from_secs(3600), "{busy:?}");
    assert_eq!(ask(|done| store.counts(done)).unwrap(), [], "the other one answers");
    drop(let_go);
    while store.health().reader_busy > Duration::ZERO {
        std::thread::yield_now();
    }
}
