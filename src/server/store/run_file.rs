use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use jiff::Timestamp;
use rustix::fs::{Mode, OFlags, open, openat};
use rustix::io::Errno;

use super::columns::Micros;

/// Largest `effective.json` or `report.json` that is read, bytes.
const MOST_BYTES: u64 = 16 << 20;

/// Why a file of a run folder is not opened.
#[derive(Debug, thiserror::Error)]
pub enum RunFileFault {
    /// The file does not exist.
    #[error("there is no such file")]
    Missing,
    /// The file is a link, a folder, a FIFO or the like, or the folder is a link.
    #[error("expected a regular file in a folder, found something else")]
    NotRegular,
    /// Opening it failed.
    #[error("{0}")]
    Io(#[from] io::Error),
}

/// Opens the regular file `name` in a run folder for reading. Follows no link, so it never leaves the folder. Never
/// waits for the other end of a FIFO, but blocks on a hung disk.
pub fn open_run_file(folder: &Path, name: &str) -> Result<File, RunFileFault> {
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let folder = open(folder, OFlags::RDONLY | flags | OFlags::DIRECTORY, Mode::empty()).map_err(fault)?;
    let file = File::from(openat(folder, name, OFlags::RDONLY | flags, Mode::empty()).map_err(fault)?);
    if file.metadata()?.is_file() { Ok(file) } else { Err(RunFileFault::NotRegular) }
}

fn fault(errno: Errno) -> RunFileFault {
    match errno {
        Errno::NOENT => RunFileFault::Missing,
        // a link, a file where a folder should be or the reverse, a socket or a FIFO that no process reads
        Errno::LOOP | Errno::NOTDIR | Errno::ISDIR | Errno::NXIO => RunFileFault::NotRegular,
        other => RunFileFault::Io(other.into()),
    }
}

/// Text of a file in a run folder; `None` when it is missing, is not UTF-8, or exceeds [`MOST_BYTES`].
pub(super) fn text_of(path: &Path) -> Option<String> {
    let mut text = String::new();
    let file = open_run_file(path.parent()?, path.file_name()?.to_str()?).ok()?;
    let read = file.take(MOST_BYTES + 1).read_to_string(&mut text).ok()?;
    (read as u64 <= MOST_BYTES).then_some(text)
}

/// Time of the last write to a file, rounded as in the store.
pub(super) fn modified(path: &Path) -> Option<Timestamp> {
    let time = fs::metadata(path).and_then(|file| file.modified()).ok()?;
    Timestamp::try_from(time).ok().map(Micros::rounded)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn regular_file_is_opened_and_nothing_else_is() {
        let data = tempfile::tempdir().unwrap();
        let run = data.path().join("run");
        fs::create_dir(&run).unwrap();
        fs::write(data.path().join("secret"), "secret").unwrap();
        fs::write(run.join("run.rrd"), "RRF2").unwrap();
        let mut text = String::new();
        open_run_file(&run, "run.rrd").unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text, "RRF2");
        assert!(matches!(open_run_file(&run, "none"), Err(RunFileFault::Missing)));
        symlink("../secret", run.join("link")).unwrap();
        symlink("run", data.path().join("other")).unwrap();
        for (folder, name) in
            [(run.clone(), "link"), (data.path().to_owned(), "run"), (data.path().join("other"), "run.rrd")]
        {
            let opened = open_run_file(&folder, name);
            assert!(matches!(opened, Err(RunFileFault::NotRegular)), "{name}: {opened:?}");
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn fifo_is_refused_at_once() {
        use rustix::fs::{CWD, FileType, mknodat};

        let run = tempfile::tempdir().unwrap();
        mknodat(CWD, run.path().join("run.rrd"), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        assert!(matches!(open_run_file(run.path(), "run.rrd"), Err(RunFileFault::NotRegular)));
    }
}
