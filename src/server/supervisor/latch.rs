//! The latch of an emergency stop: a stopped plate stays stopped, even over restarts and power cuts.
//!
//! Each plate has a small file that is rewritten in place, so it needs neither free disk space nor the job store. An
//! invalid file counts as stopped, and so does the missing file of a plate that the store knows. With one that cannot
//! be opened the daemon does not start.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use parking_lot::Mutex;

use upm_core::files::sync_folder;

const STOPPED: &[u8; 16] = b"upm: stopped    ";
const RELEASED: &[u8; 16] = b"upm: released   ";

/// One plate's latch: its state in memory, which changes without a lock, and the file with it.
#[derive(Debug)]
pub struct Latch {
    /// Number of stops, times two; odd while stopped.
    word: AtomicU64,
    /// The word whose state is on the disk.
    written: AtomicU64,
    file: Mutex<File>,
}

/// A stop that held when it was read. It can be released unless a newer stop was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopToken(u64);

impl Latch {
    /// Opens the latch file of `plate` in `folder`, or makes it. The missing file of a plate that is `known` counts as
    /// stopped, since its stop may have been lost with it; that of a new plate is created as released.
    pub fn open(folder: &Path, plate: &str, known: bool) -> io::Result<Self> {
        let path = folder.join(plate);
        let named = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
        let mut options = OpenOptions::new();
        options.read(true).write(true);
        let found = match options.open(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            opened => Some(opened.map_err(named)?),
        };
        if let Some(file) = found {
            let word = u64::from(!is_released(&file));
            return Ok(Self { word: AtomicU64::new(word), written: AtomicU64::new(word), file: Mutex::new(file) });
        }
        if known {
            let path = path.display();
            tracing::error!(
                plate,
                "{path}: expected the latch file of a known plate, found none: the plate is stopped"
            );
        }
        let file = Mutex::new(options.create_new(true).open(&path).map_err(named)?);
        let latch = Self { word: AtomicU64::new(known.into()), written: AtomicU64::new(u64::MAX), file };
        latch.write()?;
        // without this a power cut could remove the file's entry, and it would count as missing
        sync_folder(folder)?;
        Ok(latch)
    }

    /// Stops, in memory. True when it was not stopped before. Never waits.
    pub fn stop(&self) -> bool {
        let next = |word: u64| Some(word.wrapping_add(2) | 1);
        let before = self.word.fetch_update(Ordering::SeqCst, Ordering::SeqCst, next);
        before.is_ok_and(|word| word & 1 == 0)
    }

    /// The stop that holds, if one does.
    pub fn held(&self) -> Option<StopToken> {
        let word = self.word.load(Ordering::SeqCst);
        (word & 1 == 1).then_some(StopToken(word))
    }

    /// Releases that stop, in memory. False when it was released, or another stop was made, in between.
    pub fn release(&self, StopToken(word): StopToken) -> bool {
        self.word.compare_exchange(word, word & !1, Ordering::SeqCst, Ordering::SeqCst).is_ok()
    }

    /// True while it is stopped.
    pub fn is_stopped(&self) -> bool {
        self.held().is_some()
    }

    /// Writes the state to the disk and returns it. Waits for the disk. The state is read once the file is this
    /// thread's, so the last of several writers writes the last state.
    pub fn write(&self) -> io::Result<bool> {
        let mut file = self.file.lock();
        let word = self.word.load(Ordering::SeqCst);
        let text = if word & 1 == 1 { STOPPED } else { RELEASED };
        file.seek(SeekFrom::Start(0))?;
        file.write_all(text)?;
        file.set_len(text.len() as u64)?;
        file.sync_data()?;
        self.written.store(word, Ordering::SeqCst);
        Ok(word & 1 == 1)
    }

    /// True when the state, and the last stop, are on the disk.
    pub fn is_written(&self) -> bool {
        self.word.load(Ordering::SeqCst) == self.written.load(Ordering::SeqCst)
    }
}

fn is_released(file: &File) -> bool {
    let mut text = Vec::new();
    let whole = file.take(1024).read_to_end(&mut text).is_ok();
    whole && text == RELEASED
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn open(folder: &Path, known: bool) -> Latch {
        Latch::open(folder, "one", known).unwrap()
    }

    #[test]
    fn missing_file_means_stopped_for_a_known_plate_and_released_for_a_new_one() {
        let folder = tempfile::tempdir().unwrap();
        assert!(!open(folder.path(), false).is_stopped());
        assert!(!open(folder.path(), true).is_stopped(), "the file exists now");
        fs::remove_file(folder.path().join("one")).unwrap();
        assert!(open(folder.path(), true).is_stopped());
        assert!(open(folder.path(), false).is_stopped(), "over a restart, too");
        for invalid in [&b"upm: released"[..], b"upm: released    and more"] {
            fs::write(folder.path().join("one"), invalid).unwrap();
            let latch = open(folder.path(), false);
            assert!(latch.is_stopped(), "an invalid file");
            assert!(latch.release(latch.held().unwrap()) && !latch.is_written());
            assert!(!latch.write().unwrap() && latch.is_written() && !open(folder.path(), false).is_stopped());
        }
    }
}
