use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use super::background_writer::SyncWrite;
use upm_core::files::{Length, reserve};

/// Room preallocated beyond the end, bytes: a journal of one part fills that in some minutes.
const AHEAD_BYTES: u64 = 1 << 20;

/// An append-only file with room preallocated beyond its end, so that another process filling the disk does not end a
/// run. Where the file system cannot preallocate, the file grows as usual. Unused room is released when it is dropped.
#[derive(Debug)]
pub struct PreallocatedFile {
    file: File,
    bytes: u64,
    /// Bytes preallocated, counted from the file's beginning.
    room_bytes: u64,
}

impl PreallocatedFile {
    /// Creates an empty file at `path`, replacing an existing one.
    ///
    /// # Errors
    /// The system's error when the file cannot be created. A lack of preallocated room is no error.
    pub fn create(path: &Path) -> io::Result<Self> {
        let mut made = Self { file: File::create(path)?, bytes: 0, room_bytes: 0 };
        made.preallocate();
        Ok(made)
    }

    fn preallocate(&mut self) {
        let wanted_bytes = self.bytes + AHEAD_BYTES;
        if self.room_bytes < self.bytes + AHEAD_BYTES / 2 && reserve(&self.file, wanted_bytes, Length::Kept).is_ok() {
            self.room_bytes = wanted_bytes;
        }
    }
}

impl Write for PreallocatedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.bytes += written as u64;
        self.preallocate();
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl SyncWrite for PreallocatedFile {
    fn commit(&mut self) -> io::Result<()> {
        self.file.sync_data()
    }
}

impl Drop for PreallocatedFile {
    fn drop(&mut self) {
        // truncates to the present length, which releases the room beyond it
        self.file.set_len(self.bytes).ok();
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::fs;
    use std::os::unix::fs::MetadataExt;

    use super::*;

    #[test]
    fn there_is_room_ahead_until_it_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.jsonl");
        let room_bytes = || fs::metadata(&path).unwrap().blocks() * 512;
        let mut file = PreallocatedFile::create(&path).unwrap();
        if reserve(&file.file, AHEAD_BYTES, Length::Kept).is_err() {
            return; // a file system without preallocation
        }
        assert!(room_bytes() >= AHEAD_BYTES);
        for _ in 0..30 {
            file.write_all(&[b'x'; 100_000]).unwrap();
            file.commit().unwrap();
            let bytes = fs::metadata(&path).unwrap().len();
            assert_eq!(bytes % 100_000, 0, "its length is what was written");
            assert!(room_bytes() >= bytes + AHEAD_BYTES / 2);
        }
        drop(file);
        assert_eq!(fs::read(&path).unwrap(), vec![b'x'; 3_000_000]);
        assert!(room_bytes() < 3_000_000 + AHEAD_BYTES / 4, "{}", room_bytes());
    }

    #[test]
    fn previous_content_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.jsonl");
        fs::write(&path, "something longer").unwrap();
        PreallocatedFile::create(&path).unwrap().write_all(b"short").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"short");
    }
}
