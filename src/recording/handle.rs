use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use super::report::RecordingReport;
use upm_control::{EventLevel, Milestone, MilestoneFacts, Sink};
use upm_core::time::PlateTime;

/// Progress or end of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RecordingState {
    /// There is no recording, or it has not begun.
    Off,
    /// The recording is being written.
    Writing {
        /// Bytes in the file so far.
        bytes: u64,
    },
    /// A part of the run could not be recorded, for this reason.
    Failed(String),
    /// The file is closed and holds the whole run.
    Whole,
}

/// Status of the recording of one run. Clones share one state. No call ever blocks.
#[derive(Clone, Debug, Default)]
pub struct RecordingHandle(Arc<RecordingCell>);

#[derive(Debug, Default)]
struct RecordingCell {
    begun: AtomicBool,
    bytes: AtomicU64,
    /// The first final state; later ones are ignored.
    end: OnceLock<RecordingState>,
    is_reported: AtomicBool,
}

impl RecordingHandle {
    /// The present state of the recording.
    pub fn state(&self) -> RecordingState {
        match self.0.end.get() {
            Some(end) => end.clone(),
            None if self.0.begun.load(Ordering::Acquire) => RecordingState::Writing { bytes: self.bytes() },
            None => RecordingState::Off,
        }
    }

    /// Bytes in the file so far.
    pub fn bytes(&self) -> u64 {
        self.0.bytes.load(Ordering::Relaxed)
    }

    /// Returns, once, the report of a recording that ended before its run.
    pub fn take_end(&self) -> Option<RecordingReport> {
        let end = self.ended_early()?;
        (!self.0.is_reported.swap(true, Ordering::AcqRel)).then_some(end)
    }

    /// The report of a recording that does not hold the whole run.
    pub fn ended_early(&self) -> Option<RecordingReport> {
        match self.0.end.get() {
            Some(RecordingState::Failed(reason)) => Some(RecordingReport::failed(reason)),
            _ => None,
        }
    }
}

impl RecordingHandle {
    /// The file has been created.
    pub fn begin(&self) {
        self.0.begun.store(true, Ordering::Release);
    }

    /// This many more bytes are in the file.
    pub fn add_bytes(&self, bytes: u64) {
        self.0.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Ends the recording as failed, unless it has already ended.
    pub fn fail(&self, reason: impl Into<String>) {
        self.0.end.set(RecordingState::Failed(reason.into())).ok();
    }

    /// Ends the recording as whole, its file closed, unless it has already ended.
    pub fn close(&self) {
        self.0.end.set(RecordingState::Whole).ok();
    }
}

/// Reports to `sinks`, once, that a recording has ended before its run.
pub fn report_recording_end(recording: &RecordingHandle, sinks: &mut dyn Sink, at: PlateTime) {
    if let Some(RecordingReport { code, text }) = recording.take_end() {
        let milestone = Milestone::RecordingEnded(code);
        sinks.milestone(&MilestoneFacts { at, level: EventLevel::Warning, milestone, text: &text });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_end_counts_and_is_reported_once() {
        let handle = RecordingHandle::default();
        assert_eq!((handle.state(), handle.take_end()), (RecordingState::Off, None));
        handle.begin();
        handle.add_bytes(7);
        assert_eq!((handle.clone().state(), handle.take_end()), (RecordingState::Writing { bytes: 7 }, None));
        handle.fail("no space");
        handle.close();
        assert_eq!(handle.state(), RecordingState::Failed("no space".into()));
        assert_eq!(handle.clone().take_end().unwrap(), RecordingReport::failed("no space"));
        assert_eq!(handle.take_end(), None);
    }
}
