use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;
use std::sync::atomic::Ordering;

use jiff::SignedDuration;
use rusqlite::params;
use rustix::fs::{Mode, OFlags, open, openat};
use rustix::io::Errno;

use super::columns::{rows, text_of_time};
use super::{JobId, Store, StoreError};

/// Ended runs of standing jobs except the newest of each plate.
const SURPLUS_STANDING: &str = "
    SELECT id, folder FROM (
        SELECT id, folder, row_number() OVER (PARTITION BY plate ORDER BY id DESC) AS age FROM jobs
            WHERE standing = 1 AND state NOT IN ('queued', 'running'))
    WHERE age > ?1 ORDER BY id";

/// Ended jobs above the limit that have no run folder any more, the oldest. A key is kept for a day: until then its
/// request may be repeated.
const SURPLUS_JOBS: &str = "
    DELETE FROM jobs WHERE id IN (
        SELECT id FROM jobs WHERE folder IS NULL AND state NOT IN ('queued', 'running')
            AND (key IS NULL OR submitted_at < ?2) ORDER BY id LIMIT max(0, (SELECT count(*) FROM jobs) - ?1))";
const KEY_KEPT: SignedDuration = SignedDuration::from_hours(24);

impl Store {
    /// Deletes surplus runs of standing jobs, then the run folders of the jobs that ended first while all are too large
    /// in total, then surplus rows. Called after each job; a fault is logged, and the next job tries again.
    pub(super) fn sweep(&self) {
        if let Err(fault) = self.try_sweep() {
            tracing::warn!("old run folders are not deleted: {fault}");
        }
    }

    fn try_sweep(&self) -> Result<(), StoreError> {
        let of_row = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, row.get(1)?));
        let surplus: Vec<(JobId, Option<String>)> =
            self.read(|connection| rows(connection, SURPLUS_STANDING, [self.keep.standing_runs], of_row))?;
        for (id, folder) in surplus {
            if folder.is_none_or(|folder| self.remove_folder(&folder)) {
                self.write(|write| Ok(write.tx.execute("DELETE FROM jobs WHERE id = ?1", [id])?))?;
            }
        }
        let sql = "SELECT id, folder, bytes FROM jobs WHERE folder IS NOT NULL AND finished_at IS NOT NULL
                   ORDER BY finished_at, id";
        let of_row = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, row.get(1)?, row.get(2)?));
        let ended: Vec<(JobId, String, u64)> = self.read(|connection| rows(connection, sql, [], of_row))?;
        let mut bytes: u64 = ended.iter().map(|(_, _, bytes)| bytes).sum();
        for (id, folder, size) in ended {
            if bytes <= self.keep.runs_bytes {
                break;
            }
            if self.remove_folder(&folder) {
                let sql = "UPDATE jobs SET job = json_set(job, '$.folder', NULL, '$.bytes', 0,
                           '$.job.recording', 'pruned') WHERE id = ?1";
                self.write(|write| Ok(write.tx.execute(sql, params![id])?))?;
                bytes -= size;
            }
        }
        self.runs_bytes.store(bytes, Ordering::Relaxed);
        let count: u64 =
            self.read(|connection| connection.query_row("SELECT count(*) FROM jobs", [], |row| row.get(0)))?;
        if count > self.keep.jobs {
            self.write(|write| {
                Ok(write.tx.execute(SURPLUS_JOBS, params![self.keep.jobs, text_of_time(write.now - KEY_KEPT)])?)
            })?;
        }
        Ok(())
    }

    /// Removes a run folder; false, with the reason in the log, when it stays.
    pub(super) fn remove_folder(&self, folder: &str) -> bool {
        let path = self.runs.join(folder);
        match fs::remove_dir_all(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                tracing::warn!("{}: cannot be deleted: {error}", path.display());
                false
            }
            _ => true,
        }
    }
}

/// Why the disk is too full for a job; `None` where it is not, or its free space is not known.
pub(crate) fn low_disk(free_bytes: Option<u64>, min_free_bytes: u64) -> Option<String> {
    let free_bytes = free_bytes.filter(|free_bytes| *free_bytes < min_free_bytes)?;
    let [free_mb, min_free_mb] = [free_bytes, min_free_bytes].map(|bytes| bytes as f64 * 1e-6);
    Some(format!("the disk has {free_mb:.1} MB left, jobs are taken from {min_free_mb:.1} MB on (`disk.min_free_mb`)"))
}

/// Bytes of all files below a folder. Links are not followed; unreadable entries count as 0.
pub(super) fn size_of(folder: &Path) -> u64 {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    let size = |entry: fs::DirEntry| match entry.metadata() {
        Ok(file) if file.is_dir() => size_of(&entry.path()),
        Ok(file) => file.len(),
        Err(_) => 0,
    };
    entries.flatten().map(size).sum()
}

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
pub(super) fn text_of(folder: &Path, name: &str) -> Option<String> {
    let mut text = String::new();
    let file = open_run_file(folder, name).ok()?;
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
