//! Files that outlive a power cut: written beside their name and renamed, folders synced, room reserved ahead.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

/// Writes `bytes` into `file`, which is the new file `draft`, and gives it the name `path` in the same folder once they are on
/// the disk. Until then the old file remains.
pub fn write_whole(mut file: File, draft: &Path, path: &Path, bytes: &[u8]) -> io::Result<()> {
    file.write_all(bytes)?;
    file.sync_all()?;
    fs::rename(draft, path)
}

/// Makes the names in `folder` outlive a power cut; an empty path is the present folder.
#[cfg(unix)]
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    File::open(folder)?.sync_all()
}

/// Elsewhere a folder is no file.
#[cfg(not(unix))]
pub fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Length of a file after room was reserved for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    /// The length it had.
    Kept,
    /// That of the room.
    Extended,
}

/// Allocates disk blocks for the first `bytes` of `file`.
///
/// # Errors
/// [`io::ErrorKind::Unsupported`] on a file system without preallocation; others as the system reports them.
#[cfg(target_os = "linux")]
pub fn reserve(file: &File, bytes: u64, length: Length) -> io::Result<()> {
    use rustix::fs::{FallocateFlags, fallocate};
    use rustix::io::Errno;

    let flags = match length {
        Length::Kept => FallocateFlags::KEEP_SIZE,
        Length::Extended => FallocateFlags::empty(),
    };
    fallocate(file, flags, 0, bytes).map_err(|errno| match errno {
        Errno::OPNOTSUPP | Errno::NOSYS => io::ErrorKind::Unsupported.into(),
        other => other.into(),
    })
}

/// Elsewhere no disk can.
#[cfg(not(target_os = "linux"))]
pub fn reserve(_: &File, _: u64, _: Length) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Bytes that others than the superuser may still write on the disk of `folder`.
#[cfg(unix)]
pub fn free_bytes(folder: &Path) -> io::Result<u64> {
    let disk = rustix::fs::statvfs(folder)?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
}

/// Elsewhere it is not known.
#[cfg(not(unix))]
pub fn free_bytes(_: &Path) -> io::Result<u64> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let (draft, path) = (folder.path().join("a.part"), folder.path().join("a"));
        fs::write(&path, "what was there").unwrap();
        write_whole(File::create(&draft).unwrap(), &draft, &path, b"new").unwrap();
        sync_folder(folder.path()).unwrap();
        assert_eq!((fs::read(&path).unwrap().as_slice(), draft.exists()), (b"new".as_slice(), false));
    }

    #[test]
    fn reserved_room_leaves_the_length_or_extends_it() {
        let folder = tempfile::tempdir().unwrap();
        for (length, bytes) in [(Length::Kept, 0), (Length::Extended, 1 << 20)] {
            let file = File::create(folder.path().join("room")).unwrap();
            match reserve(&file, 1 << 20, length) {
                Ok(()) => assert_eq!(file.metadata().unwrap().len(), bytes),
                Err(error) => assert_eq!(error.kind(), io::ErrorKind::Unsupported),
            }
        }
    }

    #[test]
    fn free_room_is_told_of_folders_that_exist() {
        let folder = tempfile::tempdir().unwrap();
        assert!(free_bytes(folder.path()).unwrap() > 0);
        assert!(free_bytes(&folder.path().join("none")).is_err());
    }
}
