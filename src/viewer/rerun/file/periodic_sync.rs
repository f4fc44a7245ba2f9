use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use upm_core::thread_priority::lower_thread_priority;
use upm_recording::RecordingHandle;

/// Time from the end of one sync to the next.
const EVERY: Duration = Duration::from_secs(1);

/// A thread that syncs a file to the disk while others write it without waiting for that. It ends when this is dropped,
/// without being waited for.
pub(super) struct PeriodicSync {
    _alive: SyncSender<()>,
}

impl PeriodicSync {
    /// Calls `sync` about once a second while the recording of `handle` grows. When `sync` fails, the recording ends as
    /// failed.
    pub(super) fn start(
        sync: impl FnMut() -> io::Result<()> + Send + 'static,
        handle: RecordingHandle,
    ) -> io::Result<Self> {
        let (alive, ended) = sync_channel(1);
        thread::Builder::new().name("recording-sync".into()).spawn(move || {
            lower_thread_priority();
            run(sync, &ended, EVERY, &handle);
        })?;
        Ok(Self { _alive: alive })
    }
}

/// Syncs new data `every` so often, until `ended` is disconnected.
fn run(mut sync: impl FnMut() -> io::Result<()>, ended: &Receiver<()>, every: Duration, handle: &RecordingHandle) {
    let mut synced_bytes = 0;
    while ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
        let bytes = handle.bytes();
        if bytes == synced_bytes {
            continue;
        }
        synced_bytes = bytes;
        if let Err(fault) = sync() {
            // the disk reports it once: a later sync would succeed
            let reason = format!("it cannot be written to the disk: {fault}");
            handle.fail(reason.as_str());
            handle.stop(&reason);
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_recording::RecordingState;

    const OFTEN: Duration = Duration::from_millis(1);

    #[test]
    fn new_bytes_are_synced_once_until_the_end() {
        let (handle, (alive, ended)) = (RecordingHandle::default(), sync_channel(1));
        let (synced, syncs) = sync_channel(1);
        let growing = handle.clone();
        let thread = thread::spawn(move || run(|| synced.send(()).map_err(io::Error::other), &ended, OFTEN, &handle));
        assert!(syncs.recv_timeout(20 * OFTEN).is_err(), "there is nothing yet");
        for _ in 0..3 {
            growing.add_bytes(7);
            syncs.recv().unwrap();
        }
        assert!(syncs.recv_timeout(20 * OFTEN).is_err(), "nothing was added");
        drop(alive);
        thread.join().unwrap();
    }

    #[test]
    fn a_disk_that_does_not_take_it_ends_the_recording() {
        let (handle, (_alive, ended)) = (RecordingHandle::default(), sync_channel(1));
        handle.add_bytes(7);
        run(|| Err(io::Error::other("it is broken")), &ended, OFTEN, &handle);
        let reason = "it cannot be written to the disk: it is broken";
        assert_eq!((handle.state(), handle.stop_request()), (RecordingState::Failed(reason.into()), Some(reason)));
    }
}
