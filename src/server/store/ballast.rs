use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use upm_core::files::{Length, free_bytes, reserve};

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

    /// Not merely made long: its blocks must be its own. Written out only where they cannot be had at once, since who
    /// waits for this writes nothing else meanwhile.
    fn fill(&self) -> io::Result<()> {
        let mut file = File::create(&self.path)?;
        match reserve(&file, self.bytes, Length::Extended) {
            Err(error) if error.kind() == io::ErrorKind::Unsupported => write_out(&mut file, self.bytes)?,
            done => done?,
        }
        file.sync_all()
    }
}

/// Writes so many zeros.
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
    fn it_has_blocks_of_its_own_without_being_written_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("reserve");
        let ballast = Ballast::at(&path, 3 << 20);
        let file = File::open(&path).unwrap();
        let taken = file.metadata().unwrap();
        assert!(ballast.aboard() && taken.len() == 3 << 20 && taken.blocks() * 512 >= 3 << 20);
        let probe = File::create(folder.path().join("probe")).unwrap();
        if reserve(&probe, 1 << 20, Length::Extended).is_ok() {
            assert_eq!(seek(&file, SeekFrom::Data(0)), Err(Errno::NXIO), "nothing was written");
        }
    }

    #[test]
    fn where_no_blocks_can_be_set_aside_it_is_written_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("reserve");
        write_out(&mut File::create(&path).unwrap(), (64 << 10) + 5).unwrap();
        assert_eq!(fs::read(&path).unwrap(), vec![0; (64 << 10) + 5]);
    }
}
