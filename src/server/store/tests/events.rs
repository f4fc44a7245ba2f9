use rusqlite::Connection;

use super::*;
use crate::store::Replay;
use crate::store::write_tx::WriteTx;

fn replay(store: &Store, id: JobId, after: u64, most: usize) -> Option<Replay> {
    ask(|done| store.replay(&id, after, most, done)).unwrap()
}

fn numbers(replay: &Replay) -> Vec<u64> {
    replay.events.iter().map(|event| event.seq).collect()
}

#[test]
fn events_are_published_after_commit_and_replayed_from_any_number() {
    let (_folder, store) = new_store(limits());
    let [one, two] = ["one", "two"].map(|name| queue(&store, name, "a").id);
    for number in 1..=9 {
        assert_eq!(append(&store, one, &format!("{{\"number\": {number}}}")), Ok(number));
    }
    assert_eq!(append(&store, two, "{}"), Ok(1));
    for after in 0..=10 {
        let found = replay(&store, one, after, 100).unwrap();
        assert_eq!(numbers(&found), (after + 1..=9).collect::<Vec<_>>());
        assert_eq!((found.oldest, found.last), (1, 9));
    }
    let found = replay(&store, one, 4, 2).unwrap();
    assert_eq!(numbers(&found), [5, 6]);
    let first = found.events.first().unwrap();
    let stored = (first.at, first.plate_time, first.kind.as_str(), &*first.body);
    assert_eq!(stored, (fixed_time(), PlateTime::from_secs(1.5), "cycle", r#"{"number": 5}"#));
    assert_eq!(job(&store, one).last_event, 9);
    assert_eq!(replay(&store, one, u64::MAX, usize::MAX).unwrap().events, []);
    let unknown = JobId::from_bytes([1; 16]);
    assert_eq!(replay(&store, unknown, 0, 10), None);
    assert!(append(&store, unknown, "{}").is_err());
    let newest = ask(|done| store.newest_events(3, done)).unwrap();
    assert_eq!(newest.iter().map(|(id, event)| (*id, event.seq)).collect::<Vec<_>>(), [(two, 1), (one, 9), (one, 8)]);
}

#[test]
fn a_job_keeps_its_last_events() {
    let (folder, store) = new_store(StoreLimits { events_per_job: 5, ..limits() });
    let id = queue(&store, "one", "a").id;
    for number in 1..=12 {
        assert_eq!(append(&store, id, "{}"), Ok(number));
    }
    let found = replay(&store, id, 0, 100).unwrap();
    assert_eq!((found.oldest, found.last, numbers(&found)), (8, 12, vec![8, 9, 10, 11, 12]));
    assert!(store.close(TIMEOUT));
    let store = open(folder.path(), limits()).store;
    assert_eq!(append(&store, id, "{}"), Ok(13));
    assert_eq!(replay(&store, id, 0, 100).unwrap().oldest, 8);
}

#[test]
fn the_oldest_jobs_that_have_ended_lose_their_events_first() {
    let (_folder, store) = new_store(StoreLimits { events: 40, ..limits() });
    let ids: Vec<JobId> = (0..4).map(|number| begin(&store, &format!("job-{number}"), "a").row.id).collect();
    for (number, id) in ids.iter().enumerate() {
        for _ in 0..20 {
            append(&store, *id, "{}").unwrap();
        }
        if number > 0 {
            store.finish(id, end(JobState::Completed)).unwrap();
        }
    }
    for _ in 0..8 {
        append(&store, ids[0], "{}").unwrap();
    }
    let kept = ids.iter().map(|id| replay(&store, *id, 0, 100).unwrap());
    let kept: Vec<(u64, u64, usize)> = kept.map(|found| (found.oldest, found.last, found.events.len())).collect();
    assert_eq!(kept, [(1, 28, 28), (22, 21, 0), (22, 21, 0), (22, 21, 0)]);
    assert_eq!(append(&store, ids[1], "{}"), Ok(22));
}

#[test]
fn the_audit_log_only_grows() {
    let (folder, store) = new_store(limits());
    for operator in ["ann", "bob"] {
        assert!(store.audit(act(operator)));
    }
    store.audit(act("cy"));
    assert!(store.close(TIMEOUT));
    let store = open(folder.path(), limits()).store;
    let tail = |most| ask(|done| store.audit_tail(most, done)).unwrap();
    let operators: Vec<String> = tail(10).into_iter().map(|line| line.entry.operator).collect();
    assert_eq!(operators, ["cy", "bob", "ann"]);
    assert_eq!(tail(1).first().map(|line| (line.id, line.at)), Some((3, fixed_time())));
    for sql in [
        "UPDATE audit SET operator = 'eve'",
        "DELETE FROM audit",
        "REPLACE INTO audit SELECT * FROM audit",
        "UPDATE audit SET id = id + 10",
    ] {
        let stored = store.queue.written(|tx| tx.connection.execute(sql, []));
        assert!(matches!(&stored, Err(StoreFault::Io(reason)) if reason.contains("append-only")), "{stored:?}");
    }
    assert_eq!(tail(10).len(), 3);
}

#[test]
fn deferred_writes_are_committed_with_the_next_task_and_before_it() {
    let (folder, store) = new_store(limits());
    let others = Connection::open(folder.path().join("upm.db")).unwrap();
    let count = |tx: &Connection| tx.query_row("SELECT count(*) FROM audit", [], |row| row.get::<_, i64>(0));
    let held = store.hold();
    assert!(store.audit(act("ann")));
    let (sender, answer) = sync_channel(1);
    let both = move |tx: &WriteTx<'_>| Ok((count(tx.connection)?, count(&others)?));
    store.queue.write(task(both, move |seen| sender.send(seen).unwrap()));
    drop(held);
    assert_eq!(answer.recv_timeout(TIMEOUT).unwrap(), Ok((1, 0)), "seen by the task, and by who is not in on it");
    assert_eq!(ask(|done| store.audit_tail(10, done)).unwrap().len(), 1);
}

#[test]
fn one_failed_task_does_not_fail_the_others() {
    let (_folder, store) = new_store(limits());
    let held = store.hold();
    assert!(store.audit(act("ann")));
    let (sender, answers) = sync_channel(3);
    let hand_in = |sql: &'static str| {
        let sender = sender.clone();
        let done = move |stored| sender.send(stored).unwrap();
        store.queue.write(task(|tx| tx.connection.execute(sql, []), done));
    };
    hand_in("UPDATE meta SET clean_shutdown = 0");
    hand_in("DELETE FROM nothing_that_is_there");
    hand_in("UPDATE meta SET clean_shutdown = 0");
    drop(held);
    let answers: Vec<bool> = (0..3).map(|_| answers.recv_timeout(TIMEOUT).unwrap().is_ok()).collect();
    assert_eq!(answers, [true, false, true]);
    let audit = ask(|done| store.audit_tail(10, done)).unwrap();
    assert_eq!(audit.into_iter().map(|line| line.entry.operator).collect::<Vec<_>>(), ["ann"]);
}

#[test]
fn progress_is_kept_without_waiting() {
    let (folder, store) = new_store(limits());
    let id = begin(&store, "one", "a").row.id;
    for share in [0.1, f64::NAN, 7.0, 0.5] {
        store.progress(&id, share);
    }
    assert!(store.close(TIMEOUT));
    assert_eq!(job(&open(folder.path(), limits()).store, id).progress, 0.5);
}

#[test]
fn pauses_are_kept_without_waiting() {
    let (folder, store) = new_store(limits());
    store.note_paused("b", true);
    assert!(store.close(TIMEOUT));
    let recovery = open(folder.path(), limits()).recovery;
    assert_eq!((recovery.clean, recovery.paused.as_slice()), (true, ["b".to_owned()].as_slice()));
}
