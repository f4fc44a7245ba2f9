//! Stops, resets and cancels at unusual moments.

use std::sync::Barrier;
use std::thread;

use super::*;
use crate::supervisor::emergency_stop::StopState;
use upm_core::job::{Finding, StopCause};
use upm_core::time::{Clock, PlateTime};
use upm_recording::{RecordingHandle, WriterStatus};
use upm_runner::run::ExternalStop;

/// True when a stop holds completely, false when none holds.
fn stopped(plate: &PlateHandle) -> bool {
    let state = plate.emergency_stop.state();
    assert!(matches!(state, StopState::Released | StopState::Held), "half a stop: {state:?}");
    state == StopState::Held
}

#[test]
fn a_reset_whose_caller_has_gone_by_the_time_it_is_written_leaves_the_plate_stopped() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    plate.estop();
    assert_eq!(plate.reset(plate.emergency_stop.held().unwrap(), caller("ann"), || false), Err(ResetError::NotAwaited));
    assert!(stopped(plate));
    assert_eq!(test_plates.acts(), ["reset", "reset refused"]);
}

#[test]
fn unrecorded_reset_is_refused() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    plate.estop();
    test_plates.store.fail_audit(true);
    assert!(matches!(reset(plate, "ann"), Err(ResetError::NotPersisted(_))));
    assert!(stopped(plate));
    test_plates.store.fail_audit(false);
    assert_eq!(reset(plate, "ann"), Ok(()));
    assert!(!stopped(plate));
}

#[test]
fn stops_and_resets_at_once_never_leave_half_a_stop() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(Some("a test"));
    let plate = plates.get("one").unwrap();
    for _ in 0..50 {
        plate.estop();
        let start = Barrier::new(4);
        let reset = thread::scope(|scope| {
            let resets = [(); 2].map(|()| {
                scope.spawn(|| {
                    start.wait();
                    reset(plate, "ann")
                })
            });
            for _ in 0..2 {
                scope.spawn(|| {
                    start.wait();
                    plate.estop();
                });
            }
            resets.map(|reset| reset.join().unwrap())
        });
        let holds = stopped(plate);
        assert!(holds || reset.contains(&Ok(())), "{reset:?}");
    }
}

#[test]
fn a_cancel_is_kept_for_a_job_that_has_yet_to_come_onto_the_plate() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(Some("not yet"));
    let plate = plates.get("one").unwrap();
    let id = test_plates.submit(plate, HOLD, Pace::RealTime);
    // as after the plate has claimed it and before it reports the start
    assert!(plate.job.cancel(&id));
    assert!(plate.resume(caller("ann")));
    let ended = test_plates.ended(&id);
    assert_eq!((ended.state, ended.reason.as_str()), (JobState::Cancelled, "cancelled by request"));
    assert!(!plate.job.cancel(&id), "its run is over");
    let other = test_plates.submit(plate, TWO_COINS, Pace::Max);
    assert_eq!(test_plates.ended(&other).state, JobState::Completed);
}

#[test]
fn a_run_of_which_only_files_are_left_to_write_is_not_stopped() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(Some("a test"));
    let plate = plates.get("one").unwrap();
    let shared = plate;
    let [first, second] = [(); 2].map(|()| test_plates.submit(plate, TWO_COINS, Pace::Max));
    let begin = |job| shared.job.begin(job, false, RecordingHandle::default(), WriterStatus::default());
    let frame = || shared.job.heartbeat.frame(plate.clock.elapsed(), PlateTime::ZERO, true);
    let trip_watchdog = |job: &JobId| {
        shared.fail_job(job, ExternalStop::of(Finding::Hung, "no frame came"));
        shared.emergency_stop.interlock.tripped()
    };
    begin(first);
    frame();
    shared.job.heartbeat.end();
    assert!(shared.job.driven().is_none());
    assert_eq!(trip_watchdog(&first), None, "control has returned");
    assert_eq!(shared.job.end(), None);
    assert_eq!(trip_watchdog(&first), None);
    begin(second);
    frame();
    assert_eq!(shared.job.driven().map(|(job, _)| job), Some(second));
    assert_eq!(trip_watchdog(&first), None, "it is the next one's turn");
    assert_eq!(trip_watchdog(&second), Some(Trip::Watchdog));
    assert_eq!(shared.job.end(), Some(ExternalStop::of(Finding::Hung, "no frame came")));
}

#[test]
fn job_with_a_used_run_folder_is_not_run_again() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(Some("not yet"));
    let plate = plates.get("one").unwrap();
    let [id, empty] = [(); 2].map(|()| test_plates.submit(plate, TWO_COINS, Pace::Max));
    let folder = |id: &JobId| test_plates.folder.path().join("runs").join(test_plates.row(id).run_folder());
    let journal = folder(&id).join("journal.jsonl");
    [id, empty].iter().for_each(|id| std::fs::create_dir_all(folder(id)).unwrap());
    std::fs::write(&journal, "what there was\n").unwrap();
    assert!(plate.resume(caller("ann")));
    let reason = test_plates.ended(&id).job.reason;
    assert_eq!(reason, "its run folder holds a run: it had begun before, and is not run again");
    assert_eq!(std::fs::read_to_string(&journal).unwrap(), "what there was\n");
    assert_eq!(test_plates.ended(&empty).state, JobState::Completed, "an empty folder is no run");
}

#[test]
fn hung_controller_trips_the_watchdog() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open_with(Some("a test"), |daemon| daemon.watchdog.hung = Duration::from_millis(300));
    let plate = plates.get("one").unwrap();
    let shared = plate;
    let job = test_plates.submit(plate, TWO_COINS, Pace::RealTime);
    shared.job.begin(job, false, RecordingHandle::default(), WriterStatus::default());
    shared.job.heartbeat.frame(plate.clock.elapsed(), PlateTime::ZERO, true);
    while shared.emergency_stop.interlock.tripped().is_none() {
        thread::yield_now();
    }
    let cause = shared.cause().unwrap();
    assert_eq!(
        (shared.emergency_stop.interlock.tripped(), cause.cause),
        (Some(Trip::Watchdog), StopCause::Found(Finding::Hung)),
        "{cause:?}"
    );
}
