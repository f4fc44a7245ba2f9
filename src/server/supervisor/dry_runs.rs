//! Dry runs of jobs that are not queued: one job at a time, on threads that step back behind those of the plates.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use parking_lot::Mutex;
use schemars::JsonSchema;
use serde::Serialize;

use upm_core::background::{BackgroundThread, WaitError};
use upm_planning::cor_library::Library;
use upm_runner::config::{Diagnostic, JobSpec};
use upm_runner::run::{Forecast, ForecastSummary, dry_run};

/// A client that has not asked for this long has left: its dry runs may be replaced.
const LEFT_AFTER: Duration = Duration::from_secs(5);

/// Dry runs of a job as far as they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct DryRunState {
    /// Share that is done, 0 to 1.
    pub progress: f64,
    /// Their forecast; null until all have ended.
    pub forecast: Option<ForecastSummary>,
}

/// The newest job of which dry runs were asked for.
#[derive(Debug, Default)]
pub(crate) struct DryRunSlot(Mutex<Option<Started>>);

#[derive(Debug)]
struct Started {
    text: String,
    asked_at: Duration,
    stop: Arc<AtomicBool>,
    progress: Arc<Mutex<f64>>,
    thread: BackgroundThread<Result<Forecast, Diagnostic>>,
    forecast: Option<ForecastSummary>,
}

/// Reason for which there is no answer about a dry run.
pub(crate) enum DryRunError {
    /// Those of another job go on, and its client still asks.
    Busy,
    /// The parts find no places.
    Refused(Diagnostic),
    /// Its thread could not start or died.
    Failed,
}

impl DryRunSlot {
    /// State of the dry runs of `job`, whose text is `text`; starts them unless they go on or have ended.
    pub fn ask(
        &self,
        (text, job): (&str, JobSpec),
        library: &Arc<Library>,
        now: Duration,
    ) -> Result<DryRunState, DryRunError> {
        let mut slot = self.0.lock();
        if let Some(other) = slot.take_if(|started| started.text != text) {
            if other.thread.wait_within(Duration::ZERO).err() == Some(WaitError::Hangs)
                && now.saturating_sub(other.asked_at) < LEFT_AFTER
            {
                *slot = Some(other);
                return Err(DryRunError::Busy);
            }
            other.stop.store(true, Ordering::Relaxed);
        }
        if slot.is_none() {
            *slot = Some(Started::new(text, job, Arc::clone(library)).map_err(|_| DryRunError::Failed)?);
        }
        let Some(started) = slot.as_mut() else { return Err(DryRunError::Failed) };
        started.asked_at = now;
        if started.forecast.is_none() {
            match started.thread.wait_within(Duration::ZERO) {
                Err(WaitError::Hangs) => {}
                Ok(Ok(forecast)) => started.forecast = Some((&forecast).into()),
                Ok(Err(fault)) => {
                    *slot = None;
                    return Err(DryRunError::Refused(fault));
                }
                Err(WaitError::Died) => {
                    *slot = None;
                    return Err(DryRunError::Failed);
                }
            }
        }
        let progress = if started.forecast.is_some() { 1.0 } else { *started.progress.lock() };
        Ok(DryRunState { progress, forecast: started.forecast.clone() })
    }
}

impl Started {
    fn new(text: &str, job: JobSpec, library: Arc<Library>) -> std::io::Result<Self> {
        let (stop, progress) = (Arc::<AtomicBool>::default(), Arc::<Mutex<f64>>::default());
        let (stopped, done) = (Arc::clone(&stop), Arc::clone(&progress));
        let run = move || dry_run(&job, &[], &library, &stopped, &mut |_, share| *done.lock() = share);
        let thread = BackgroundThread::start("dry-run", true, run)?;
        Ok(Self { text: text.to_owned(), asked_at: Duration::ZERO, stop, progress, thread, forecast: None })
    }
}
