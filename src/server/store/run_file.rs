use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use rustix::fs::{Mode, OFlags, open, openat};
use rustix::io::Errno;

use super::columns::text_of_time;

/// Largest `effective.json` or `report.json` that is read, bytes.
const MOST_BYTES: u64 = 16 << 20;

/// Opens the regular file `name` in a run folder for reading. Follows no link, so it never leaves the folder. Never
/// waits for the other end of a FIFO, but blocks on a hung disk. Anything but a regular file is
/// [`ErrorKind::InvalidInput`].
pub fn open_run_file(folder: &Path, name: &str) -> io::Result<File> {
    let no_file =
        || io::Error::new(ErrorKind::InvalidInput, "expected a regular file in a folder, found something else");
    let fault = |errno: Errno| match errno {
        // a link, a file where a folder should be or the reverse, a socket or a FIFO that no process reads
        Errno::LOOP | Errno::NOTDIR | Errno::ISDIR | Errno::NXIO => no_file(),
        other => other.into(),
    };
    let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let folder = open(folder, flags | OFlags::DIRECTORY, Mode::empty()).map_err(fault)?;
    let file = File::from(openat(folder, name, flags, Mode::empty()).map_err(fault)?);
    if file.metadata()?.is_file() { Ok(file) } else { Err(no_file()) }
}

/// Text of a file in a run folder; `None` when it is missing, is not UTF-8, or exceeds [`MOST_BYTES`].
pub(super) fn text_of(path: &Path) -> Option<String> {
    let mut text = String::new();
    let file = open_run_file(path.parent()?, path.file_name()?.to_str()?).ok()?;
    let read = file.take(MOST_BYTES + 1).read_to_string(&mut text).ok()?;
    (read as u64 <= MOST_BYTES).then_some(text)
}

/// Time of the last write to a file.
pub(super) fn modified(path: &Path) -> Option<String> {
    let time = fs::metadata(path).and_then(|file| file.modified()).ok()?;
    time.try_into().ok().map(text_of_time)
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
        assert_eq!(open_run_file(&run, "none").unwrap_err().kind(), ErrorKind::NotFound);
        symlink("../secret", run.join("link")).unwrap();
        symlink("run", data.path().join("other")).unwrap();
        for (folder, name) in
            [(run.clone(), "link"), (data.path().to_owned(), "run"), (data.path().join("other"), "run.rrd")]
        {
            let opened = open_run_file(&folder, name);
            assert_eq!(opened.unwrap_err().kind(), ErrorKind::InvalidInput, "{name}");
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn fifo_is_refused_at_once() {
        use rustix::fs::{CWD, FileType, mknodat};

        let run = tempfile::tempdir().unwrap();
        mknodat(CWD, run.path().join("run.rrd"), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        assert_eq!(open_run_file(run.path(), "run.rrd").unwrap_err().kind(), ErrorKind::InvalidInput);
    }
}
