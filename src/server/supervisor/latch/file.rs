use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::Path;

use upm_core::files::sync_folder;

const STOPPED: &[u8; 16] = b"upm: stopped    ";
pub(super) const RELEASED: &[u8; 16] = b"upm: released   ";

/// The file of one latch: 16 bytes, rewritten in place.
#[derive(Debug)]
pub(super) struct LatchFile {
    file: File,
    /// State that was written last; `None` when unknown.
    written: Option<bool>,
}

impl LatchFile {
    /// Opens the latch file of `plate` in `folder`; the flag is true when it is stopped. An unreadable or invalid file
    /// counts as stopped, and so does the missing file of a plate that is `known`, since its stop may have been lost
    /// with it. The missing file of a new plate is created as released.
    pub fn open(folder: &Path, plate: &str, known: bool) -> io::Result<(Self, bool)> {
        let path = folder.join(plate);
        let mut options = OpenOptions::new();
        options.read(true).write(true);
        let (file, is_new) = match options.open(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => (options.create_new(true).open(&path)?, true),
            opened => (opened?, false),
        };
        let mut latch = Self { file, written: None };
        if !is_new {
            let released = latch.is_released();
            latch.written = Some(!released);
            return Ok((latch, !released));
        }
        if known {
            let path = path.display();
            tracing::error!(
                plate,
                "{path}: expected the latch file of a known plate, found none: the plate is stopped"
            );
        } else {
            latch.write(false)?;
        }
        // without this a power cut could remove the file's entry, and it would count as missing
        sync_folder(folder)?;
        Ok((latch, known))
    }

    fn is_released(&self) -> bool {
        let mut text = Vec::new();
        let whole = (&self.file).take(1024).read_to_end(&mut text).is_ok();
        whole && text == RELEASED
    }

    /// Writes the state to the disk; true when it is there. Waits for the disk.
    pub fn persist(&mut self, stopped: bool) -> bool {
        self.written == Some(stopped) || self.write(stopped).is_ok()
    }

    fn write(&mut self, stopped: bool) -> io::Result<()> {
        self.written = None;
        self.file.seek(SeekFrom::Start(0))?;
        self.file.write_all(if stopped { STOPPED } else { RELEASED })?;
        self.file.sync_data()?;
        self.written = Some(stopped);
        Ok(())
    }
}

/// Creates the folder of the latch files durably: a power cut does not remove it.
pub(super) fn make_folder(folder: &Path) -> io::Result<()> {
    if folder.is_dir() {
        return Ok(());
    }
    fs::create_dir_all(folder)?;
    folder.parent().map_or(Ok(()), sync_folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(folder: &Path, known: bool) -> (LatchFile, bool) {
        LatchFile::open(folder, "one", known).unwrap()
    }

    #[test]
    fn missing_file_means_stopped_for_a_known_plate_and_released_for_a_new_one() {
        let folder = tempfile::tempdir().unwrap();
        assert!(!open(folder.path(), false).1);
        assert!(!open(folder.path(), true).1, "it is there now");
        fs::remove_file(folder.path().join("one")).unwrap();
        let (mut latch, stopped) = open(folder.path(), true);
        assert!(stopped);
        assert!(open(folder.path(), false).1, "what is not written yet says stopped, too");
        assert!(latch.persist(true));
        assert_eq!(fs::read(folder.path().join("one")).unwrap(), STOPPED);
    }
}
