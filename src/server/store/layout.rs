use std::ffi::OsString;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use super::StoreFault;
use upm_core::files::sync_folder;

/// Endings of a database's files: itself, its write-ahead log, the log's index.
pub(super) const SQLITE_SUFFIXES: [&str; 3] = ["", "-wal", "-shm"];

/// Paths in a data folder.
#[derive(Clone, Debug)]
pub(super) struct DataDir {
    /// Data folder itself.
    pub data: PathBuf,
    pub db: PathBuf,
    /// The next database while it is being made.
    pub draft: PathBuf,
    /// The next database when it is complete, until the damaged one is moved away.
    pub next: PathBuf,
    pub runs: PathBuf,
}

impl DataDir {
    /// The paths in `data`, which is created if missing.
    pub fn in_folder(data: &Path) -> Result<Self, StoreFault> {
        let at = |name: &str| data.join(name);
        let dir = Self {
            data: data.to_owned(),
            db: at("upm.db"),
            draft: at("upm.db.draft"),
            next: at("upm.db.next"),
            runs: at("runs"),
        };
        fs::create_dir_all(data).map_err(|error| named(data, error))?;
        Ok(dir)
    }

    /// Creates the folder of run folders.
    pub fn make_runs(&self) -> Result<(), StoreFault> {
        fs::create_dir_all(&self.runs).map_err(|error| named(&self.runs, error))
    }

    /// The exclusive lock of the data folder, released on drop.
    pub fn lock(&self) -> Result<File, StoreFault> {
        let path = self.data.join("lock");
        let file = File::options().write(true).create(true).truncate(false).open(&path);
        let file = file.map_err(|error| named(&path, error))?;
        match file.try_lock() {
            Ok(()) => Ok(file),
            Err(TryLockError::WouldBlock) => {
                Err(StoreFault::Io(format!("{} belongs to another daemon that is running", self.data.display())))
            }
            Err(TryLockError::Error(error)) => Err(named(&path, error)),
        }
    }

    /// Names of the run folders, sorted.
    pub fn run_names(&self) -> Result<Vec<String>, StoreFault> {
        let mut names = Vec::new();
        for entry in fs::read_dir(&self.runs).map_err(|error| named(&self.runs, error))? {
            let entry = entry?;
            let name = entry.file_name().into_string();
            let is_run = entry.file_type().is_ok_and(|kind| kind.is_dir());
            names.extend(name.ok().filter(|_| is_run));
        }
        names.sort();
        Ok(names)
    }

    /// Makes renames in the data folder survive a power cut.
    pub fn sync(&self) -> io::Result<()> {
        sync_folder(&self.data)
    }
}

/// The path of SQLite's file next to `db`: `beside(db, "-wal")`.
pub(super) fn beside(db: &Path, ending: &str) -> PathBuf {
    let mut name = OsString::from(db);
    name.push(ending);
    PathBuf::from(name)
}

/// Removes a database with its log.
pub(super) fn remove_all(db: &Path) -> io::Result<()> {
    for path in SQLITE_SUFFIXES.map(|ending| beside(db, ending)) {
        match fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

/// The fault of an operation on `path`.
fn named(path: &Path, error: io::Error) -> StoreFault {
    match StoreFault::from(error) {
        StoreFault::Io(reason) => StoreFault::Io(format!("{}: {reason}", path.display())),
        other => other,
    }
}
