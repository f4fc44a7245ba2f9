use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};

use jiff::Timestamp;

use super::books::Books;
use super::{AuditEntry, JobId};

/// Most lines of the audit log that wait in memory.
const MOST_ACTS: usize = 1024;

/// Most jobs whose progress waits.
const MOST_JOBS: usize = 256;

/// What is written when there is time and room, and waits in memory until then: told by those who never wait.
#[derive(Debug, Default)]
pub(super) struct Pending(Mutex<Notes>);

#[derive(Debug, Default)]
pub(super) struct Notes {
    acts: VecDeque<(Timestamp, AuditEntry)>,
    paused: BTreeMap<String, bool>,
    progress: BTreeMap<JobId, f64>,
}

impl Pending {
    /// A line for the audit log; false when too many wait already.
    pub fn act(&self, at: Timestamp, entry: AuditEntry) -> bool {
        let acts = &mut self.notes().acts;
        let room = acts.len() < MOST_ACTS;
        if room {
            acts.push_back((at, entry));
        }
        room
    }

    /// A plate is paused or resumed.
    pub fn paused(&self, plate: &str, paused: bool) {
        self.notes().paused.insert(plate.to_owned(), paused);
    }

    /// A job has come this far; the last word counts.
    pub fn progress(&self, id: &JobId, progress: f64) {
        let waiting = &mut self.notes().progress;
        if waiting.len() < MOST_JOBS || waiting.contains_key(id) {
            waiting.insert(*id, progress);
        }
    }

    /// Lines of the audit log that wait.
    pub fn acts_waiting(&self) -> usize {
        self.notes().acts.len()
    }

    /// All that waits; progress alone only when `progress_too`.
    pub fn take(&self, progress_too: bool) -> Option<Notes> {
        let mut notes = self.notes();
        let urgent = !notes.acts.is_empty() || !notes.paused.is_empty();
        let due = urgent || (progress_too && !notes.progress.is_empty());
        due.then(|| std::mem::take(&mut *notes))
    }

    /// Notes that could not be written wait on, before those that came since.
    pub fn put_back(&self, notes: Notes) {
        let mut now = self.notes();
        let Notes { acts, paused, progress } = std::mem::replace(&mut *now, notes);
        now.acts.extend(acts);
        now.paused.extend(paused);
        now.progress.extend(progress);
    }

    fn notes(&self) -> MutexGuard<'_, Notes> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Notes {
    /// Writes them.
    pub fn write(&self, books: &Books<'_>) -> rusqlite::Result<()> {
        self.acts.iter().try_for_each(|(at, entry)| books.note_act(*at, entry))?;
        self.paused.iter().try_for_each(|(plate, paused)| books.set_paused(plate, *paused))?;
        self.progress.iter().try_for_each(|(id, progress)| books.progress(id, *progress))
    }
}
