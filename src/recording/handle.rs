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
    /// It was stopped for this reason; the file is closed and complete up to that point.
    Stopped(String),
    /// A part of the run could not be recorded, for this reason.
    Failed(String),
    /// The file is closed and holds the whole run.
    Whole,
}

/// Status of the recording of one run, and the request to stop it while the run goes on. Clones share one state. No
/// call ever blocks.
#[derive(Clone, Debug, Default)]
pub struct RecordingHandle(Arc<RecordingCell>);

#[derive(Debug, Default)]
struct RecordingCell {
    begun: AtomicBool,
    bytes: AtomicU64,
    wanted_stop: OnceLock<String>,
    /// The first final state; later ones are ignored.
    end: OnceLock<RecordingState>,
    is_reported: AtomicBool,
}

impl RecordingHandle {
    /// Asks for the recording to be closed soon; the file remains complete up to that point. The first `reason` counts.
    pub fn stop(&self, reason: &str) {
        self.0.wanted_stop.set(reason.to_owned()).ok();
    }

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
            Some(RecordingState::Stopped(reason)) => Some(RecordingReport::stopped(reason)),
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

    /// Reason given with a request to stop the recording; `None` before one.
    pub fn stop_request(&self) -> Option<&str> {
        self.0.wanted_stop.get().map(String::as_str)
    }

    /// Ends the recording as failed, unless it has already ended.
    pub fn fail(&self, reason: impl Into<String>) {
        self.0.end.set(RecordingState::Failed(reason.into())).ok();
    }

    /// Ends the recording, its file closed: as whole, or as stopped if that was requested; unless it has already ended.
    pub fn close(&self) {
        let end =
            self.stop_request().map_or(RecordingState::Whole, |reason| RecordingState::Stopped(reason.to_owned()));
        self.0.end.set(end).ok();
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
        handle.stop("too late");
        handle.close();
        assert_eq!(handle.state(), RecordingState::Failed("no space".into()));
        assert_eq!(handle.clone().take_end().unwrap(), RecordingReport::failed("no space"));
        assert_eq!(handle.take_end(), None);
    }

    #[test]
    fn a_recording_is_whole_unless_it_was_stopped() {
        let whole = RecordingHandle::default();
        whole.close();
        whole.stop("too late");
        assert_eq!((whole.state(), whole.take_end()), (RecordingState::Whole, None));
        let stopped = RecordingHandle::default();
        stopped.stop("the disk is nearly full");
        stopped.stop("another reason");
        stopped.close();
        assert_eq!(stopped.state(), RecordingState::Stopped("the disk is nearly full".into()));
        assert_eq!(stopped.take_end().unwrap(), RecordingReport::stopped("the disk is nearly full"));
    }
}
