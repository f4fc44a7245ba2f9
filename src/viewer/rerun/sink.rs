use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::file::RrdFile;
use super::live::{self, Live, MessageSink, parse_address, thread_fault};
use super::observation::Observation;
use super::recorder::{Message, Recorder};
use super::run_stream::LogResult;
use crate::types::{RecordingError, RunContext};
use upm_control::{CycleFacts, EventFacts, EventKind, FrameFacts, LocalisedFacts, PulseFacts, Sink};
use upm_core::background::{BackgroundThread, OverflowPolicy, Queue, QueueError, WaitError};
use upm_core::ground_truth::GroundTruthHandle;
use upm_core::time::PlateTime;
use upm_recording::{RecordingHandle, RecordingOptions, RecordingState, RerunMode};

/// Capacity of the queue to the recorder, messages; it also limits the number of frames held.
const QUEUE: usize = 64;

/// The same where the run waits for the recorder: a fraction of a second of plate time, so that a kill loses little.
const QUEUE_OF_WAITING: usize = 8;

/// Time for which [`OverflowPolicy::GiveUp`] waits at the end for a disk that lags.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(10);

/// Number of frames recorded per second of plate time.
const OBSERVATIONS_HZ: f64 = 15.0;

/// A sink that streams a run to Rerun. Dropping it closes the file as well, but only [`RerunSink::finish`] reports
/// faults.
pub struct RerunSink(Option<Running>);

struct Running {
    path: PathBuf,
    /// `None` once the recorder was abandoned.
    queue: Option<Queue<Message>>,
    overflow: OverflowPolicy,
    recorder: BackgroundThread<LogResult>,
    handle: RecordingHandle,
    live: Option<Live>,
    truth: Option<GroundTruthHandle>,
    /// Frames since the last one recorded, and the time of tracking them, µs.
    tracked: (u32, f64),
    recorded_at: Option<PlateTime>,
}

impl RerunSink {
    /// Refuses a mode with an invalid address, before anything is started.
    pub fn check(mode: &RerunMode) -> Result<(), RecordingError> {
        match mode {
            RerunMode::Connect { url: Some(url) } => parse_address(url.clone()).map(|_| ()),
            _ => Ok(()),
        }
    }

    /// Starts recording into `path`, and to the viewer of `mode`. With [`RerunMode::Off`] this sink does nothing.
    pub fn start(
        mode: &RerunMode,
        path: &Path,
        context: RunContext,
        recording_options: &RecordingOptions,
    ) -> Result<Self, RecordingError> {
        if *mode == RerunMode::Off {
            return Ok(Self(None));
        }
        let (file, viewer) = live::open(mode, path)?;
        Self::into_file(Box::new(file), path, viewer, context, recording_options)
    }

    /// Starts recording into `out`, the file at `path`, and to `viewer`.
    pub(super) fn into_file(
        out: Box<dyn Write + Send>,
        path: &Path,
        viewer: Option<(Live, MessageSink)>,
        context: RunContext,
        recording_options: &RecordingOptions,
    ) -> Result<Self, RecordingError> {
        let RecordingOptions { recording_overflow: overflow, clock, has_clock, .. } = *recording_options;
        let run_waits = overflow != OverflowPolicy::GiveUp;
        let (path, handle) = (path.to_owned(), recording_options.recording.clone());
        let (live, feed) = viewer.unzip();
        let file = RrdFile::new(out, feed, handle.clone()).map_err(|reason| not_whole(&path, &reason))?;
        let (queue, messages) = Queue::bounded(if run_waits { QUEUE_OF_WAITING } else { QUEUE }, overflow);
        let truth = context.truth.clone();
        let record = move || {
            let recorder = Recorder::start(file.clone(), context);
            let recorded = recorder.and_then(|recorder| recorder.run(&messages, clock, &file, run_waits));
            close(&file, recorded)
        };
        let recorder = BackgroundThread::start("recorder", has_clock, record).map_err(thread_fault)?;
        let queue = Some(queue);
        let (tracked, recorded_at) = ((0, 0.0), None);
        let running = Running { path, queue, overflow, recorder, handle, live, truth, tracked, recorded_at };
        Ok(Self(Some(running)))
    }

    /// Waits until everything is written and closes the file; true if a viewer was fed and took all of it. `Err` with
    /// the first fault of the whole run; a stop of the recording is not a fault.
    pub fn finish(mut self) -> Result<bool, RecordingError> {
        self.0.take().map_or(Ok(false), Running::close)
    }

    fn send(&mut self, message: impl FnOnce() -> Message) {
        if let Some(running) = &mut self.0 {
            running.send(message());
        }
    }
}

impl Drop for RerunSink {
    fn drop(&mut self) {
        if let Some(running) = self.0.take() {
            running.close().ok();
        }
    }
}

impl Running {
    fn close(mut self) -> Result<bool, RecordingError> {
        self.queue = None;
        let closed = self.recorder.wait_as(self.overflow, CLOSE_TIMEOUT).unwrap_or_else(|unfinished| {
            let reason = match unfinished {
                WaitError::Hangs => "the disk hangs",
                WaitError::Died => "the recorder's thread died",
            };
            self.handle.fail(reason);
            Err(reason.to_owned())
        });
        let viewer_has_all = self.live.is_some_and(Live::finish);
        let closed = match self.handle.state() {
            RecordingState::Failed(reason) => closed.and(Err(reason)),
            _ => closed,
        };
        closed.map(|()| viewer_has_all).map_err(|reason| not_whole(&self.path, &reason))
    }

    /// Sends a message; waits when the recorder lags, or abandons it. The fault of a dead recorder is reported by
    /// `close`.
    fn send(&mut self, message: Message) {
        let Some(queue) = &self.queue else { return };
        if let Err(QueueError::Full) = queue.send(message) {
            self.handle.fail("the recorder lags");
            self.queue = None;
        }
    }

    fn observe(&mut self, facts: &FrameFacts<'_>) {
        let at = facts.frame.exposed_at;
        self.tracked = (self.tracked.0 + 1, self.tracked.1 + facts.track_us);
        let is_due = self.recorded_at.is_none_or(|before| at.secs_since(before) >= 1.0 / OBSERVATIONS_HZ);
        if is_due || facts.starts_cycle {
            self.recorded_at = Some(at);
            let truth = self.truth.as_ref().map(GroundTruthHandle::read);
            let true_m =
                truth.iter().flat_map(|truth| &truth.parts).map(|part| part.part_in_table.position_m).collect();
            let (tracks, tracked) = (facts.tracks.to_vec(), std::mem::take(&mut self.tracked));
            let frame = facts.starts_cycle.then(|| facts.frame.clone());
            self.send(Message::Observation(Box::new(Observation { at, tracks, true_m, tracked, frame })));
        }
    }
}

impl Sink for RerunSink {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        let (at, table, found) = (facts.frame.exposed_at, facts.table.clone(), facts.detections.len());
        self.send(|| Message::Localised { at, table: Box::new(table), found });
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        if let Some(running) = &mut self.0 {
            running.observe(facts);
        }
    }

    fn pulse(&mut self, facts: &PulseFacts) {
        self.send(|| Message::Pulse(Box::new(facts.clone())));
    }

    fn cycle(&mut self, facts: &CycleFacts) {
        self.send(|| Message::Cycle(Box::new(facts.clone())));
    }

    fn event(&mut self, event: &EventFacts) {
        // the recorder itself logs the end of the recording
        if !matches!(event.kind, EventKind::RecordingEnded) {
            self.send(|| Message::Event(event.clone()));
        }
    }
}

/// Closes `file` in any case and disconnects its viewer. `Err` with the first fault of writing it or of `recorded`.
fn close(file: &RrdFile, recorded: LogResult) -> LogResult {
    if let Err(fault) = &recorded {
        file.handle().fail(fault.as_str());
    }
    file.close().and(recorded)
}

/// The fault of data that could not be encoded or written; the file ends before them.
fn not_whole(path: &Path, reason: &str) -> RecordingError {
    RecordingError(format!("recording {} is not whole: {reason}", path.display()))
}
