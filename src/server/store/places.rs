use std::ffi::OsString;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use super::StoreFault;

/// Name of a folder whose contents are being deleted.
const TRASH: &str = ".trash";

/// Where things are in a data folder.
#[derive(Clone, Debug)]
pub(super) struct Places {
    /// The folder itself.
    pub data: PathBuf,
    /// The database.
    pub db: PathBuf,
    /// The next database while it is being made.
    pub draft: PathBuf,
    /// The next database when it is whole, and the damaged one has yet to make way.
    pub next: PathBuf,
    /// Run folders.
    pub runs: PathBuf,
    /// Run folders that are being deleted.
    pub trash: PathBuf,
    /// The same on the disk of the run folders, where that is another one; made when it is needed.
    pub runs_trash: PathBuf,
    /// The ballast.
    pub reserve: PathBuf,
}

impl Places {
    /// Those in `data`, with the folders made.
    pub fn make(data: &Path) -> Result<Self, StoreFault> {
        let at = |name: &str| data.join(name);
        let places = Self {
            data: data.to_owned(),
            db: at("upm.db"),
            draft: at("upm.db.draft"),
            next: at("upm.db.next"),
            runs: at("runs"),
            trash: at(TRASH),
            runs_trash: at("runs").join(TRASH),
            reserve: at("reserve"),
        };
        for folder in [&places.runs, &places.trash] {
            fs::create_dir_all(folder).map_err(|error| named(folder, error))?;
        }
        Ok(places)
    }

    /// Holds the data folder for this process alone.
    pub fn lock(&self) -> Result<File, StoreFault> {
        let path = self.data.join("lock");
        let file = File::options().write(true).create(true).truncate(false).open(&path);
        let file = file.map_err(|error| named(&path, error))?;
        match file.try_lock() {
            Ok(()) => Ok(file),
            Err(TryLockError::WouldBlock) => {
                let data = self.data.display();
                Err(StoreFault::Io(format!("{data} belongs to another daemon that is running")))
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
            let is_run = |name: &String| name != TRASH && entry.file_type().is_ok_and(|kind| kind.is_dir());
            names.extend(name.ok().filter(is_run));
        }
        names.sort();
        Ok(names)
    }

    /// Makes renames in the data folder outlive a power cut.
    pub fn sync(&self) -> io::Result<()> {
        File::open(&self.data)?.sync_all()
    }
}

/// The file SQLite keeps beside `db`: `beside(db, "-wal")`.
pub(super) fn beside(db: &Path, ending: &str) -> PathBuf {
    let mut name = OsString::from(db);
    name.push(ending);
    PathBuf::from(name)
}

/// The fault of an act on `path`.
fn named(path: &Path, error: io::Error) -> StoreFault {
    match StoreFault::from(error) {
        StoreFault::Io(reason) => StoreFault::Io(format!("{}: {reason}", path.display())),
        other => other,
    }
}
