use std::sync::atomic::Ordering;

use super::desk::Office;
use super::observed::{DiskObserved, Observed, PlateObserved};
use crate::plates::{PlateSnapshot, PlateState};
use crate::recording::RecordingState;
use crate::time::Clock;

impl Office {
    /// The daemon as it is now. Waits for nobody: what the store must be asked for is as it was last told.
    pub fn observed(&self) -> Observed {
        let counted = self.counted().clone();
        let snapshots: Vec<PlateSnapshot> = self.plates.iter().map(|plate| plate.snapshot()).collect();
        // whoever lets a plate go on has seen what is wrong
        let unseen = snapshots.iter().any(|plate| plate.state == PlateState::Paused);
        let plates = snapshots.into_iter().map(|plate| {
            let queued = counted.queued.get(&plate.name).copied().unwrap_or(0);
            plate_observed(plate, queued)
        });
        Observed {
            version: self.version,
            uptime: self.clock.elapsed(),
            is_stopping: self.ending.load(Ordering::SeqCst),
            damage: self.damage.clone().filter(|_| unseen),
            plates_alive: self.plates.alive(),
            plates: plates.collect(),
            jobs: counted.jobs,
            store: self.store.health(),
            disk: DiskObserved {
                free_bytes: self.plates.free_bytes(),
                reserve_bytes: self.spec.reserve_bytes,
                runs_bytes: self.store.runs_bytes(),
            },
            requests: self.traffic.requests(),
            event_streams: self.traffic.event_streams(),
        }
    }
}

fn plate_observed(plate: PlateSnapshot, queued: u64) -> PlateObserved {
    let PlateSnapshot { name, state, job, sight, age, recording, deadline_misses, estops, .. } = plate;
    PlateObserved {
        name,
        state,
        queued,
        deadline_misses,
        estops,
        frame_age: age,
        progress: job.map(|_| sight.progress),
        recording: recording.unwrap_or(RecordingState::Off),
    }
}
