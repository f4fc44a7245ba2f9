use std::time::Duration;

use super::draw::OverlayMark;
use super::event_publisher::Outgoing;
use super::events::EventDraft;
use super::shared::PlateInner;
use crate::states::PlateCondition;
use crate::store::JobId;
use crate::supervisor::LastObservation;
use upm_control::{
    Condition, ConditionChange, ConditionFacts, CycleFacts, EventLevel, FrameFacts, LocalisedFacts, Milestone,
    MilestoneFacts, Sink,
};
use upm_core::background::{OverflowPolicy, Queue, QueueError};
use upm_core::time::{Clock, PlateTime};
use upm_perception::vision::{Table, Track};

/// Least wall time between two published observations.
const OBSERVATION_INTERVAL: Duration = Duration::from_millis(100);

/// Observes a run for clients. It is called on the plate's own thread, so it never waits: events that find the queue
/// full, or the lock held by another thread, are dropped and counted.
pub(super) struct RunObserver<'a> {
    shared: &'a PlateInner,
    clock: &'a dyn Clock,
    publisher: Queue<Outgoing>,
    job: JobId,
    observation: LastObservation,
    table: Option<Table>,
    looked_at: Option<Duration>,
    left_out: u64,
    holding: Vec<Condition>,
}

impl<'a> RunObserver<'a> {
    pub fn new(
        shared: &'a PlateInner,
        clock: &'a dyn Clock,
        publisher: &Queue<Outgoing>,
        job: JobId,
        radii_m: Vec<f64>,
    ) -> Self {
        let observation = LastObservation { radii_m, ..LastObservation::default() };
        let publisher = publisher.with(OverflowPolicy::GiveUp);
        Self {
            shared,
            clock,
            publisher,
            job,
            observation,
            table: None,
            looked_at: None,
            left_out: 0,
            holding: Vec::new(),
        }
    }

    fn publish(&mut self, draft: EventDraft) {
        if self.left_out > 0 {
            let text = format!("{} events were left out: too many at once", self.left_out);
            let missed = EventDraft::warning(draft.plate_time, EventLevel::Warning, &text);
            if self.publisher.send(Outgoing::Event(self.job, missed)).is_ok() {
                self.left_out = 0;
            }
        }
        let sent = self.publisher.send(Outgoing::Event(self.job, draft));
        self.shared.job.heartbeat.note_publish(self.clock.elapsed(), sent.is_ok());
        if let Err(QueueError::Full(Outgoing::Event(_, draft))) = sent {
            self.left_out += u64::from(draft.durable);
        }
    }

    fn show(&mut self, now: Duration) {
        self.shared.job.set_observation(&self.observation, now);
        if self.looked_at.is_none_or(|before| now >= before + OBSERVATION_INTERVAL) {
            self.looked_at = Some(now);
            self.publish(EventDraft::observation(&self.observation, self.shared.job.pacing.behind()));
        }
    }

    fn marks(&self, tracks: &[Track]) -> Vec<OverlayMark> {
        let part = |track: &Track| OverlayMark {
            center_px: track.seen.center_px,
            radius_px: track.seen.radius_px,
            seen: track.frames_unseen == 0,
        };
        let targets = self.table.iter().flat_map(|table| {
            let target = |p_m| OverlayMark { center_px: table.image_from_table(p_m), radius_px: 0.0, seen: true };
            self.observation.targets_m.iter().copied().map(target)
        });
        tracks.iter().map(part).chain(targets).collect()
    }
}

impl Sink for RunObserver<'_> {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.table = Some(facts.table.clone());
        self.observation.at = facts.frame.exposed_at;
        self.observation.positions_m.clear();
        self.observation.positions_m.extend(facts.detections.iter().map(|part| part.position_m));
        self.show(self.clock.elapsed());
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        let now = self.clock.elapsed();
        self.observation.at = facts.frame.exposed_at;
        self.observation.positions_m.clear();
        self.observation.positions_m.extend(facts.tracks.iter().map(|track| track.seen.position_m));
        // while control waits for a part to be seen, it limits that wait itself
        let part_in_sight = facts.blind || facts.tracks.iter().any(|track| track.frames_unseen == 0);
        self.shared.job.heartbeat.frame(now, facts.frame.exposed_at, part_in_sight);
        self.show(now);
        self.shared.preview.offer(facts.frame, || self.marks(facts.tracks), now);
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.observation.targets_m.clone_from(&facts.wanted.targets_m);
        self.observation.progress = facts.wanted.progress;
        self.observation.phase.clone_from(&facts.wanted.phase);
        self.shared.job_store.progress(&self.job, facts.wanted.progress);
        self.publish(EventDraft::cycle(facts, self.shared.job.pacing.behind()));
    }

    fn event(&mut self, at: PlateTime, level: EventLevel, text: &str) {
        // a journal that fails is reported as an error, and ends the run
        if level == EventLevel::Error {
            self.shared.job.heartbeat.end();
        }
        if level != EventLevel::Info {
            self.publish(EventDraft::warning(at, level, text));
        }
    }

    fn condition(&mut self, facts: &ConditionFacts<'_>) {
        let ConditionFacts { condition, reason, .. } = *facts;
        if let Some(known) = self.holding.iter().position(|held| *held == condition) {
            self.holding.remove(known);
            self.observation.conditions.remove(known);
        }
        if facts.change == ConditionChange::Began {
            let (code, remedy) = (condition.code().to_owned(), condition.remedy().to_owned());
            self.holding.push(condition);
            self.observation.conditions.push(PlateCondition { code, reason: reason.to_owned(), remedy });
        }
        self.event(facts.at, EventLevel::Warning, facts.text);
    }

    fn milestone(&mut self, facts: &MilestoneFacts<'_>) {
        if matches!(facts.milestone, Milestone::RunEnded { .. }) {
            self.shared.job.heartbeat.end();
        }
        self.event(facts.at, facts.level, facts.text);
    }
}
