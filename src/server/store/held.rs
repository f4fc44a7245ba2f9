use std::fs::{File, Metadata};
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A path with the file or folder that it must name: the one that the daemon holds open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WatchedPath {
    path: PathBuf,
    id: FileId,
}

/// A path that does not name the file held open.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: expected the file that the daemon holds open, found {found}", path.display())]
pub struct DisplacedFile {
    /// Path that named the file when the watch began.
    pub path: PathBuf,
    /// Object that the path names now.
    pub found: PathObject,
}

/// The object that a displaced path names.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PathObject {
    /// Nothing: the file was deleted or moved.
    #[error("none")]
    Nothing,
    /// Another file.
    #[error("another one")]
    Another,
    /// The path cannot be resolved.
    #[error("an error: {0}")]
    Unknown(String),
}

/// Device and inode, which no other file can have while this one is held open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileId {
    dev: u64,
    ino: u64,
}

impl FileId {
    fn of(file: &Metadata) -> Self {
        Self { dev: file.dev(), ino: file.ino() }
    }
}

impl WatchedPath {
    /// `path` with `file`, which the caller holds open.
    pub fn of(path: &Path, file: &File) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), id: FileId::of(&file.metadata()?) })
    }

    /// `path` with the file it names now, which other code holds open.
    pub fn named(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), id: FileId::of(&path.metadata()?) })
    }

    /// Compares the file that the path names with the one held open. Waits for the disk.
    pub fn check(&self) -> Result<(), DisplacedFile> {
        let found = match self.path.metadata() {
            Ok(file) if FileId::of(&file) == self.id => return Ok(()),
            Ok(_) => PathObject::Another,
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => PathObject::Nothing,
            Err(error) => PathObject::Unknown(error.to_string()),
        };
        Err(DisplacedFile { path: self.path.clone(), found })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn path_of_a_deleted_or_replaced_file_is_displaced_until_it_is_put_back() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("file"), folder.path().join("other"));
        let file = File::create(&path).unwrap();
        let held = WatchedPath::of(&path, &file).unwrap();
        assert_eq!((held.check(), WatchedPath::named(&path).unwrap()), (Ok(()), held.clone()));
        fs::rename(&path, &other).unwrap();
        let found = || held.check().unwrap_err().found;
        assert_eq!(found(), PathObject::Nothing);
        fs::write(&path, "").unwrap();
        assert_eq!(found(), PathObject::Another);
        fs::rename(&other, &path).unwrap();
        assert_eq!(held.check(), Ok(()));
        fs::remove_dir_all(folder.path()).unwrap();
        assert_eq!(found(), PathObject::Nothing);
    }

    #[test]
    fn folder_is_held_like_a_file() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("data");
        fs::create_dir(&path).unwrap();
        let file = File::open(&path).unwrap();
        let held = WatchedPath::of(&path, &file).unwrap();
        fs::rename(&path, parent.path().join("moved")).unwrap();
        fs::create_dir(&path).unwrap();
        assert_eq!(held.check(), Err(DisplacedFile { path, found: PathObject::Another }));
    }
}
