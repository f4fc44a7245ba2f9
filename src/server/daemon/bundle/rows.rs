use serde_json::{Value, json};

use super::redact::{REMOVED, scrub, scrubbed};
use crate::store::{AuditRow, JobId, JobRow, StoreSnapshot, StoredEvent};

/// The jobs, with the number of jobs of each plate in each state.
pub(super) fn jobs(snapshot: &StoreSnapshot) -> Value {
    let counts = snapshot
        .counts
        .iter()
        .map(|(plate, state, count)| json!({"plate": scrub(plate), "state": state.code(), "jobs": count}));
    let paused = snapshot.paused.iter().filter(|(_, paused)| *paused).map(|(plate, _)| scrub(plate));
    json!({
        "closed_in_order": snapshot.is_closed,
        "counts": counts.collect::<Vec<_>>(),
        "paused": paused.collect::<Vec<_>>(),
        "newest": snapshot.jobs.iter().map(job).collect::<Vec<_>>(),
    })
}

fn job(row: &JobRow) -> Value {
    json!({
        "id": row.id.to_string(),
        "name": scrub(&row.name),
        "plate": scrub(&row.plate),
        "state": row.state.code(),
        "seed": row.seed,
        "pace": row.pace.code(),
        "rig": row.rig_fingerprint,
        "library_sha256": row.library_sha256,
        "submitted_at": row.submitted_at.to_string(),
        "started_at": row.started_at.map(|at| at.to_string()),
        "finished_at": row.finished_at.map(|at| at.to_string()),
        "progress": row.progress,
        "reason": scrub(&row.reason),
        "folder": row.folder.as_deref().map(|folder| folder_name(folder, &[row.id])),
        "recording": row.recording.code(),
        "last_event": row.last_event,
    })
}

pub(super) fn event(job: &JobId, event: &StoredEvent) -> Value {
    let body = serde_json::from_str(&event.body).map_or(Value::from(REMOVED), scrubbed);
    json!({
        "job": job.to_string(),
        "seq": event.seq,
        "at": event.at.to_string(),
        "plate_s": event.plate_time.secs(),
        "kind": scrub(&event.kind),
        "body": body,
    })
}

/// The name of a run folder, scrubbed. It ends in the job's id, which looks random; it is kept where that id is one of
/// `known`.
pub(super) fn folder_name(name: &str, known: &[JobId]) -> String {
    let of_job = name.rsplit_once('-').filter(|(_, id)| known.iter().any(|known| known.to_string() == *id));
    of_job.map_or_else(|| scrub(name), |(name, id)| format!("{}-{id}", scrub(name)))
}

/// An entry of the audit log, scrubbed.
pub(super) fn act(row: &AuditRow) -> Value {
    let entry = &row.entry;
    json!({
        "id": row.id,
        "at": row.at.to_string(),
        "plate": entry.plate.as_deref().map(scrub),
        "act": scrub(&entry.act),
        "operator": scrub(&entry.operator),
        "reason": scrub(&entry.reason),
        "remote": scrub(&entry.remote),
        "token_name": scrub(&entry.token_name),
    })
}
