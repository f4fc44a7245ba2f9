//! The daemon's metrics for Prometheus, as OpenMetrics text, made anew at each scrape. Their names, types and units are
//! a stable interface: dashboards and alerts depend on them.

#[cfg(test)]
mod tests;

use std::sync::atomic::AtomicU64;

use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::{ConstGauge, Gauge};
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::{Metric, Registry, Unit};

use super::health::{Observed, liveness_failures, readiness_failures};
use crate::supervisor::{Plate, PlateState};
use upm_recording::RecordingState;

type Labels = Vec<(&'static str, String)>;

/// The registry of one scrape.
struct Scrape(Registry);

impl Scrape {
    /// Adds a value that rises and falls, one sample for each set of labels.
    fn gauge(&mut self, name: &str, help: &str, unit: Option<Unit>, samples: impl IntoIterator<Item = (Labels, f64)>) {
        let family = Family::<Labels, Gauge<f64, AtomicU64>>::default();
        for (labels, value) in samples {
            family.get_or_create(&labels).set(value);
        }
        self.add(name, help, unit, family);
    }

    /// Adds a value that rises and falls and has no labels.
    fn value(&mut self, name: &str, help: &str, unit: Option<Unit>, value: f64) {
        self.add(name, help, unit, ConstGauge::new(value));
    }

    fn add(&mut self, name: &str, help: &str, unit: Option<Unit>, metric: impl Metric) {
        match unit {
            Some(unit) => self.0.register_with_unit(name, help, unit, metric),
            None => self.0.register(name, help, metric),
        }
    }

    /// Adds a value that only rises until the daemon restarts, one sample for each plate.
    fn counter(&mut self, name: &str, help: &str, plates: &[Plate], value: fn(&Plate) -> u64) {
        let family = Family::<Labels, Counter>::default();
        for plate in plates {
            family.get_or_create(&of_plate(plate)).inc_by(value(plate));
        }
        self.add(name, help, None, family);
    }
}

/// All metrics as OpenMetrics text.
pub(super) fn text(observed: &Observed) -> String {
    let mut scrape = Scrape(Registry::with_prefix("upm"));
    of_daemon(&mut scrape, observed);
    of_plates(&mut scrape, &observed.plates);
    of_store(&mut scrape, observed);
    let mut text = String::new();
    // writing to a string never fails
    encode(&mut text, &scrape.0).unwrap_or_default();
    text
}

fn of_daemon(scrape: &mut Scrape, observed: &Observed) {
    let build = vec![("version", observed.version.to_owned()), ("rerun", upm_viewer::BUILT_IN.to_string())];
    scrape.add("build", "The program that runs", None, Info::new(build));
    scrape.value("uptime", "Time since the daemon started", Some(Unit::Seconds), observed.uptime.as_secs_f64());
    let is_healthy = f64::from(liveness_failures(observed).is_empty());
    scrape.value("healthy", "1 when the daemon works, as /healthz says", None, is_healthy);
    let is_ready = f64::from(readiness_failures(observed).is_empty());
    scrape.value("ready", "1 when the daemon takes jobs, as /readyz says", None, is_ready);
    scrape.value("event_streams", "Event streams that are open", None, observed.event_streams as f64);
}

fn of_plates(scrape: &mut Scrape, plates: &[Plate]) {
    let each = |value: fn(&Plate) -> Option<f64>| {
        plates.iter().filter_map(move |plate| Some((of_plate(plate), value(plate)?)))
    };
    let state = plates
        .iter()
        .flat_map(|plate| one_of(plate, PlateState::ALL.map(|state| (state.code(), state == plate.state))));
    scrape.gauge("plate_state", "State of the plate: 1 for the current state, 0 for the others", None, state);
    scrape.gauge("queue_jobs", "Jobs that wait for the plate", None, each(|plate| Some(plate.queued as f64)));
    let misses = |plate: &Plate| plate.deadline_misses;
    scrape.counter("deadline_misses", "Frames that control came too late for", plates, misses);
    let behind = "How far plate time fell behind the clock in the present or last run";
    scrape.gauge("behind", behind, Some(Unit::Seconds), each(|plate| Some(plate.behind_s)));
    scrape.counter("estops", "Emergency stops", plates, |plate| plate.estops);
    scrape.gauge("frame_age", "Time since the newest camera frame", Some(Unit::Seconds), each(|plate| plate.age_s));
    let ratio = Some(Unit::Other("ratio".to_owned()));
    let progress = each(|plate| plate.job.as_ref().map(|_| plate.observation.progress));
    scrape.gauge("job_progress", "Share of the running job that is done", ratio, progress);
    let recording = plates.iter().flat_map(|plate| {
        let now = match plate.recording {
            None | Some(RecordingState::Off) => "off",
            Some(RecordingState::Writing { .. }) => "writing",
            Some(RecordingState::Failed(_)) => "failed",
            Some(RecordingState::Whole) => "whole",
        };
        one_of(plate, ["off", "writing", "failed", "whole"].map(|state| (state, state == now)))
    });
    let help = "State of the job's recording: 1 for the current state, 0 for the others";
    scrape.gauge("recording_state", help, None, recording);
    let bytes = each(|plate| match plate.recording {
        Some(RecordingState::Writing { bytes }) => Some(bytes as f64),
        _ => None,
    });
    scrape.gauge("recording", "Size of the recording being written", Some(Unit::Bytes), bytes);
}

fn of_store(scrape: &mut Scrape, observed: &Observed) {
    let jobs = observed.counted.jobs.iter().map(|(plate, state, count)| {
        (vec![("plate", plate.clone()), ("state", state.code().to_owned())], *count as f64)
    });
    scrape.gauge("jobs", "Jobs the store knows", None, jobs);
    let silence_s = observed.store_silence.as_secs_f64();
    scrape.value("store_heartbeat", "Time since the job store last answered", Some(Unit::Seconds), silence_s);
    let is_writable = f64::from(observed.store_fault.is_none());
    scrape.value("store_writable", "1 while the job store can be written", None, is_writable);
    if let Some(bytes) = observed.counted.free_bytes {
        scrape.value("disk_free", "Room left on the disk of the data folder", Some(Unit::Bytes), bytes as f64);
    }
    let runs = observed.runs_bytes as f64;
    scrape.value("runs", "Room that run folders of ended jobs take up", Some(Unit::Bytes), runs);
}

fn of_plate(plate: &Plate) -> Labels {
    vec![("plate", plate.name.clone())]
}

/// One sample for each state: 1 for the current state, 0 for the others.
fn one_of<const N: usize>(plate: &Plate, states: [(&'static str, bool); N]) -> [(Labels, f64); N] {
    states.map(|(state, is)| (vec![("plate", plate.name.clone()), ("state", state.to_owned())], f64::from(is)))
}
