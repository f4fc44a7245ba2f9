use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Time between two tries to take the ballast aboard again.
const TRY_EVERY: Duration = Duration::from_secs(2);

/// A file that is of no use but for its room: thrown off when the disk is full, so that what must be written can be.
#[derive(Debug)]
pub(super) struct Ballast {
    path: PathBuf,
    bytes: u64,
    aboard: bool,
    tried_at: Duration,
}

impl Ballast {
    /// The ballast at `path`, made if there is room for it.
    pub fn at(path: &Path, bytes: u64) -> Self {
        let mut ballast = Self { path: path.to_owned(), bytes, aboard: false, tried_at: Duration::ZERO };
        ballast.take_aboard();
        ballast
    }

    /// True while there is room to be made; always for a ballast of nothing.
    pub fn aboard(&self) -> bool {
        self.aboard
    }

    /// Makes room; false when there is none to be made.
    pub fn throw_off(&mut self) -> bool {
        let thrown = self.aboard && self.bytes > 0 && fs::remove_file(&self.path).is_ok();
        self.aboard &= !thrown;
        thrown
    }

    /// Takes it aboard again where there is room.
    pub fn tend(&mut self, now: Duration) {
        if !self.aboard && now.saturating_sub(self.tried_at) >= TRY_EVERY {
            self.tried_at = now;
            self.take_aboard();
        }
    }

    fn take_aboard(&mut self) {
        let there = fs::metadata(&self.path).is_ok_and(|file| file.len() == self.bytes);
        self.aboard = self.bytes == 0 || there || self.has_room() && self.fill().is_ok();
        if !self.aboard {
            // half of it is of no use
            let _ = fs::remove_file(&self.path);
        }
    }

    /// True when as much again is left beside it.
    fn has_room(&self) -> bool {
        let folder = self.path.parent().unwrap_or(&self.path);
        free_bytes(folder).is_ok_and(|free| free >= 2 * self.bytes)
    }

    /// Written out, not merely made long: its blocks must be its own.
    fn fill(&self) -> io::Result<()> {
        let mut file = File::create(&self.path)?;
        let block = [0; 64 << 10];
        let mut left = self.bytes;
        while left > 0 {
            let part = left.min(block.len() as u64);
            file.write_all(block.get(..part as usize).unwrap_or(&block))?;
            left -= part;
        }
        file.sync_all()
    }
}

/// Bytes that may still be written on the disk of `folder`.
pub(super) fn free_bytes(folder: &Path) -> io::Result<u64> {
    let disk = rustix::fs::statvfs(folder)?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
}
