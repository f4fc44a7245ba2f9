use std::sync::atomic::{AtomicBool, Ordering};

use super::preview::OverlayMark;
use crate::states::PlateFinding;
use crate::supervisor::{Observation, PlateHandle};
use upm_control::{CycleFacts, EventFacts, EventKind, EventLevel, FrameFacts, LocalisedFacts, Reason, Sink};
use upm_core::geometry::Vec2;
use upm_core::time::{Clock, PlateTime};
use upm_core::units::{mm_from_m, places_mm};
use upm_perception::vision::{Table, Track};
use upm_recording::RecordingOptions;

/// Observes a run for clients. It is called on the plate's own thread, so it never waits: what finds a lock held by
/// another thread is dropped.
pub(super) struct RunObserver<'a> {
    shared: &'a PlateHandle,
    observation: Observation,
    targets_m: Vec<Vec2>,
    table: Option<Table>,
    options: &'a RecordingOptions,
    /// Ends a run of an endless standing job, which then begins again; `None` for other jobs.
    pub begin_again: Option<&'a AtomicBool>,
}

/// Largest recording and journal of a run of an endless standing job, bytes: the next run begins then.
const STANDING_BYTES: u64 = 32_000_000;

impl<'a> RunObserver<'a> {
    pub fn new(shared: &'a PlateHandle, radii_m: Vec<f64>, options: &'a RecordingOptions) -> Self {
        let radii_mm = radii_m.into_iter().map(mm_from_m).collect();
        let observation = Observation { radii_mm, ..Observation::default() };
        Self { shared, observation, targets_m: Vec::new(), table: None, options, begin_again: None }
    }

    /// Keeps the files of the run within their bounds, however long it is.
    fn bound_files(&self) {
        let bytes = self.options.recording.bytes();
        if let Some(begin_again) = self.begin_again.filter(|_| bytes + self.options.journal.bytes() > STANDING_BYTES) {
            begin_again.store(true, Ordering::SeqCst);
        }
        if bytes > self.shared.store.keep.runs_bytes {
            self.options.recording.fail("it alone is larger than `keep.runs_gb` allows all to be");
        }
    }

    fn see(&mut self, at: PlateTime, positions_m: impl Iterator<Item = Vec2>) {
        self.observation.at_s = at.secs();
        self.observation.positions_mm.clear();
        self.observation.positions_mm.extend(positions_m.map(|at| [at.x, at.y].map(mm_from_m)));
    }

    fn marks(&self, tracks: &[Track]) -> Vec<OverlayMark> {
        let part = |track: &Track| OverlayMark {
            center_px: track.seen.center_px,
            radius_px: track.seen.radius_px,
            seen: track.frames_unseen == 0,
        };
        let targets = self.table.iter().flat_map(|table| {
            let target = |p_m| OverlayMark { center_px: table.image_from_table(p_m), radius_px: 0.0, seen: true };
            self.targets_m.iter().copied().map(target)
        });
        tracks.iter().map(part).chain(targets).collect()
    }
}

impl Sink for RunObserver<'_> {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.table = Some(facts.table.clone());
        self.see(facts.frame.exposed_at, facts.detections.iter().map(|part| part.position_m));
        self.shared.job.set_observation(&self.observation, self.shared.clock.elapsed());
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        let now = self.shared.clock.elapsed();
        self.see(facts.frame.exposed_at, facts.tracks.iter().map(|track| track.seen.position_m));
        // while control waits for a part to be seen, it limits that wait itself
        let part_in_sight = facts.blind || facts.tracks.iter().any(|track| track.frames_unseen == 0);
        self.shared.job.heartbeat.frame(now, facts.frame.exposed_at, part_in_sight);
        self.shared.job.set_observation(&self.observation, now);
        self.bound_files();
        self.shared.preview.offer(facts.frame, || self.marks(facts.tracks), now);
    }

    fn cycle(&mut self, facts: &CycleFacts) {
        self.targets_m.clone_from(&facts.wanted.targets_m);
        self.observation.targets_mm = places_mm(&self.targets_m);
        self.observation.progress = facts.wanted.progress.clamp(0.0, 1.0);
        self.observation.phase.clone_from(&facts.wanted.phase);
    }

    fn event(&mut self, event: &EventFacts) {
        // a journal that fails is reported as an error, and ends the run
        if event.level == EventLevel::Error || matches!(event.kind, EventKind::RunEnded { .. }) {
            self.shared.job.heartbeat.end();
        }
        if let EventKind::Finding { found, ended_after, reason } = &event.kind {
            self.observation.findings.retain(|held| held.code != found.finding.code());
            if ended_after.is_none() {
                let (code, remedy) = (found.finding.code().to_owned(), found.finding.check().to_owned());
                let Reason { text: reason, runner_up } = reason.clone();
                self.observation.findings.push(PlateFinding { code, reason, remedy, runner_up });
            }
        }
    }
}
