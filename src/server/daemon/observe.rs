use std::sync::atomic::Ordering;

use parking_lot::Mutex;

use super::desk::Office;
use super::observed::{DiskObserved, Observed, PlateObserved};
use crate::plates::{PlateSnapshot, PlateState};
use upm_core::time::Clock;
use upm_recording::RecordingState;

impl Office {
    /// The daemon as it is now. Waits for nobody: what the store must be asked for is as it was last told.
    pub fn observed(&self) -> Observed {
        let counted = self.counted().clone();
        let snapshots: Vec<PlateSnapshot> = self.plates.iter().map(|plate| plate.snapshot()).collect();
        let plates = snapshots.into_iter().map(|plate| {
            let queued = counted.queued.get(&plate.name).copied().unwrap_or(0);
            plate_observed(plate, queued)
        });
        Observed {
            version: self.version,
            uptime: self.clock.elapsed(),
            is_stopping: self.ending.load(Ordering::SeqCst),
            damage: self.unseen_damage(),
            displaced: self.data.displaced(),
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

    /// Damage found at start that nobody has taken note of yet, as a sentence.
    pub fn unseen_damage(&self) -> Option<String> {
        let states: Vec<PlateState> = self.plates.iter().map(|plate| plate.snapshot().state).collect();
        self.damage.unseen(&states)
    }
}

/// What the store had come to when it was opened, as a sentence, until somebody has taken note of it.
#[derive(Debug)]
pub(super) struct Damage(Mutex<Option<String>>);

impl Damage {
    pub fn found(sentence: Option<String>) -> Self {
        Self(Mutex::new(sentence))
    }

    /// What is not seen yet. After damage every plate is paused, or stopped: whoever lets the last paused one go on has seen
    /// what is wrong. Plates that are paused later are so for other reasons.
    fn unseen(&self, states: &[PlateState]) -> Option<String> {
        let mut damage = self.0.lock();
        let may_any_move = states.iter().any(|state| *state != PlateState::Stopped);
        if may_any_move && !states.contains(&PlateState::Paused) {
            *damage = None;
        }
        damage.clone()
    }
}

fn plate_observed(plate: PlateSnapshot, queued: u64) -> PlateObserved {
    let PlateSnapshot { name, state, job, sight, age, recording, deadline_misses, behind, estops, .. } = plate;
    PlateObserved {
        name,
        state,
        queued,
        deadline_misses,
        behind,
        estops,
        frame_age: age,
        progress: job.map(|_| sight.progress),
        recording: recording.unwrap_or(RecordingState::Off),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_that_was_seen_is_not_told_again() {
        use PlateState::{Idle, Paused, Stopped};
        let damage = Damage::found(Some("the job store was damaged".to_owned()));
        let states = [[Stopped, Stopped], [Paused, Stopped], [Idle, Paused], [Idle, Stopped], [Paused, Paused]];
        let told = states.map(|states| damage.unseen(&states).is_some());
        assert_eq!(told, [true, true, true, false, false]);
        assert_eq!(Damage::found(None).unseen(&[Paused]), None);
    }
}
