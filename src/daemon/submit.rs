use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use serde::de::IgnoredAny;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::answers;
use super::desk::Office;
use crate::config::{Fault, PlateSpec, RawPace};
use crate::plates::Plate;
use crate::service::{Order, Pace, Refusal, Reply, Submitted};
use crate::store::{Accepted, JobPace, NewJob};
use crate::time::{Clock, MonotonicClock};

/// Longest time a job waits to be checked. Who asked is told to come again then, while it still listens.
const CHECKED_WITHIN: Duration = Duration::from_secs(2);

/// When a place in a full queue may be free: nobody knows; this keeps those who ask again from being a load.
const FULL_RETRY_S: u32 = 5;

/// A job as it was sent, and when.
pub(super) struct Asked {
    order: Order,
    at: Duration,
    clock: MonotonicClock,
}

impl Asked {
    pub fn now(order: Order, clock: MonotonicClock) -> Self {
        Self { order, at: clock.elapsed(), clock }
    }
}

/// Checks a job and queues it; the answer comes once it is on the disk. Takes milliseconds: not for those who answer.
pub(super) fn submit(office: &Arc<Office>, asked: Asked, reply: Reply<Submitted>) {
    let waited = asked.clock.elapsed().saturating_sub(asked.at);
    if waited > CHECKED_WITHIN || office.ending.load(Ordering::SeqCst) {
        let why = "too many jobs are being checked".to_owned();
        return reply.send(Err(Refusal::Busy { why, retry_after_s: 1 }));
    }
    let checked =
        office.plate_of(&asked.order.text).and_then(|plate| Ok((plate, office.checked(plate, &asked.order)?)));
    let (plate, job) = match checked {
        Ok(checked) => checked,
        Err(refusal) => return reply.send(Err(refusal)),
    };
    match office.hindrance(plate) {
        // what was accepted before is answered as it was then, whatever stands against it now
        Some(refusal) => office.store.repeated(job, move |known| match known {
            Ok(Some(answer)) => reply.send(submitted(answer)),
            Ok(None) => reply.send(Err(refusal)),
            Err(fault) => reply.send(Err(answers::refusal(fault))),
        }),
        None => {
            let office_then = Arc::clone(office);
            office.store.accept(job, move |accepted| {
                if let Ok(Accepted::New(row)) = &accepted
                    && let Some(plate) = office_then.plates.get(&row.plate)
                {
                    plate.wake();
                }
                reply.send(accepted.map_err(answers::refusal).and_then(submitted));
            });
        }
    }
}

fn submitted(accepted: Accepted) -> Result<Submitted, Refusal> {
    match accepted {
        Accepted::New(row) => Ok(Submitted { job: answers::job(&row), replayed: false }),
        Accepted::Replayed(row) => Ok(Submitted { job: answers::job(&row), replayed: true }),
        Accepted::KeyReused => Err(Refusal::KeyReused),
        Accepted::QueueFull { queued } => Err(Refusal::QueueFull { queued, retry_after_s: FULL_RETRY_S }),
    }
}

impl Office {
    /// The plate that a job asks for. One that asks for none goes to the default plate, or, when it brings a rig, to one
    /// with a rig of that name. What is no job goes to any plate: that will tell what is wrong with it.
    fn plate_of(&self, text: &str) -> Result<&Plate, Refusal> {
        let Ok(job) = serde_json::from_str::<Value>(text) else {
            return self.plates.iter().next().ok_or_else(|| self.unaddressed("nothing"));
        };
        if let Some(name) = job.get("plate").and_then(Value::as_str) {
            return self.plates.get(name).ok_or_else(|| self.unaddressed(&format!("{name:?}")));
        }
        let default = self.spec.default_plate.as_deref();
        let rig = job.get("rig").and_then(|rig| rig.get("name")).and_then(Value::as_str);
        let has_rig = |plate: &&PlateSpec| rig.is_none_or(|rig| plate.rig.model.name == rig);
        let of_rig = || self.spec.plates.iter().find(|plate| rig.is_some() && has_rig(plate));
        let fitting = default.and_then(|name| self.spec.plate(name)).filter(has_rig).or_else(of_rig);
        let name = fitting.map(|plate| plate.name.as_str()).or(default);
        name.and_then(|name| self.plates.get(name)).ok_or_else(|| self.unaddressed("nothing"))
    }

    fn unaddressed(&self, found: &str) -> Refusal {
        let allowed = format!("one of {}", self.spec.plate_names().join(", "));
        let (file, path) = ("job".to_owned(), "plate".to_owned());
        Refusal::Invalid(vec![Fault { file, path, found: found.to_owned(), allowed }])
    }

    fn checked(&self, plate: &Plate, order: &Order) -> Result<NewJob, Refusal> {
        let pace = match (order.pace, self.spec.pace) {
            (Some(Pace::RealTime), _) | (None, RawPace::RealTime) => JobPace::RealTime,
            (Some(Pace::Max), _) | (None, RawPace::Max) => JobPace::Max,
        };
        let job = plate.validate(&order.text, pace, order.key.clone()).map_err(|faults| {
            let is_json = serde_json::from_str::<IgnoredAny>(&order.text).is_ok();
            if is_json { Refusal::Invalid(faults) } else { Refusal::Malformed(faults) }
        })?;
        // the pace is no part of the body, and yet of what was asked for
        let body = Sha256::new().chain_update(pace.name()).chain_update("\n").chain_update(&order.text);
        Ok(NewJob { body_sha256: body.finalize().into(), ..job })
    }

    /// What keeps `plate` from taking any job.
    fn hindrance(&self, plate: &Plate) -> Option<Refusal> {
        if plate.is_stopped() {
            let why = format!("plate {} is stopped by an emergency stop: it must be reset first", plate.name());
            return Some(Refusal::Conflict(why));
        }
        let free = self.plates.free_bytes().filter(|free| *free < self.spec.reserve_bytes)?;
        Some(Refusal::DiskFull(format!(
            "{:.1} MB are free on the disk, {:.1} are needed (`disk.reserve_mb`)",
            free as f64 * 1e-6,
            self.spec.reserve_bytes as f64 * 1e-6
        )))
    }
}
