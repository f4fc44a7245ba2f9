use std::sync::Arc;

use axum::http::StatusCode;
use axum::http::header::RETRY_AFTER;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::jobs::Checked;
use super::state::{DaemonState, conflict, unheard};
use crate::http::Problem;
use crate::store::{Job, Pace, SubmitOutcome, low_disk};
use crate::supervisor::{DryRunError, DryRunState, PlateHandle};
use upm_core::files::free_bytes;
use upm_core::time::Clock;
use upm_runner::config::{Diagnostic, JobLayout, PlateSpec, RigFile};

/// `Retry-After` for a full queue, s. A guess, chosen to keep retries cheap.
const FULL_RETRY_S: u32 = 5;

impl DaemonState {
    /// Checks a job and queues it: it is on the disk when this returns. A repeated key gets the earlier job and true,
    /// whatever now prevents a new one. A job is not stored when its client no longer waits, since that may send it
    /// again. Takes milliseconds and waits for the disk.
    pub(super) fn submit(
        &self,
        text: &str,
        pace: Option<Pace>,
        key: Option<String>,
        is_awaited: &dyn Fn() -> bool,
    ) -> Result<(Job, bool), Problem> {
        // what a repeated key must match, without values derived from it: they may change with a restart
        let asked = format!("{}\n{text}", pace.map_or("none", Pace::code));
        let body_sha256: [u8; 32] = Sha256::digest(asked).into();
        if let Some(key) = &key
            && let Some(known) = self.store.repeated(key, &body_sha256)?
        {
            return submitted(known);
        }
        if self.ending.is_cancelled() {
            return Err(Problem::busy("the daemon ends", 1));
        }
        let plate = self.plate_of(text)?;
        let job = plate.rules.validated(text, pace.unwrap_or(self.spec.pace));
        let mut job = job.map_err(|faults| self.refused(text, faults))?;
        self.is_accepting(plate)?;
        (job.body_sha256, job.key) = (body_sha256, key);
        let accepted = self.store.accept(&job, is_awaited)?.ok_or_else(unheard)?;
        if matches!(accepted, SubmitOutcome::New(_)) {
            plate.job_queued();
        }
        submitted(accepted)
    }

    /// Checks a job as for queueing, regardless of the state of its plate. Takes milliseconds.
    pub(super) fn check(&self, text: &str) -> Result<Checked, Problem> {
        let plate = self.plate_of(text)?;
        let job = plate.rules.checked(text).map_err(|faults| self.refused(text, faults))?;
        Ok(Checked { name: job.name.clone(), plate: plate.name().to_owned(), layout: JobLayout::of(&job) })
    }

    /// Starts dry runs of a job, checked as for queueing, or tells how far they are. Takes milliseconds.
    pub(super) fn dry_run(&self, text: &str) -> Result<DryRunState, Problem> {
        let rules = &self.plate_of(text)?.rules;
        let job = rules.checked(text).map_err(|faults| self.refused(text, faults))?;
        let state = self.dry_runs.ask((text, job), &rules.library, self.clock.elapsed());
        state.map_err(|error| match error {
            DryRunError::Busy => Problem::busy("dry runs of another job go on", 2),
            DryRunError::Refused(fault) => Problem::of_document(vec![fault]),
            DryRunError::Failed => Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "internal error"),
        })
    }

    /// The plate that a job names. A job that names none goes to the default plate, or, when it brings a rig, to one
    /// with a rig of that name. Text that is not JSON goes to any plate, whose check then reports the faults.
    fn plate_of(&self, text: &str) -> Result<&Arc<PlateHandle>, Problem> {
        let Ok(job) = serde_json::from_str::<Value>(text.trim_start_matches('\u{feff}')) else {
            return self.plates.iter().next().ok_or_else(|| self.unaddressed("nothing"));
        };
        if let Some(name) = job.get("plate").and_then(Value::as_str) {
            return self.plates.get(name).ok_or_else(|| self.unaddressed(&format!("{name:?}")));
        }
        let default = self.spec.default_plate.as_deref();
        let rig = job.pointer("/rig/name").and_then(Value::as_str);
        let has_rig = |plate: &&PlateSpec| rig.is_none_or(|rig| plate.rig.model.name == rig);
        let of_rig = || self.spec.plates.iter().find(|plate| rig.is_some() && has_rig(plate));
        let fitting = default.and_then(|name| self.spec.plate(name)).filter(has_rig).or_else(of_rig);
        let name = fitting.map(|plate| plate.name.as_str()).or(default);
        name.and_then(|name| self.plates.get(name)).ok_or_else(|| self.unaddressed("nothing"))
    }

    /// The refusal of a job for these faults; that of a rig names the plate that has it.
    fn refused(&self, text: &str, mut faults: Vec<Diagnostic>) -> Problem {
        if let [Diagnostic { path, expected, .. }] = &mut faults[..]
            && *path == "rig"
            && let Ok(job) = serde_json::from_str::<Value>(text.trim_start_matches('\u{feff}'))
            && let Ok(rig) = serde_json::from_value::<RigFile>(job["rig"].clone())
            && let Some(other) = self.spec.plates.iter().find(|plate| plate.rig.is_as_in(&rig))
        {
            *expected += &format!(" (plate {} has that rig)", other.name);
        }
        Problem::of_document(faults)
    }

    fn unaddressed(&self, found: &str) -> Problem {
        let allowed = format!("one of {}", self.spec.plate_names().join(", "));
        let fault = Diagnostic::new("job", "plate", found.to_owned(), allowed);
        Problem::of_document(vec![fault])
    }

    /// The reason why `plate` takes no jobs.
    fn is_accepting(&self, plate: &PlateHandle) -> Result<(), Problem> {
        if plate.emergency_stop.holds() {
            let why = format!("plate {} is stopped by an emergency stop: it must be reset first", plate.name());
            return Err(conflict(why));
        }
        let low = low_disk(free_bytes(self.store.runs()).ok(), self.spec.min_free_bytes);
        low.map_or(Ok(()), |why| Err(Problem::new(StatusCode::INSUFFICIENT_STORAGE, why)))
    }
}

fn submitted(accepted: SubmitOutcome) -> Result<(Job, bool), Problem> {
    match accepted {
        SubmitOutcome::New(row) => Ok((row.job, false)),
        SubmitOutcome::Replayed(row) => Ok((row.job, true)),
        SubmitOutcome::KeyReused => {
            let why = "this Idempotency-Key was already used, with a different body or for a job since deleted";
            Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, why))
        }
        SubmitOutcome::QueueFull { queued } => {
            let problem = Problem::new(StatusCode::TOO_MANY_REQUESTS, format!("{queued} jobs wait for this plate"));
            Err(problem.with_header(RETRY_AFTER, FULL_RETRY_S.into()))
        }
    }
}
