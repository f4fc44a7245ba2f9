use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use upm_control::{EventFacts, EventKind, EventLevel, Sink};
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
            None => match self.bytes() {
                0 => RecordingState::Off,
                bytes => RecordingState::Writing { bytes },
            },
        }
    }

    /// Bytes in the file so far.
    pub fn bytes(&self) -> u64 {
        self.0.bytes.load(Ordering::Relaxed)
    }

    /// Why the recording does not hold the whole run, if it has failed.
    pub fn ended_early(&self) -> Option<String> {
        match self.0.end.get() {
            Some(RecordingState::Failed(reason)) => Some(format!("the recording ends early: {reason}")),
            _ => None,
        }
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
    let Some(text) = recording.ended_early() else { return };
    if !recording.0.is_reported.swap(true, Ordering::AcqRel) {
        sinks.event(&EventFacts { at, level: EventLevel::Warning, text, kind: EventKind::RecordingEnded });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of events.
    struct EventCount(u32);

    impl Sink for EventCount {
        fn event(&mut self, _: &EventFacts) {
            self.0 += 1;
        }
    }

    #[test]
    fn first_end_counts_and_is_reported_once() {
        let (handle, mut events) = (RecordingHandle::default(), EventCount(0));
        assert_eq!((handle.state(), handle.ended_early()), (RecordingState::Off, None));
        handle.add_bytes(7);
        assert_eq!((handle.clone().state(), handle.ended_early()), (RecordingState::Writing { bytes: 7 }, None));
        report_recording_end(&handle, &mut events, PlateTime::ZERO);
        assert_eq!(events.0, 0);
        handle.fail("no space");
        handle.close();
        assert_eq!(handle.state(), RecordingState::Failed("no space".into()));
        assert_eq!(handle.ended_early(), Some("the recording ends early: no space".to_owned()));
        (0..2).for_each(|_| report_recording_end(&handle.clone(), &mut events, PlateTime::ZERO));
        assert_eq!(events.0, 1);
    }
}
