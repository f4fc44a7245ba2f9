//! The recording stream of a run with its two timelines.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::time::Duration;

use re_sdk_types::archetypes::Scalars;
use rerun::log::{ChunkBatcherConfig, TimeColumn};
use rerun::{AsComponents, EntityPath, RecordingStream, RecordingStreamBuilder, TimeCell};

use super::file::RrdFile;
use upm_core::time::PlateTime;

/// Name of the timeline of plate time.
pub(super) const PLATE_TIME: &str = "plate_time";
/// Name of the timeline of cycles.
const CYCLE: &str = "cycle";

/// Name of the application in the viewer.
pub(super) const APPLICATION: &str = "upm";

/// Time for which Rerun gathers chunks before they are written.
pub(super) const GATHER: Duration = Duration::from_millis(500);

/// Bytes that may wait inside Rerun for the disk. Each of its two queues gets half.
const MOST_WAITING_BYTES: u64 = 16 << 20;

/// A recording stream with the two timelines of a run, whose errors are texts.
pub(super) struct RunStream {
    stream: RecordingStream,
    /// Signals by path, sent with the next flush: a message costs far more than what it carries.
    signals: RefCell<BTreeMap<String, Signal>>,
}

/// Values of several series at many times.
#[derive(Default)]
struct Signal {
    times_ns: Vec<i64>,
    values: Vec<f64>,
}

/// Result of logging, with the error as text.
pub(super) type LogResult = Result<(), String>;

impl RunStream {
    /// Opens a recording called `name` into `file`, the layout first.
    pub(super) fn start(
        file: RrdFile,
        name: String,
        send_layout: impl FnOnce(&RecordingStream) -> LogResult,
    ) -> Result<Self, String> {
        let builder = RecordingStreamBuilder::new(APPLICATION).enabled(true);
        let (_, info, _, _, hooks, _) = builder.into_args();
        let batching = ChunkBatcherConfig {
            flush_tick: GATHER,
            max_bytes_in_flight: MOST_WAITING_BYTES,
            ..ChunkBatcherConfig::DEFAULT
        };
        let stream =
            RecordingStream::new(info, None, Some(batching), hooks, Box::new(file)).map_err(|e| e.to_string())?;
        stream.set_log_time_enabled(false);
        stream.set_log_tick_enabled(false);
        send_layout(&stream)?;
        stream.send_recording_name(name).map_err(|e| e.to_string())?;
        Ok(Self { stream, signals: RefCell::default() })
    }

    /// Waits until everything logged so far is in the file.
    pub(super) fn flush(&self) -> LogResult {
        self.send_signals()?;
        self.stream.flush_blocking().map_err(|e| e.to_string())
    }

    /// Starts the writing of everything logged so far, without waiting.
    pub(super) fn flush_async(&self) -> LogResult {
        self.send_signals()?;
        self.stream.flush_async().map_err(|e| e.to_string())
    }

    /// Sets the time of everything logged from now on.
    pub(super) fn at(&self, at: PlateTime, cycle: u64) {
        self.stream.set_time(PLATE_TIME, TimeCell::from_duration_nanos(nanos(at)));
        self.stream.set_time_sequence(CYCLE, i64::try_from(cycle).unwrap_or(i64::MAX));
    }

    pub(super) fn log(&self, path: &str, what: &impl AsComponents) -> LogResult {
        self.stream.log(path, what).map_err(|e| format!("{path}: {e}"))
    }

    /// Logs data that hold for the whole run.
    pub(super) fn log_static(&self, path: &str, what: &impl AsComponents) -> LogResult {
        self.stream.log_static(path, what).map_err(|e| format!("{path}: {e}"))
    }

    /// Logs an equal number of values at each of many times, on the timeline of plate time alone.
    pub(super) fn log_scalars(
        &self,
        path: &str,
        times_ns: impl IntoIterator<Item = i64>,
        values: impl IntoIterator<Item = f64>,
    ) {
        let mut signals = self.signals.borrow_mut();
        let signal = signals.entry(path.to_owned()).or_default();
        signal.times_ns.extend(times_ns);
        signal.values.extend(values);
    }

    fn send_signals(&self) -> LogResult {
        for (path, Signal { times_ns, values }) in self.signals.take() {
            let Some(series) = values.len().checked_div(times_ns.len()) else { continue };
            let rows = vec![series; times_ns.len()];
            let times = TimeColumn::new_duration_nanos(PLATE_TIME, times_ns);
            let sent = Scalars::new(values).columns(rows).map_err(|e| e.to_string()).and_then(|columns| {
                let path = EntityPath::from(path.as_str());
                self.stream.send_columns(path, [times], columns).map_err(|e| e.to_string())
            });
            sent.map_err(|e| format!("{path}: {e}"))?;
        }
        Ok(())
    }
}

/// Plate time on Rerun's timeline, ns.
pub(super) fn nanos(at: PlateTime) -> i64 {
    i64::try_from(at.nanos()).unwrap_or(i64::MAX)
}
