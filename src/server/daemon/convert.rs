use serde_json::{Map, Value};

use crate::api::{Job, LayoutPartView, LayoutPathView, LayoutView, Plate, Refusal};
use crate::states::PlateCondition;
use crate::store::{JobRow, StoreFault};
use crate::supervisor::{self, JobLayout, PlateSnapshot};
use upm_core::geometry::Vec2;
use upm_core::job::Bin;
use upm_core::units::{mm_from_m, places_mm};
use upm_recording::RecordingState;
use upm_runner::config::{BinEntry, Region};

/// A job in the API's form.
pub(super) fn job(row: &JobRow) -> Job {
    Job {
        id: row.id.to_string(),
        name: row.name.clone(),
        state: row.state,
        plate: row.plate.clone(),
        submitted_at: row.submitted_at.to_string(),
        started_at: row.started_at.map(|at| at.to_string()),
        finished_at: row.finished_at.map(|at| at.to_string()),
        progress: row.progress,
        report: row.report_json.as_deref().and_then(report),
        reason: row.reason.clone(),
        seed: row.seed,
        pace: row.pace,
        recording: row.recording,
        standing: row.standing,
        turn: row.turn,
    }
}

fn report(text: &str) -> Option<Map<String, Value>> {
    match serde_json::from_str(text) {
        Ok(Value::Object(members)) => Some(members),
        _ => None,
    }
}

/// A plate in the API's form, with the number of jobs `queued` for it.
pub(super) fn plate(snapshot: &PlateSnapshot, queued: u64) -> Plate {
    let observation = &snapshot.observation;
    Plate {
        name: snapshot.name.clone(),
        state: snapshot.state,
        why: snapshot.why.clone(),
        pause: snapshot.pause.as_ref().map(|pause| pause.cause.clone()),
        conditions: conditions(snapshot),
        job: snapshot.job.map(|id| id.to_string()),
        standing_job: snapshot.standing.clone(),
        queued,
        at_s: observation.at.secs(),
        age_s: snapshot.age.map(|age| age.as_secs_f64()),
        side_mm: mm_from_m(snapshot.side_m),
        kinds: snapshot.kinds.iter().map(part).collect(),
        positions_mm: places_mm(&observation.positions_m),
        radii_mm: observation.radii_m.iter().copied().map(mm_from_m).collect(),
        targets_mm: places_mm(&observation.targets_m),
        progress: observation.progress.clamp(0.0, 1.0),
        phase: observation.phase.clone(),
        deadline_misses: snapshot.deadline_misses,
        behind_s: snapshot.behind.as_secs_f64(),
        recording_mb: match snapshot.recording {
            Some(RecordingState::Writing { bytes }) => Some(bytes as f64 * 1e-6),
            _ => None,
        },
        live: snapshot.live.clone(),
    }
}

/// The conditions of the run on a plate; empty once the run has ended.
fn conditions(snapshot: &PlateSnapshot) -> Vec<PlateCondition> {
    if snapshot.job.is_none() {
        return Vec::new();
    }
    snapshot.observation.conditions.clone()
}

fn part(part: &supervisor::LayoutPart) -> LayoutPartView {
    LayoutPartView { kind: part.kind.clone(), radius_mm: mm_from_m(part.radius_m) }
}

/// A layout in the API's form, mm.
pub(super) fn layout(layout: &JobLayout) -> LayoutView {
    let corner_mm = |corner_m: Vec2| [corner_m.x, corner_m.y].map(mm_from_m);
    let bin = |bin: &Bin| BinEntry {
        kinds: bin.kinds.clone(),
        region_mm: Region { min: corner_mm(bin.min_m), max: corner_mm(bin.max_m) },
    };
    let path = |path: &supervisor::LayoutPath| LayoutPathView {
        waypoints_mm: places_mm(&path.waypoints_m),
        closed: path.closed,
    };
    LayoutView {
        parts: layout.parts.iter().map(part).collect(),
        targets_mm: places_mm(&layout.targets_m),
        bins: layout.bins.iter().map(bin).collect(),
        paths: layout.paths.iter().map(path).collect(),
        endless: layout.endless,
    }
}

/// The refusal of a read for a fault of the store. Reads need no space, so a full disk becomes [`Refusal::Busy`].
pub(super) fn unread(fault: StoreFault) -> Refusal {
    match fault {
        StoreFault::Full => Refusal::Busy { why: fault.to_string(), retry_after_s: 1 },
        fault => refusal(fault),
    }
}

/// The refusal of a request for a fault of the store.
pub(super) fn refusal(fault: StoreFault) -> Refusal {
    match fault {
        StoreFault::Full => Refusal::DiskFull(fault.to_string()),
        StoreFault::Closed => Refusal::Busy { why: fault.to_string(), retry_after_s: 1 },
        StoreFault::Io(_) | StoreFault::Corrupt(_) | StoreFault::Other { .. } => {
            tracing::error!("{fault}");
            Refusal::Broken("the job store cannot be read or written".to_owned())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_disk_is_reported_to_writers_only() {
        assert!(matches!(refusal(StoreFault::Full), Refusal::DiskFull(_)));
        assert!(matches!(unread(StoreFault::Full), Refusal::Busy { retry_after_s: 1, .. }));
        assert!(matches!(unread(StoreFault::Corrupt("a page".to_owned())), Refusal::Broken(_)));
    }
}
