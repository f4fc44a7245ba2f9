use super::draw::OverlayMark;
use super::shared::PlateInner;
use crate::states::PlateCondition;
use crate::supervisor::LastObservation;
use upm_control::{
    Condition, ConditionChange, ConditionFacts, CycleFacts, EventLevel, FrameFacts, LocalisedFacts, Milestone,
    MilestoneFacts, Sink,
};
use upm_core::time::{Clock, PlateTime};
use upm_perception::vision::{Table, Track};

/// Observes a run for clients. It is called on the plate's own thread, so it never waits: what finds a lock held by
/// another thread is dropped.
pub(super) struct RunObserver<'a> {
    shared: &'a PlateInner,
    clock: &'a dyn Clock,
    observation: LastObservation,
    table: Option<Table>,
    holding: Vec<Condition>,
}

impl<'a> RunObserver<'a> {
    pub fn new(shared: &'a PlateInner, clock: &'a dyn Clock, radii_m: Vec<f64>) -> Self {
        let observation = LastObservation { radii_m, ..LastObservation::default() };
        Self { shared, clock, observation, table: None, holding: Vec::new() }
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
        self.shared.job.set_observation(&self.observation, self.clock.elapsed());
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        let now = self.clock.elapsed();
        self.observation.at = facts.frame.exposed_at;
        self.observation.positions_m.clear();
        self.observation.positions_m.extend(facts.tracks.iter().map(|track| track.seen.position_m));
        // while control waits for a part to be seen, it limits that wait itself
        let part_in_sight = facts.blind || facts.tracks.iter().any(|track| track.frames_unseen == 0);
        self.shared.job.heartbeat.frame(now, facts.frame.exposed_at, part_in_sight);
        self.shared.job.set_observation(&self.observation, now);
        self.shared.preview.offer(facts.frame, || self.marks(facts.tracks), now);
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.observation.targets_m.clone_from(&facts.wanted.targets_m);
        self.observation.progress = facts.wanted.progress;
        self.observation.phase.clone_from(&facts.wanted.phase);
    }

    fn event(&mut self, _at: PlateTime, level: EventLevel, _text: &str) {
        // a journal that fails is reported as an error, and ends the run
        if level == EventLevel::Error {
            self.shared.job.heartbeat.end();
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
    }

    fn milestone(&mut self, facts: &MilestoneFacts<'_>) {
        if matches!(facts.milestone, Milestone::RunEnded { .. }) {
            self.shared.job.heartbeat.end();
        }
        self.event(facts.at, facts.level, facts.text);
    }
}
