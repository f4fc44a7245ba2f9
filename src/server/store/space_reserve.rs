use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use upm_core::files::{self, Length, free_bytes};

/// Time between two attempts to acquire a released reserve again.
const TRY_EVERY: Duration = Duration::from_secs(2);

/// A preallocated file, deleted when the disk is full so that vital writes still succeed.
#[derive(Debug)]
pub(super) struct SpaceReserve {
    path: PathBuf,
    bytes: u64,
    held: bool,
    tried_at: Duration,
}

impl SpaceReserve {
    /// The reserve at `path`, allocated if there is space for it.
    pub fn at(path: &Path, bytes: u64) -> Self {
        let mut reserve = Self { path: path.to_owned(), bytes, held: false, tried_at: Duration::ZERO };
        reserve.acquire();
        reserve
    }

    /// True while the file can be released; always for a reserve of 0 bytes.
    pub fn is_held(&self) -> bool {
        self.held
    }

    /// Deletes the file; false when that frees nothing.
    pub fn release(&mut self) -> bool {
        let released = self.held && self.bytes > 0 && fs::remove_file(&self.path).is_ok();
        self.held &= !released;
        released
    }

    /// Acquires a released reserve again, if there is space and [`TRY_EVERY`] has passed.
    pub fn retry(&mut self, now: Duration) {
        if !self.held && now.saturating_sub(self.tried_at) >= TRY_EVERY {
            self.tried_at = now;
            self.acquire();
        }
    }

    fn acquire(&mut self) {
        let there = fs::metadata(&self.path).is_ok_and(|file| file.len() == self.bytes);
        self.held = self.bytes == 0 || there || self.has_room() && self.fill().is_ok();
        if !self.held {
            // a part of the file would free too little
            let _ = fs::remove_file(&self.path);
        }
    }

    /// True when the disk has twice the reserve's size free.
    fn has_room(&self) -> bool {
        let folder = self.path.parent().unwrap_or(&self.path);
        free_bytes(folder).is_ok_and(|free| free >= 2 * self.bytes)
    }

    /// Allocates the blocks. Zeros are written only on file systems that cannot allocate at once, because the writer
    /// waits for this.
    fn fill(&self) -> io::Result<()> {
        let mut file = File::create(&self.path)?;
        match files::reserve(&file, self.bytes, Length::Extended) {
            Err(error) if error.kind() == io::ErrorKind::Unsupported => write_out(&mut file, self.bytes)?,
            done => done?,
        }
        file.sync_all()
    }
}

/// Writes `bytes` zeros.
fn write_out(file: &mut File, bytes: u64) -> io::Result<()> {
    let block = [0; 64 << 10];
    let mut left = bytes;
    while left > 0 {
        let part = left.min(block.len() as u64);
        file.write_all(block.get(..part as usize).unwrap_or(&block))?;
        left -= part;
    }
    Ok(())
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::os::unix::fs::MetadataExt;

    use rustix::fs::{SeekFrom, seek};
    use rustix::io::Errno;

    use super::*;

    #[test]
    fn reserve_has_its_blocks_without_being_written_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("reserve");
        let reserve = SpaceReserve::at(&path, 3 << 20);
        let file = File::open(&path).unwrap();
        let taken = file.metadata().unwrap();
        assert!(reserve.is_held() && taken.len() == 3 << 20 && taken.blocks() * 512 >= 3 << 20);
        let probe = File::create(folder.path().join("probe")).unwrap();
        if files::reserve(&probe, 1 << 20, Length::Extended).is_ok() {
            assert_eq!(seek(&file, SeekFrom::Data(0)), Err(Errno::NXIO), "nothing was written");
        }
    }

    #[test]
    fn reserve_is_written_out_where_blocks_cannot_be_allocated() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("reserve");
        write_out(&mut File::create(&path).unwrap(), (64 << 10) + 5).unwrap();
        assert_eq!(fs::read(&path).unwrap(), vec![0; (64 << 10) + 5]);
    }
}
