//! The daemon's metrics for Prometheus, as OpenMetrics text. Their names, types and units are a stable interface:
//! dashboards and alerts depend on them.

mod family;
#[cfg(test)]
mod tests;

use prometheus_client::registry::Unit;

use self::family::{MetricFamily, MetricSample, written};
use super::health::{liveness_failures, readiness_failures};
use super::status::{Observed, PlateObserved};
use crate::http::Reason;
use crate::supervisor::PlateState;
use upm_recording::RecordingState;

const PLATE_STATES: [PlateState; 4] = [PlateState::Idle, PlateState::Running, PlateState::Paused, PlateState::Stopped];

const RECORDING_STATES: [&str; 5] = ["off", "writing", "stopped", "failed", "whole"];

/// All metrics as OpenMetrics text.
pub(super) fn text(observed: &Observed) -> String {
    let families =
        [own(observed), of_plates(&observed.plates), of_jobs(observed), of_store(observed), of_http(observed)];
    written(families.into_iter().flatten().collect())
}

fn own(observed: &Observed) -> Vec<MetricFamily> {
    let build = vec![("version", observed.version.to_owned()), ("rerun", upm_viewer::BUILT_IN.to_string())];
    let is_well = |reasons: Vec<Reason>| f64::from(u8::from(reasons.is_empty()));
    vec![
        MetricFamily::info("build", "The program that runs", build),
        MetricFamily::gauge("uptime", "Time since the daemon started")
            .in_unit(Unit::Seconds)
            .with(observed.uptime.as_secs_f64()),
        MetricFamily::gauge("healthy", "1 when the daemon works, as /healthz says")
            .with(is_well(liveness_failures(observed))),
        MetricFamily::gauge("ready", "1 when the daemon takes jobs, as /readyz says")
            .with(is_well(readiness_failures(observed))),
    ]
}

fn of_plates(plates: &[PlateObserved]) -> Vec<MetricFamily> {
    let each = |family: MetricFamily, value: fn(&PlateObserved) -> Option<f64>| {
        family.with_all(plates.iter().filter_map(|plate| Some(MetricSample::of_plate(&plate.name, value(plate)?))))
    };
    let state = plates.iter().flat_map(|plate| {
        let is = |state: PlateState| (state.code(), state == plate.state);
        one_of(&plate.name, PLATE_STATES.map(is))
    });
    let recording = plates.iter().flat_map(|plate| {
        let now = recording_state(&plate.recording);
        one_of(&plate.name, RECORDING_STATES.map(|state| (state, state == now)))
    });
    vec![
        MetricFamily::gauge("plate_state", "State of the plate: 1 for the current state, 0 for the others")
            .with_all(state),
        each(MetricFamily::gauge("queue_jobs", "Jobs that wait for the plate"), |plate| Some(plate.queued as f64)),
        each(MetricFamily::counter("deadline_misses", "Frames that control came too late for"), |plate| {
            Some(plate.deadline_misses as f64)
        }),
        each(
            MetricFamily::gauge("behind", "How far plate time fell behind the clock in the present or last run")
                .in_unit(Unit::Seconds),
            |plate| Some(plate.behind.as_secs_f64()),
        ),
        each(MetricFamily::counter("estops", "Emergency stops"), |plate| Some(plate.estops as f64)),
        each(MetricFamily::gauge("frame_age", "Time since the newest camera frame").in_unit(Unit::Seconds), |plate| {
            plate.frame_age.map(|age| age.as_secs_f64())
        }),
        each(MetricFamily::gauge("job_progress", "Share of the running job that is done").in_unit(ratio()), |plate| {
            plate.progress
        }),
        MetricFamily::gauge(
            "recording_state",
            "State of the job's recording: 1 for the current state, 0 for the others",
        )
        .with_all(recording),
        each(MetricFamily::gauge("recording", "Size of the recording being written").in_unit(Unit::Bytes), |plate| {
            match plate.recording {
                RecordingState::Writing { bytes } => Some(bytes as f64),
                _ => None,
            }
        }),
    ]
}

fn of_jobs(observed: &Observed) -> Vec<MetricFamily> {
    let sample = |(plate, state, count): &(String, crate::store::JobState, u64)| {
        MetricSample::new(vec![("plate", plate.clone()), ("state", state.code().into())], *count as f64)
    };
    vec![MetricFamily::gauge("jobs", "Jobs the store knows").with_all(observed.jobs.iter().map(sample))]
}

fn of_store(observed: &Observed) -> Vec<MetricFamily> {
    let (store, disk) = (&observed.store, &observed.disk);
    let flag = |is: bool| f64::from(u8::from(is));
    vec![
        MetricFamily::gauge("store_heartbeat", "Time since the job store last showed that it lives")
            .in_unit(Unit::Seconds)
            .with(store.heartbeat.as_secs_f64()),
        MetricFamily::gauge("store_writable", "1 while the job store can be written").with(flag(store.fault.is_none())),
        MetricFamily::gauge("store_waiting", "Changes that wait to be written").with(store.waiting as f64),
        MetricFamily::gauge("store_audit_waiting", "Lines of the audit log that wait to be written")
            .with(store.audit_waiting as f64),
        MetricFamily::gauge("disk_free", "Room left on the disk of the data folder")
            .in_unit(Unit::Bytes)
            .with_all(store.free_bytes.map(|bytes| MetricSample::new(Vec::new(), bytes as f64))),
        MetricFamily::gauge("runs", "Room that run folders take up")
            .in_unit(Unit::Bytes)
            .with_all(disk.runs_bytes.map(|bytes| MetricSample::new(Vec::new(), bytes as f64))),
    ]
}

fn of_http(observed: &Observed) -> Vec<MetricFamily> {
    vec![MetricFamily::gauge("event_streams", "Event streams that are open").with(observed.event_streams as f64)]
}

/// One sample for each state: 1 for the current state, 0 for the others.
fn one_of<const N: usize>(plate: &str, states: [(&'static str, bool); N]) -> [MetricSample; N] {
    states.map(|(state, is)| {
        MetricSample::new(vec![("plate", plate.to_owned()), ("state", state.to_owned())], f64::from(u8::from(is)))
    })
}

fn recording_state(state: &RecordingState) -> &'static str {
    match state {
        RecordingState::Off => "off",
        RecordingState::Writing { .. } => "writing",
        RecordingState::Failed(_) => "failed",
        RecordingState::Whole => "whole",
    }
}

fn ratio() -> Unit {
    Unit::Other("ratio".to_owned())
}
