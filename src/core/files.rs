//! Files that survive a power cut: written under a draft name and renamed, with folders synced; free room on a disk.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

/// Writes `bytes` into a new file at `draft`, and renames it to `path` in the same folder once they are on the disk.
/// Until then the old file remains.
///
/// # Errors
/// Errors of writing, syncing and renaming, as the system reports them. The draft is not removed.
pub fn write_whole(draft: &Path, path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create(draft)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    fs::rename(draft, path)
}

/// Syncs `folder` so that the names in it survive a power cut; an empty path is the current folder.
///
/// # Errors
/// Errors of opening and syncing the folder, as the system reports them.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    File::open(folder)?.sync_all()
}

/// Free bytes on the disk of `folder` available to users other than the superuser.
///
/// # Errors
/// The system's error, such as [`io::ErrorKind::NotFound`] where there is no such folder.
pub fn free_bytes(folder: &Path) -> io::Result<u64> {
    let disk = rustix::fs::statvfs(folder)?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let (draft, path) = (folder.path().join("a.part"), folder.path().join("a"));
        fs::write(&path, "what was there").unwrap();
        write_whole(&draft, &path, b"new").unwrap();
        sync_folder(folder.path()).unwrap();
        assert_eq!((fs::read(&path).unwrap().as_slice(), draft.exists()), (b"new".as_slice(), false));
    }
}
