use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use super::handle::RecordingHandle;
use upm_core::background::OverflowPolicy;
use upm_core::time::MonotonicClock;

/// How the records of a run are written to the disk. It has no effect on the run itself.
#[derive(Clone, Debug)]
pub struct RecordingOptions {
    /// Overflow policy of the journal when the disk lags. After giving up, the journal fails with
    /// [`io::ErrorKind::WouldBlock`].
    pub journal_overflow: OverflowPolicy,
    /// Status of the journal. One for each run.
    pub journal: WriterStatus,
    /// Overflow policy of the recording when it lags. After giving up, the recording ends as failed and the run goes
    /// on.
    pub recording_overflow: OverflowPolicy,
    /// Status of the recording, and the handle that stops it. One for each run.
    pub recording: RecordingHandle,
    /// True for real-time runs: the writer threads then run at lower priority. In other runs a lower priority would
    /// only make them lag.
    pub has_clock: bool,
    /// Clock by which the writer threads time their batches.
    pub clock: MonotonicClock,
}

impl RecordingOptions {
    /// Settings with which the run waits for the disk, so that nothing is lost.
    pub fn lossless(clock: MonotonicClock) -> Self {
        Self {
            journal_overflow: OverflowPolicy::Wait,
            journal: WriterStatus::default(),
            recording_overflow: OverflowPolicy::Wait,
            recording: RecordingHandle::default(),
            has_clock: false,
            clock,
        }
    }
}

/// Status of a [`BackgroundWriter`](super::background_writer::BackgroundWriter); reading it never blocks. Clones share
/// one status.
#[derive(Clone, Debug, Default)]
pub struct WriterStatus(Arc<WriterCell>);

#[derive(Debug, Default)]
struct WriterCell {
    /// Time since which the disk has not answered, ms of the writer's clock, at least 1; 0 while there is no pending
    /// request.
    waits_since_ms: AtomicU64,
    bytes: AtomicU64,
    fault: OnceLock<(io::ErrorKind, String)>,
}

impl WriterStatus {
    /// Time since which the writer has been waiting for the disk, by its clock.
    pub fn waits_since(&self) -> Option<Duration> {
        let since_ms = self.0.waits_since_ms.load(Ordering::Relaxed);
        (since_ms != 0).then(|| Duration::from_millis(since_ms))
    }

    /// The fault after which nothing more is written.
    pub fn fault(&self) -> Option<&str> {
        self.0.fault.get().map(|(_, text)| text.as_str())
    }

    /// The same as an error.
    pub(super) fn error(&self) -> Option<io::Error> {
        self.0.fault.get().map(|(kind, text)| io::Error::new(*kind, text.as_str()))
    }

    /// Bytes in the file so far.
    pub fn bytes(&self) -> u64 {
        self.0.bytes.load(Ordering::Relaxed)
    }

    /// This many more bytes are in the file.
    pub fn add_bytes(&self, bytes: u64) {
        self.0.bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// The writer starts to wait for the disk.
    pub(super) fn wait(&self, now: Duration) {
        let now_ms = u64::try_from(now.as_millis()).unwrap_or(u64::MAX);
        self.0.waits_since_ms.store(now_ms.max(1), Ordering::Relaxed);
    }

    /// The disk has answered; the writer goes on.
    pub(super) fn go_on(&self) {
        self.0.waits_since_ms.store(0, Ordering::Relaxed);
    }

    /// Writing has ended with `fault`. The first fault counts.
    pub(super) fn fail(&self, fault: &io::Error) {
        self.0.fault.set((fault.kind(), fault.to_string())).ok();
    }
}
