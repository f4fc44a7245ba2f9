//! Standing jobs: they run on an idle plate and give way to every queued job.

use super::*;
use crate::states::{StandingJob, StandingState};
use crate::supervisor::current_job::RunningJob;
use upm_runner::config::{JobSpec, Origin};

/// A standing job at the greatest pace, with the parts and the task given.
fn setup(task: &str, plate_time_s: f64) -> StandingSpec {
    let text = format!(
        r#"{{ "name": "standing", "rig": "rigs/upm-2.json", "parts": [{{ "kind": "penny", "position_mm": [30, 0] }}],
            "planner": "synthesized_field", "task": {task}, "limits": {{ "plate_time_s": {plate_time_s} }} }}"#
    );
    let origin = Origin::of_file(&root().join("configs/standing.json"));
    StandingSpec { job: JobSpec::from_json(&text, &origin, None).unwrap(), starts_paused: false }
}

fn endless() -> StandingSpec {
    setup(r#"{ "type": "plus_sign", "laps": 0 }"#, 600.0)
}

/// Plates that are shut down with their test: a standing job never ends by itself.
struct ShutDownPlates(PlateSupervisor);

impl std::ops::Deref for ShutDownPlates {
    type Target = PlateSupervisor;

    fn deref(&self) -> &PlateSupervisor {
        &self.0
    }
}

impl Drop for ShutDownPlates {
    fn drop(&mut self) {
        self.0.shutdown(LONG);
    }
}

fn test_plates(standing: StandingSpec) -> TestPlates {
    TestPlates { standing: Some(standing), ..TestPlates::new() }
}

/// State of the plate's standing job, and the reason for it.
fn standing(plate: &PlateHandle) -> (StandingState, String) {
    let StandingJob { name, state, why } = plate.snapshot().standing_job.unwrap();
    assert_eq!(name, "standing");
    (state, why)
}

/// Waits until the standing job is in that state; returns the reason.
fn until(plate: &PlateHandle, state: StandingState) -> String {
    eventually(&format!("the standing job is {state:?}"), || {
        let (now, why) = standing(plate);
        (now == state).then_some(why)
    })
}

/// Waits until the standing job has planned a cycle; returns the job.
fn cycling(plate: &PlateHandle) -> JobId {
    eventually("the standing job runs", || {
        let snapshot = plate.snapshot();
        let runs = snapshot.standing_job?.state == StandingState::Running && !snapshot.observation.phase.is_empty();
        snapshot.job.filter(|_| runs).and_then(|id| JobId::parse(&id))
    })
}

/// Name, state and standing flag of each job, oldest first.
fn jobs(test_plates: &TestPlates) -> Vec<(String, JobState, bool)> {
    test_plates.store.all_jobs().into_iter().map(|row| (row.name.clone(), row.state, row.standing)).collect()
}

#[test]
fn standing_job_runs_when_idle_gives_way_to_a_queued_job_and_runs_again() {
    let test_plates = test_plates(endless());
    let plates = ShutDownPlates(test_plates.open(None));
    let plate = plates.get("one").unwrap();
    let first = cycling(plate);
    assert_eq!((plate.snapshot().state, standing(plate).1), (PlateState::Running, String::new()));

    let queued = test_plates.submit(plate, TWO_COINS, Pace::Max);
    assert_eq!([&first, &queued].map(|id| test_plates.ended(id).state), [JobState::Completed; 2]);
    cycling(plate);
    assert_eq!(plates.shutdown(LONG), Vec::<String>::new());
    let run = |state| ("standing".to_owned(), state, true);
    let two = ("two".to_owned(), JobState::Completed, false);
    assert_eq!(jobs(&test_plates), [run(JobState::Completed), two, run(JobState::Interrupted)]);

    let row = test_plates.row(&first);
    let report = row.job.report.unwrap();
    assert_eq!((&report["stop"]["code"], &report["outcome"]), (&"gave_way".into(), &"completed".into()));
    let folder = test_plates.folder.path().join("runs").join(row.folder.unwrap());
    let journal = std::fs::read_to_string(folder.join("journal.jsonl")).unwrap();
    assert!(!journal.contains("unfinished_cycle"), "it ends between two cycles");
    assert!(test_plates.row(&queued).started_at.is_some());
}

#[test]
fn endless_standing_job_begins_again_when_its_recording_or_its_journal_is_large() {
    let test_plates = test_plates(endless());
    let plates = ShutDownPlates(test_plates.open(None));
    let plate = plates.get("one").unwrap();
    let is_large: [fn(&RunningJob); 2] =
        [|run| run.recording.add_bytes(33_000_000), |run| run.journal.add_bytes(33_000_000)];
    for is_large in is_large {
        let first = cycling(plate);
        is_large(&plate.job.running().unwrap());
        let ended = test_plates.ended(&first);
        let stop = &ended.report.as_ref().unwrap()["stop"];
        assert_eq!((ended.state, &stop["code"]), (JobState::Completed, &"gave_way".into()));
        assert!(cycling(plate) != first);
    }
}

#[test]
fn endless_standing_job_is_completed_at_its_limit_and_begins_again() {
    let test_plates = test_plates(setup(r#"{ "type": "hold" }"#, 0.5));
    let plates = ShutDownPlates(test_plates.open(None));
    let ended = || test_plates.store.all_jobs().into_iter().filter(|row| row.state.is_final()).collect::<Vec<_>>();
    eventually_true("it ends twice", || ended().len() >= 2);
    let first = ended().remove(0);
    let reason = "plate time limit of 0.5 s reached";
    assert_eq!((first.state, first.reason.as_str()), (JobState::Completed, reason));
    drop(plates);
}

#[test]
fn failed_standing_job_waits_for_an_operator_and_reports_why() {
    let test_plates = test_plates(setup(r#"{ "type": "arrange", "targets_mm": [[-100, 0]] }"#, 0.5));
    let plates = ShutDownPlates(test_plates.open(None));
    let why = until(plates.get("one").unwrap(), StandingState::Paused);
    assert!(why.starts_with("its last run failed: plate time limit of 0.5 s reached; "), "{why}");
    // the plate is paused before its job's end is stored
    let is_running = || jobs(&test_plates).iter().any(|(_, state, _)| *state == JobState::Running);
    eventually_true("the run ends", || !is_running());
    assert_eq!(jobs(&test_plates), [("standing".to_owned(), JobState::Failed, true)]);
}

#[test]
fn standing_job_with_an_end_that_gives_way_is_cancelled() {
    let test_plates = test_plates(setup(r#"{ "type": "plus_sign", "laps": 50 }"#, 6000.0));
    let plates = ShutDownPlates(test_plates.open(None));
    let plate = plates.get("one").unwrap();
    let first = cycling(plate);
    let queued = test_plates.submit(plate, TWO_COINS, Pace::Max);
    let ended = test_plates.ended(&first);
    assert_eq!((ended.state, ended.reason.as_str()), (JobState::Cancelled, "gave way to another job"));
    assert_eq!(test_plates.ended(&queued).state, JobState::Completed);
    cycling(plate);
}

#[test]
fn standing_job_waits_while_the_disk_is_nearly_full() {
    let test_plates = test_plates(endless());
    let plates = ShutDownPlates(test_plates.open_with(None, |daemon| daemon.min_free_bytes = u64::MAX / 2));
    let plate = plates.get("one").unwrap();
    // other jobs still run
    let queued = test_plates.submit(plate, TWO_COINS, Pace::Max);
    assert_eq!(test_plates.ended(&queued).state, JobState::Completed);
    eventually_true("the standing job waits for room", || {
        let (state, why) = standing(plate);
        assert_eq!(state, StandingState::Waiting);
        why.starts_with("the disk has ")
    });
    assert_eq!(jobs(&test_plates).len(), 1);
}
