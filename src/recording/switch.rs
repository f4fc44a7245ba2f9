use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use super::report::RecordingReport;
use upm_control::{EventLevel, Milestone, MilestoneFacts, Sink};
use upm_core::time::PlateTime;

/// What has become of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RecordingState {
    /// There is none, or not yet.
    Off,
    /// It is being written.
    Writing {
        /// What is in the file by now.
        bytes: u64,
    },
    /// It was stopped for this reason; the file is closed and whole as far as it goes.
    Stopped(String),
    /// Something could not be recorded, for this reason.
    Failed(String),
    /// The file is closed and holds the whole run.
    Whole,
}

/// Tells how the recording of one run is getting on, and stops it while the run goes on. Clones are the same switch.
/// No call ever waits.
#[derive(Clone, Debug, Default)]
pub struct RecordingSwitch(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    begun: AtomicBool,
    bytes: AtomicU64,
    wanted_stop: OnceLock<String>,
    /// What it ended as, the first thing that counts.
    end: OnceLock<RecordingState>,
    told: AtomicBool,
}

impl RecordingSwitch {
    /// Has the recording closed soon, whole as far as it goes. The first `reason` counts.
    pub fn stop(&self, reason: &str) {
        self.0.wanted_stop.set(reason.to_owned()).ok();
    }

    /// What has become of the recording.
    pub fn state(&self) -> RecordingState {
        match self.0.end.get() {
            Some(end) => end.clone(),
            None if self.0.begun.load(Ordering::Acquire) => RecordingState::Writing { bytes: self.bytes() },
            None => RecordingState::Off,
        }
    }

    /// What is in the file by now.
    pub fn bytes(&self) -> u64 {
        self.0.bytes.load(Ordering::Relaxed)
    }

    /// Tells, once, that the recording has ended before the run did.
    pub fn news(&self) -> Option<RecordingReport> {
        let end = self.ended_early()?;
        (!self.0.told.swap(true, Ordering::AcqRel)).then_some(end)
    }

    /// How the recording ended, where it does not hold the whole run.
    pub fn ended_early(&self) -> Option<RecordingReport> {
        match self.0.end.get() {
            Some(RecordingState::Failed(reason)) => Some(RecordingReport::failed(reason)),
            Some(RecordingState::Stopped(reason)) => Some(RecordingReport::stopped(reason)),
            _ => None,
        }
    }
}

impl RecordingSwitch {
    /// A file is there.
    pub fn begin(&self) {
        self.0.begun.store(true, Ordering::Release);
    }

    /// So many bytes more are in it.
    pub fn wrote(&self, bytes: u64) {
        self.0.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Why it is to be stopped.
    pub fn wanted_stop(&self) -> Option<&str> {
        self.0.wanted_stop.get().map(String::as_str)
    }

    /// Something could not be recorded. Counts if nothing has ended the recording yet.
    pub fn fail(&self, reason: impl Into<String>) {
        self.0.end.set(RecordingState::Failed(reason.into())).ok();
    }

    /// The file is closed and whole. Counts if nothing has ended the recording yet.
    pub fn close(&self) {
        let end = self.wanted_stop().map_or(RecordingState::Whole, |reason| RecordingState::Stopped(reason.to_owned()));
        self.0.end.set(end).ok();
    }
}

/// Tells `sinks`, once, when a recording has ended before its run did.
pub fn tell_recording(recording: &RecordingSwitch, sinks: &mut dyn Sink, at: PlateTime) {
    if let Some(RecordingReport { code, text }) = recording.news() {
        let milestone = Milestone::RecordingEnded(code);
        sinks.milestone(&MilestoneFacts { at, level: EventLevel::Warning, milestone, text: &text });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_end_counts_and_is_told_once() {
        let switch = RecordingSwitch::default();
        assert_eq!((switch.state(), switch.news()), (RecordingState::Off, None));
        switch.begin();
        switch.wrote(7);
        assert_eq!((switch.clone().state(), switch.news()), (RecordingState::Writing { bytes: 7 }, None));
        switch.fail("no space");
        switch.stop("too late");
        switch.close();
        assert_eq!(switch.state(), RecordingState::Failed("no space".into()));
        assert_eq!(switch.clone().news().unwrap(), RecordingReport::failed("no space"));
        assert_eq!(switch.news(), None);
    }

    #[test]
    fn a_recording_is_whole_unless_it_was_stopped() {
        let whole = RecordingSwitch::default();
        whole.close();
        whole.stop("too late");
        assert_eq!((whole.state(), whole.news()), (RecordingState::Whole, None));
        let stopped = RecordingSwitch::default();
        stopped.stop("the disk is nearly full");
        stopped.stop("another reason");
        stopped.close();
        assert_eq!(stopped.state(), RecordingState::Stopped("the disk is nearly full".into()));
        assert_eq!(stopped.news().unwrap(), RecordingReport::stopped("the disk is nearly full"));
    }
}
