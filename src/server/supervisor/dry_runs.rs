//! Dry runs of jobs that are not queued: one job at a time, on threads that step back behind those of the plates.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use parking_lot::Mutex;
use schemars::JsonSchema;
use serde::Serialize;

use upm_core::thread_priority::lower_thread_priority;
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
    /// How far they are, or the fault that ended them.
    state: Arc<Mutex<Result<DryRunState, Diagnostic>>>,
    thread: JoinHandle<()>,
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
        let mut started = match slot.take() {
            Some(started) if started.text == text => started,
            Some(other) if !other.thread.is_finished() && now.saturating_sub(other.asked_at) < LEFT_AFTER => {
                *slot = Some(other);
                return Err(DryRunError::Busy);
            }
            other => {
                other.iter().for_each(|other| other.stop.store(true, Ordering::Relaxed));
                Started::new(text, job, Arc::clone(library)).map_err(|_| DryRunError::Failed)?
            }
        };
        started.asked_at = now;
        // before the state is read: a thread that has ended without a forecast has died
        let has_ended = started.thread.is_finished();
        let state = started.state.lock().clone().map_err(DryRunError::Refused)?;
        if has_ended && state.forecast.is_none() {
            return Err(DryRunError::Failed);
        }
        *slot = Some(started);
        Ok(state)
    }
}

impl Started {
    fn new(text: &str, job: JobSpec, library: Arc<Library>) -> std::io::Result<Self> {
        let (stop, state) = (Arc::<AtomicBool>::default(), Arc::new(Mutex::new(Ok(DryRunState::default()))));
        let (stopped, shown) = (Arc::clone(&stop), Arc::clone(&state));
        let run = move || {
            lower_thread_priority();
            let mut go_on = |_, progress| *shown.lock() = Ok(DryRunState { progress, forecast: None });
            let forecast = dry_run(&job, &[], &library, &stopped, &mut go_on);
            let ended = |forecast: Forecast| DryRunState { progress: 1.0, forecast: Some((&forecast).into()) };
            *shown.lock() = forecast.map(ended);
        };
        let thread = thread::Builder::new().name("dry-run".into()).spawn(run)?;
        Ok(Self { text: text.to_owned(), asked_at: Duration::ZERO, stop, state, thread })
    }
}
