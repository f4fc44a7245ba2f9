use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use serde::Serialize;

use crate::store::{FINISHED, JobId, JobState, RecordingStatus, StoredEvent};
use crate::supervisor::LastObservation;
use upm_control::{CycleFacts, EventLevel};
use upm_core::time::PlateTime;
use upm_core::units::places_mm;
use upm_planner::PlannedPulse;

/// An event of a job, as published to subscribers.
#[derive(Clone, Debug, PartialEq)]
pub struct JobEvent {
    /// Id of the job that the event is about.
    pub job: JobId,
    /// Number of the event within its job; `None` for events that are not stored: observations, and those the store
    /// could not take.
    pub seq: Option<u64>,
    /// `state`, `cycle`, `warning`, `recording`, `finished` or `look`.
    pub kind: &'static str,
    /// Content as JSON.
    pub body: Arc<str>,
}

impl JobEvent {
    /// The end of a job, as stored.
    pub(super) fn finished(job: JobId, event: StoredEvent) -> Self {
        Self { job, seq: Some(event.seq), kind: FINISHED, body: event.body }
    }
}

/// Receives the events of a plate. Must return at once, since it runs on the publisher's thread.
pub trait EventSubscriber: Send + Sync {
    /// Receives one event.
    fn offer(&self, event: &JobEvent);
}

/// All subscribers of a plate.
#[derive(Default)]
pub(super) struct Subscribers(Mutex<Vec<Arc<dyn EventSubscriber>>>);

impl Subscribers {
    pub fn add(&self, subscriber: Arc<dyn EventSubscriber>) {
        self.0.lock().push(subscriber);
    }

    pub fn offer(&self, event: &JobEvent) {
        self.0.lock().iter().for_each(|subscriber| subscriber.offer(event));
    }
}

impl std::fmt::Debug for Subscribers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Subscribers")
    }
}

/// An event on its way from the plate to the publisher, with its own copy of the text.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct EventDraft {
    pub plate_time: PlateTime,
    pub kind: &'static str,
    pub body: Arc<str>,
    /// True for events that are stored and numbered.
    pub durable: bool,
}

#[derive(Serialize)]
#[serde(untagged)]
enum EventBody<'a> {
    State {
        state: &'a str,
        at_s: f64,
    },
    Cycle {
        cycle: u64,
        at_s: f64,
        phase: &'a str,
        progress: f64,
        pulses: usize,
        pulse_kinds: [usize; 2],
        observed_mm: Vec<[f64; 2]>,
        result_mm: Vec<[f64; 2]>,
        targets_mm: Vec<[f64; 2]>,
        behind_s: f64,
    },
    Warning {
        at_s: f64,
        level: &'a str,
        text: &'a str,
    },
    Recording {
        at_s: f64,
        recording: &'a str,
        reason: &'a str,
    },
    Look {
        at_s: f64,
        phase: &'a str,
        progress: f64,
        positions_mm: Vec<[f64; 2]>,
        targets_mm: Vec<[f64; 2]>,
        behind_s: f64,
    },
}

impl EventDraft {
    fn new(plate_time: PlateTime, kind: &'static str, durable: bool, body: &EventBody<'_>) -> Self {
        let body = serde_json::to_string(body).unwrap_or_else(|_| "{}".into());
        Self { plate_time, kind, body: body.into(), durable }
    }

    pub fn state(at: PlateTime, state: JobState) -> Self {
        Self::new(at, "state", true, &EventBody::State { state: state.code(), at_s: at.secs() })
    }

    /// A planned cycle; `behind` is the lag of plate time behind the clock.
    pub fn cycle(facts: &CycleFacts<'_>, behind: Duration) -> Self {
        let pulses = &facts.plan.pulses;
        let rotations = pulses.iter().filter(|pulse| matches!(pulse, PlannedPulse::Rotation(_))).count();
        let body = EventBody::Cycle {
            cycle: facts.index,
            at_s: facts.ended_at.secs(),
            phase: &facts.wanted.phase,
            progress: facts.wanted.progress,
            pulses: pulses.len(),
            pulse_kinds: [rotations, pulses.len() - rotations],
            observed_mm: places_mm(facts.observed_m),
            result_mm: places_mm(facts.result_m),
            targets_mm: places_mm(&facts.wanted.targets_m),
            behind_s: behind.as_secs_f64(),
        };
        Self::new(facts.ended_at, "cycle", true, &body)
    }

    pub fn warning(at: PlateTime, level: EventLevel, text: &str) -> Self {
        Self::new(at, "warning", true, &EventBody::Warning { at_s: at.secs(), level: level.name(), text })
    }

    pub fn recording(at: PlateTime, kept: RecordingStatus, reason: &str) -> Self {
        Self::new(at, "recording", true, &EventBody::Recording { at_s: at.secs(), recording: kept.code(), reason })
    }

    /// An observation; `behind` as in [`EventDraft::cycle`].
    pub fn observation(observation: &LastObservation, behind: Duration) -> Self {
        let body = EventBody::Look {
            at_s: observation.at.secs(),
            phase: &observation.phase,
            progress: observation.progress,
            positions_mm: places_mm(&observation.positions_m),
            targets_mm: places_mm(&observation.targets_m),
            behind_s: behind.as_secs_f64(),
        };
        Self::new(observation.at, "look", false, &body)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::Vec2;

    #[test]
    fn bodies_are_plain_json_in_millimetres() {
        let observation = LastObservation {
            at: PlateTime::from_secs(1.25),
            positions_m: vec![Vec2::new(0.012_345_678, -1e-9)],
            radii_m: vec![0.01],
            targets_m: vec![Vec2::zeros()],
            progress: 0.5,
            phase: "a \"phase\"".into(),
            ..LastObservation::default()
        };
        let observation = EventDraft::observation(&observation, Duration::from_millis(8200));
        assert!(!observation.durable && observation.kind == "look");
        let read: serde_json::Value = serde_json::from_str(&observation.body).unwrap();
        let wanted = serde_json::json!({
            "at_s": 1.25, "phase": "a \"phase\"", "progress": 0.5,
            "positions_mm": [[12.346, -0.0]], "targets_mm": [[0.0, 0.0]], "behind_s": 8.2,
        });
        assert_eq!(read, wanted);
        let running = EventDraft::state(PlateTime::ZERO, JobState::Running);
        assert_eq!(&*running.body, r#"{"state":"running","at_s":0.0}"#);
        assert!(running.durable);
    }
}
