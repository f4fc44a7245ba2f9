use std::collections::BTreeSet;
use std::fs;

use super::*;

#[test]
fn answered_job_is_the_stored_one() {
    let (folder, store) = new_store(limits());
    let row = queue(&store, "one", "a");
    assert_eq!(job(&store, row.id), row);
    assert_eq!((row.seed, row.pace, row.submitted_at.as_str()), (u64::MAX, Pace::Max, FIXED_TIME));
    let claimed = claim(&store, "a").unwrap();
    assert_eq!(claimed.spec_json, r#"{"name": "one"}"#);
    assert_eq!((claimed.state, claimed.started_at.as_deref()), (JobState::Running, Some(FIXED_TIME)));
    finish(&store, &row.id, JobState::Failed).unwrap();
    finish(&store, &row.id, JobState::Completed).unwrap();
    let mut ended = without_spec(claimed);
    ended.job.set_end(JobState::Failed, "so it went");
    (ended.job.finished_at, ended.job.report) = (Some(FIXED_TIME.into()), Some(Default::default()));
    (ended.job.recording, ended.job.progress) = (RecordingStatus::Whole, 0.25);
    assert_eq!(job(&store, row.id), ended, "it ends once");
    assert!(store.close(TIMEOUT));
    assert_eq!(store.job(&row.id), Err(StoreError::Closed));
    assert_eq!(job(&open(folder.path(), limits()).0, row.id), ended);
    assert!(finish(&store, &JobId::default(), JobState::Failed).is_err());
}

#[test]
fn many_at_once_are_accepted_or_refused_and_none_is_lost() {
    let (_folder, store) = new_store(limits());
    let answers: Vec<SubmitOutcome> = std::thread::scope(|scope| {
        let send = |thread: usize| {
            let (store, name) = (&store, move |number| format!("job-{thread}-{number}"));
            let plate = if thread.is_multiple_of(2) { "a" } else { "b" };
            scope.spawn(move || (0..12).map(|n| accept(store, &new_job(&name(n), plate))).collect::<Vec<_>>())
        };
        let threads: Vec<_> = (0..8).map(send).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    });
    let accepted = answers.iter().filter_map(|answer| match answer {
        SubmitOutcome::New(row) => Some(row.id),
        SubmitOutcome::QueueFull { queued: QUEUE } => None,
        other => panic!("{other:?}"),
    });
    let accepted: BTreeSet<JobId> = accepted.collect();
    assert_eq!((answers.len(), accepted.len()), (96, 60));
    assert!(store.all_jobs().iter().map(|row| row.id).eq(accepted));
    let counts = [("a".into(), JobState::Queued, 30), ("b".into(), JobState::Queued, 30)];
    assert_eq!(store.counts(None).unwrap(), counts);
}

#[test]
fn each_job_is_claimed_once_in_the_order_of_submission() {
    let (_folder, store) = new_store(limits());
    let queued: Vec<JobId> = (0..20).map(|number| queue(&store, &format!("job-{number}"), "a").id).collect();
    let claimed: Vec<Vec<JobId>> = std::thread::scope(|scope| {
        let all = || std::iter::from_fn(|| claim(&store, "a")).map(|claimed| claimed.id).collect();
        [scope.spawn(all), scope.spawn(all)].map(|thread| thread.join().unwrap()).to_vec()
    });
    assert!(claimed.iter().all(|ids| ids.is_sorted()));
    assert_eq!(claimed.iter().map(Vec::len).sum::<usize>(), 20);
    assert_eq!(claimed.iter().flatten().copied().collect::<BTreeSet<_>>(), queued.into_iter().collect());
}

#[test]
fn job_moved_to_the_front_runs_first_also_after_a_restart() {
    let (folder, store) = new_store(limits());
    let [first, second, third] = ["first", "second", "third"].map(|name| queue(&store, name, "a").id);
    let elsewhere = queue(&store, "elsewhere", "b").id;
    let to_front = |store: &Store, id: JobId| store.move_to_front(&id).unwrap().map(|row| row.turn);
    assert_eq!(to_front(&store, second), Some(-1));
    assert_eq!(to_front(&store, third), Some(-2));
    assert_eq!([third, elsewhere].map(|id| to_front(&store, id)), [Some(-2), Some(0)], "they are first already");
    assert_eq!(to_front(&store, JobId::default()), None);
    drop(store);
    let store = open(folder.path(), limits()).0;
    let next = claim(&store, "a").unwrap();
    assert_eq!((next.id, next.turn), (third, -2));
    assert_eq!(to_front(&store, third), Some(-2), "a running job stays as it is");
    assert_eq!([(); 2].map(|()| claim(&store, "a").unwrap().id), [second, first]);
}

#[test]
fn only_queued_jobs_are_cancelled() {
    let (_folder, store) = new_store(limits());
    let [running, waiting] = ["one", "two"].map(|name| queue(&store, name, "a").id);
    claim(&store, "a").unwrap();
    let cancel = |id: JobId| store.cancel_queued(&id).unwrap();
    assert!(matches!(cancel(running), Some((row, false)) if row.state == JobState::Running));
    let (row, is_cancelled) = cancel(waiting).unwrap();
    assert_eq!((row.state, row.reason.as_str()), (JobState::Cancelled, "cancelled before it began"));
    assert!(is_cancelled);
    assert!(matches!(cancel(waiting), Some((row, false)) if row.state == JobState::Cancelled));
    assert_eq!(cancel(JobId::default()), None);
    assert_eq!(claim(&store, "a"), None);
}

#[test]
fn folder_that_cannot_be_made_leaves_the_job_queued() {
    let (_folder, store) = new_store(limits());
    let id = queue(&store, "one", "a").id;
    fs::remove_dir(store.runs()).unwrap();
    fs::write(store.runs(), "no folder").unwrap();
    let fault = store.claim("a").unwrap_err();
    assert!(matches!(fault, StoreError::Io(_)), "{fault}");
    assert_eq!((store.fault(), job(&store, id).state), (Some(fault), JobState::Queued));
    fs::remove_file(store.runs()).unwrap();
    store.retry();
    assert_eq!((store.fault(), claim(&store, "a").unwrap().id), (None, id));
}

#[test]
fn repeated_key_gives_the_same_job_also_after_its_deletion() {
    let (folder, store) = new_store(limits());
    let mut keyed = new_job("one", "a");
    keyed.key = Some("k".into());
    let SubmitOutcome::New(row) = accept(&store, &keyed) else { panic!("a new key") };
    let row = without_spec(row);
    let mut other = keyed.clone();
    other.body_sha256 = [8; 32];
    assert_eq!(accept(&store, &keyed), SubmitOutcome::Replayed(row.clone()));
    assert_eq!(accept(&store, &other), SubmitOutcome::KeyReused);
    assert_eq!(store.repeated("k", &[7; 32]), Ok(Some(SubmitOutcome::Replayed(row.clone()))));
    assert_eq!(store.repeated("new", &[7; 32]), Ok(None));
    let (_copy, (again, _)) = killed(folder.path());
    assert_eq!(accept(&again, &keyed), SubmitOutcome::Replayed(row.clone()), "over a kill, too");
    let entry = AuditEntry { act: AuditEntry::DELETE.into(), ..AuditEntry::default() };
    assert_eq!(store.delete(&row.id, entry), Ok(Some(true)));
    assert_eq!(accept(&store, &keyed), SubmitOutcome::KeyReused);
    assert_eq!(store.all_jobs(), []);
}

#[test]
fn job_is_not_stored_when_its_client_has_gone() {
    let (_folder, store) = new_store(limits());
    assert_eq!(store.accept(&new_job("one", "a"), || false), Ok(None));
    assert_eq!(store.all_jobs(), []);
}

#[test]
fn deleted_job_leaves_no_folder_and_a_running_one_stays() {
    let (_folder, store) = new_store(limits());
    let row = begin(&store, "one", "a");
    fs::write(folder(&store, &row).join("journal.jsonl"), "{}\n").unwrap();
    let entry = || AuditEntry { act: AuditEntry::DELETE.into(), ..AuditEntry::default() };
    assert_eq!(store.delete(&row.id, entry()), Ok(Some(false)));
    finish(&store, &row.id, JobState::Completed).unwrap();
    assert_eq!(store.delete(&row.id, entry()), Ok(Some(true)));
    assert_eq!(store.delete(&row.id, entry()), Ok(None));
    assert!(!folder(&store, &row).exists());
    assert_eq!(store.audit_log(), [("delete".to_owned(), String::new())]);
}

#[test]
fn jobs_are_listed_newest_first_page_by_page() {
    let (_folder, store) = new_store(limits());
    let ids: Vec<JobId> = (0..5).map(|number| queue(&store, &format!("job-{number}"), "a").id).collect();
    claim(&store, "a").unwrap();
    let other = queue(&store, "elsewhere", "b").id;
    let list = |state, plate, before| {
        store.list(state, plate, before, 2).unwrap().iter().map(|row| row.id).collect::<Vec<_>>()
    };
    assert_eq!(list(None, None, None), [other, ids[4]]);
    assert_eq!(list(None, None, Some(ids[2])), [ids[1], ids[0]]);
    assert_eq!(list(Some(JobState::Running), Some("a"), None), [ids[0]]);
    assert_eq!((list(None, Some("b"), None), list(None, Some("c"), None)), (vec![other], vec![]));
}
