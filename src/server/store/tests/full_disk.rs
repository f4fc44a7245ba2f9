use super::*;

/// Submits jobs until one is refused; returns how many were accepted.
fn accept_until_refused(store: &Store) -> usize {
    let mut accepted = 0;
    loop {
        let long = NewJob { spec_json: "x".repeat(10_000), ..new_job("one", "a") };
        match accept(store, long) {
            Ok(SubmitOutcome::New(_)) => accepted += 1,
            refused => {
                assert_eq!(refused, Err(StoreFault::Full));
                return accepted;
            }
        }
    }
}

#[test]
fn store_at_its_size_limit_reports_full_and_recovers_when_raised() {
    let (_folder, store) = new_store(StoreLimits { queued: 10_000, ..limits() });
    let pages = |number: u32| {
        let sql = format!("PRAGMA max_page_count = {number}");
        store.queue.written(move |tx| tx.connection.query_row(&sql, [], |row| row.get::<_, i64>(0))).unwrap()
    };
    assert!(pages(60) <= 60);
    let accepted = accept_until_refused(&store);
    assert!((1..60).contains(&accepted), "{accepted}");
    assert_eq!(all_jobs(&store).len(), accepted);
    pages(1_000_000);
    assert!(matches!(accept(&store, new_job("new", "a")), Ok(SubmitOutcome::New(_))));
    assert_eq!(store.health().fault, None);
}
