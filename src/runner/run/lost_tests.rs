use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::testing::with_small_pictures;
use super::*;
use crate::config::Origin;
use upm_control::PulseFacts;
use upm_core::job::{Finding, Outcome, StopCause};
use upm_core::rig::{Rig, RigError};
use upm_core::signal::{AccelTrace, Drive, Frame};
use upm_core::time::MonotonicClock;
use upm_core::time::PlateTime;

/// A rig whose camera shows uniform gray from pulse `blind_from` on, counted from 1.
struct MaskedRig<'a> {
    rig: &'a mut dyn Rig,
    pulses: u64,
    blind_from: Option<u64>,
    blind_at: Option<PlateTime>,
}

impl Rig for MaskedRig<'_> {
    fn now(&self) -> PlateTime {
        self.rig.now()
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        self.pulses += 1;
        if self.blind_from == Some(self.pulses) {
            self.blind_at = Some(self.rig.now());
        }
        self.rig.play(drive)
    }

    fn takes_over(&self) -> bool {
        true
    }

    fn take_over(&mut self, drive: &Drive) -> Result<PlateTime, RigError> {
        self.rig.take_over(drive)
    }

    fn settled_at(&self) -> PlateTime {
        self.rig.settled_at()
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigError> {
        self.rig.capture(frame)?;
        if self.blind_at.is_some() {
            frame.pixels.fill(128);
        }
        Ok(())
    }

    fn trace(&self) -> AccelTrace {
        self.rig.trace()
    }

    fn stop(&mut self) {
        self.rig.stop();
    }
}

/// Counts the pulses of the first cycle.
#[derive(Default)]
struct FirstCycle(u64);

impl Sink for FirstCycle {
    fn pulse(&mut self, facts: &PulseFacts) {
        self.0 += u64::from(facts.cycle == 0);
    }
}

/// Runs the first cycle of four coins moved by one rotation after the other; returns its pulses, the ending, and the
/// time for which it continued without a picture, s.
fn first_cycle(blind_from: Option<u64>) -> (u64, FinalState, f64) {
    let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let file = root.join("configs/arrange-4.json");
    let mut job: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    job["planner"] = json!("cor_sequence");
    let job = with_small_pictures(JobSpec::from_json(&job.to_string(), &Origin::of_file(&file), None).unwrap());
    let library = job_library(&job).unwrap();
    let RunSetup { mut rig, model, mut task, mut params, .. } = RunSetup::new(&job, &library).unwrap();
    params.time_limit_s = 8.0;
    let (mut pulses, clock) = (FirstCycle::default(), MonotonicClock::new());
    let (stop, give_way) = (AtomicBool::new(false), AtomicBool::new(false));
    let mut rig = MaskedRig { rig: &mut rig, pulses: 0, blind_from, blind_at: None };
    let (sink, clock) = (&mut pulses, &clock);
    let devices = RunIo { rig: &mut rig, model: &model, sink, clock, stop: &stop, give_way: &give_way };
    let finish = control::run(devices, &library, task.as_mut(), &params);
    let blind_s = rig.blind_at.map_or(0.0, |at| rig.now().secs() - at.secs());
    (pulses.0, finish, blind_s)
}

#[test]
fn camera_that_shows_no_plate_is_waited_for_and_then_ends_the_run_in_the_middle_of_a_cycle() {
    let (whole, ..) = first_cycle(None);
    let (played, finish, blind_s) = first_cycle(Some(1));
    assert_eq!(finish.ending.outcome, Outcome::Failed);
    assert_eq!(finish.ending.cause, Some(StopCause::Found(Finding::CameraDark)), "{}", finish.ending.reason);
    assert!(finish.ending.reason.contains("check the light"), "{}", finish.ending.reason);
    assert!(played < whole, "{played} of {whole} pulses");
    assert!((5.0..6.0).contains(&blind_s), "{blind_s}");
}
