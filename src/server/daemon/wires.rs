use std::fmt;

use parking_lot::{Mutex, MutexGuard};

use crate::plates::{Tap, Told};
use crate::service::{Event, Feed};
use crate::store::JobId;

/// Leads what one plate tells to the clients that watch its jobs: written out once, however many they are.
#[derive(Default)]
pub(super) struct Wire(Mutex<Vec<(JobId, Feed)>>);

impl fmt::Debug for Wire {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Wire").field(&self.feeds().len()).finish()
    }
}

impl Wire {
    /// From now on `feed` is offered what is told of `job`, until its client is gone.
    pub fn lead(&self, job: JobId, feed: Feed) {
        let mut feeds = self.feeds();
        feeds.retain(|(_, feed)| !feed.is_closed());
        feeds.push((job, feed));
    }

    fn feeds(&self) -> MutexGuard<'_, Vec<(JobId, Feed)>> {
        self.0.lock()
    }
}

impl Tap for Wire {
    fn offer(&self, told: &Told) {
        let mut feeds = self.feeds();
        if !feeds.iter().any(|(job, _)| *job == told.job) {
            return;
        }
        let event = Event::new(told.seq, told.kind, &told.body);
        feeds.retain(|(job, feed)| *job != told.job || feed.offer(&event));
    }
}
