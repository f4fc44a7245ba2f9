use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use upm_core::files::sync_folder;

/// A file that gets its name only once it is complete. Until then it is `NAME.part`, locked against other processes, so
/// that the remains of a killed process are recognised by name.
pub(super) struct PartialFile {
    part: PathBuf,
    path: PathBuf,
}

impl PartialFile {
    /// An empty `NAME.part` beside `path`.
    pub(super) fn create(path: &Path) -> io::Result<(Self, File)> {
        Self::create_as("part", path)
    }

    /// An empty `NAME.suffix` beside `path`.
    pub(super) fn create_as(suffix: &str, path: &Path) -> io::Result<(Self, File)> {
        if path.is_dir() {
            return Err(ErrorKind::IsADirectory.into());
        }
        let part = with_suffix(path, suffix);
        let file = open_regular(&part, OpenOptions::new().write(true).create(true).truncate(false))?;
        lock(&file)?;
        file.set_len(0)?;
        // syncs the name of the draft, so that its synced data survive a power cut; a disk that fails here reports it
        // at the end
        sync_parent(&part).ok();
        Ok((Self { part, path: path.to_owned() }, file))
    }

    /// Its present path.
    pub(super) fn part(&self) -> &Path {
        &self.part
    }

    /// A second handle for syncing only. It holds no lock, so that the file is unlocked once its writer is gone.
    pub(super) fn to_sync(&self) -> io::Result<File> {
        open_regular(&self.part, OpenOptions::new().write(true))
    }

    /// Renames the file to its final name, once all of it is on the disk.
    pub(super) fn keep(&self) -> io::Result<()> {
        keep(&self.part, &self.path)
    }
}

/// `path` with one more suffix.
fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = OsString::from(path.file_name().unwrap_or_default());
    name.push(".");
    name.push(suffix);
    path.with_file_name(name)
}

/// Refuses a file that another process is writing. On a file system without locks every file is accepted.
pub(super) fn lock(file: &File) -> io::Result<()> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(io::Error::new(ErrorKind::WouldBlock, "another process is writing it")),
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
    }
}

/// Opens the regular file at `path` with `options`. Follows no symbolic link and never blocks on a FIFO.
pub(super) fn open_regular(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;

        options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed());
    }
    match options.open(path) {
        Ok(file) if file.metadata()?.is_file() => Ok(file),
        // the system's message for a link or a FIFO mentions neither
        Err(error) if fs::symlink_metadata(path).map_or(true, |found| found.is_file()) => Err(error),
        _ => Err(io::Error::new(ErrorKind::InvalidInput, "expected a regular file, found something else")),
    }
}

/// Renames `part` to `path`; both names are synced when this returns.
pub(super) fn keep(part: &Path, path: &Path) -> io::Result<()> {
    open_regular(part, OpenOptions::new().read(true))?.sync_all()?;
    fs::rename(part, path)?;
    sync_parent(path)
}

fn sync_parent(path: &Path) -> io::Result<()> {
    sync_folder(path.parent().unwrap_or(Path::new(".")))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn a_file_has_its_name_only_once_it_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.rrd");
        let part = folder.path().join("run.rrd.part");
        fs::write(&part, "left by a killed process").unwrap();
        let (draft, mut file) = PartialFile::create(&path).unwrap();
        file.write_all(b"whole").unwrap();
        assert!(part.exists() && !path.exists());
        assert!(PartialFile::create(&path).is_err(), "two at once");
        assert!(PartialFile::create(folder.path()).is_err(), "could never be kept");
        draft.keep().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "whole");
        assert!(!part.exists());
    }
}
