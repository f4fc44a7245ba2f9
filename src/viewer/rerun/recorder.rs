use std::time::Duration;

use re_sdk_types::components::TextLogLevel;

use super::blueprint;
use super::camera::CameraView;
use super::file::RrdFile;
use super::log_view::{LogView, log_line};
use super::observation::Observation;
use super::plots::Plots;
use super::run_stream::{LogResult, RunStream};
use super::signals;
use super::table::TableView;
use crate::types::RunContext;
use upm_control::{CycleFacts, EventFacts, PulseFacts};
use upm_core::background::{Receiver, RecvTimeoutError};
use upm_core::time::{Clock, MonotonicClock, PlateTime};
use upm_perception::vision::Table;

/// Interval at which logged data are flushed to the file. Rerun's batching alone fails beside large images: whenever
/// one series is sent because it is large, all others wait for another [`GATHER`](super::run_stream::GATHER), and so on
/// without end. With a run that waits for its recorder, the recorder waits for each flush, so that no data pile up on
/// the way; with any other run, Rerun holds the data that a hanging disk does not take.
const FLUSH: Duration = Duration::from_millis(200);

/// Time for which the recorder waits for a message before it checks the clock.
const LISTEN: Duration = Duration::from_millis(50);

/// A message from the control loop's thread.
pub(super) enum Message {
    Localised { at: PlateTime, table: Box<Table>, found: usize },
    Observation(Box<Observation>),
    Pulse(Box<PulseFacts>),
    Cycle(Box<CycleFacts>),
    Event(EventFacts),
}

/// The state of the thread that turns facts into log entries.
pub(super) struct Recorder {
    stream: RunStream,
    cycle: u64,
    camera: CameraView,
    table: TableView,
    drives: signals::Drives,
    plots: Plots,
    log_view: LogView,
    context: RunContext,
}

impl Recorder {
    /// Opens the stream into `file` and logs the static data.
    pub(super) fn start(file: RrdFile, context: RunContext) -> Result<Self, String> {
        let name = format!("{}, seed {}", context.name, context.seed);
        let stream = RunStream::start(file, name, |recording| blueprint::send(recording, &context))?;
        let camera = CameraView::start(&stream, &context)?;
        let table = TableView::start(&stream, &context)?;
        signals::start(&stream)?;
        let drives = signals::Drives::default();
        let plots = Plots::start(&stream, &context)?;
        let log_view = LogView::default();
        Ok(Self { stream, cycle: 0, camera, table, drives, plots, log_view, context })
    }

    /// Logs every message until the sender is gone. After a fault the remaining messages are discarded, so that the
    /// sender never blocks. `run_waits` when the recorder lags.
    pub(super) fn run(
        mut self,
        messages: &Receiver<Message>,
        clock: MonotonicClock,
        file: &RrdFile,
        run_waits: bool,
    ) -> LogResult {
        let mut recorded = Ok(());
        let mut sent_on_at = clock.elapsed();
        loop {
            match messages.recv_timeout(LISTEN) {
                Ok(message) if recorded.is_ok() => {
                    let fail = |fault: &String| file.handle().fail(fault.as_str());
                    recorded = self.record(message).inspect_err(fail);
                }
                Ok(_) | Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            let now = clock.elapsed();
            if now.saturating_sub(sent_on_at) >= FLUSH {
                sent_on_at = now;
                let send = if run_waits { RunStream::flush } else { RunStream::flush_async };
                recorded = recorded.and_then(|()| send(&self.stream));
            }
        }
        if let Some(text) = file.handle().ended_early() {
            recorded = recorded.and_then(|()| log_line(&self.stream, TextLogLevel::WARN, text));
        }
        self.drives.end(&self.stream);
        let flushed = self.stream.flush();
        recorded.and(flushed)
    }

    fn record(&mut self, message: Message) -> LogResult {
        match message {
            Message::Localised { at, table, found } => {
                self.stream.at(at, self.cycle);
                self.log_view.localised(&self.stream, &table, found, &self.context)?;
                self.camera.localised(&self.stream, *table, &self.context)
            }
            Message::Observation(seen) => {
                self.stream.at(seen.at, self.cycle);
                self.camera.observed(&self.stream, &seen)?;
                self.table.observed(&self.stream, &seen)?;
                self.plots.observed(&self.stream, &seen)
            }
            Message::Pulse(pulse) => {
                self.table.pulse(&self.stream, &pulse)?;
                signals::pulse(&self.stream, &pulse, &mut self.drives);
                Ok(())
            }
            Message::Cycle(cycle) => {
                self.stream.at(cycle.observed_at, cycle.index);
                self.camera.wanted(&self.stream, &cycle)?;
                self.table.cycle(&self.stream, &cycle, &self.context)?;
                self.plots.planned(&self.stream, &cycle)?;
                self.log_view.planned(&self.stream, &cycle)?;
                self.stream.at(cycle.ended_at, cycle.index);
                self.plots.ended(&self.stream, &cycle)?;
                self.cycle = cycle.index + 1;
                Ok(())
            }
            Message::Event(event) => {
                self.stream.at(event.at, self.cycle);
                self.log_view.event(&self.stream, &event)
            }
        }
    }
}
