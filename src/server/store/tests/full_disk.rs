use std::fs::{self, File};
use std::io::Write;
use std::process::Command;

use super::*;
use upm_fixtures::wait::eventually_true;

/// A small mounted file system, unmounted on drop.
struct SmallDisk(tempfile::TempDir);

impl SmallDisk {
    /// `None` where a test may not mount one.
    fn mounted(bytes: u64) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let size = format!("size={bytes}");
        let made = Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(folder.path()).output();
        made.is_ok_and(|made| made.status.success()).then_some(Self(folder))
    }

    /// Writes until the disk is full.
    fn fill(&self) {
        let mut file = File::create(self.0.path().join("filler")).unwrap();
        for block in [1 << 16, 1 << 12, 1] {
            while file.write_all(&vec![1; block]).is_ok() {}
        }
    }

    fn make_room(&self) {
        fs::remove_file(self.0.path().join("filler")).unwrap();
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        Command::new("umount").arg("-l").arg(self.0.path()).output().unwrap();
    }
}

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
fn full_disk_refuses_jobs_and_still_stores_essential_writes() {
    let Some(disk) = SmallDisk::mounted(16 << 20) else {
        eprintln!("no disk could be mounted: not tested");
        return;
    };
    let limits = || StoreLimits { queued: 10_000, ..limits() };
    let OpenOutcome { store, .. } = open(disk.0.path(), limits());
    let running = begin(&store, "running", "a").row.id;
    let waiting = queue(&store, "waiting", "a").id;
    disk.fill();
    let accepted = accept_until_refused(&store);
    assert_eq!(store.health().fault, Some(StoreFault::Full));
    // an event is lost, and its publisher is notified
    assert_eq!(append(&store, running, &"x".repeat(10_000)), Err(StoreFault::Full));
    // the further course is stored
    store.audit(act("ann"));
    store.finish(&running, end(JobState::Completed)).unwrap();
    ask(|done| store.cancel_queued(&waiting, done)).unwrap();
    set_paused(&store, "a", true);
    eventually_true("the audit log is written", || store.health().audit_waiting == 0);
    assert_eq!(job(&store, running).state, JobState::Completed);
    assert_eq!(ask(|done| store.audit_tail(5, done)).unwrap().len(), 1);
    assert_eq!(all_jobs(&store).len(), accepted + 2);
    assert!(store.close(TIMEOUT));
    // a start on a full disk, too
    disk.fill();
    let OpenOutcome { store, recovery } = open(disk.0.path(), limits());
    assert!(recovery.clean);
    assert_eq!(accept(&store, new_job("new", "b")), Err(StoreFault::Full));
    disk.make_room();
    eventually_true("jobs are accepted", || accept(&store, new_job("new", "b")) != Err(StoreFault::Full));
    assert_eq!((store.health().fault, store.health().reserve), (None, true));
    assert!(disk.0.path().join("reserve").exists());
}

#[test]
fn store_at_its_size_limit_reports_full_and_recovers_when_raised() {
    let (folder, store) = new_store(StoreLimits { queued: 10_000, ..limits() });
    let pages = |number: u32| {
        let sql = format!("PRAGMA max_page_count = {number}");
        store.queue.written(true, move |tx| tx.connection.query_row(&sql, [], |row| row.get::<_, i64>(0))).unwrap()
    };
    assert!(pages(60) <= 60);
    let accepted = accept_until_refused(&store);
    assert!((1..60).contains(&accepted), "{accepted}");
    assert_eq!(all_jobs(&store).len(), accepted);
    assert!(folder.path().join("reserve").exists());
    pages(1_000_000);
    assert!(matches!(accept(&store, new_job("new", "a")), Ok(SubmitOutcome::New(_))));
    assert_eq!(store.health().fault, None);
}
