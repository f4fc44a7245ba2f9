use std::fs;
use std::io;
use std::iter::once;
use std::path::{Path, PathBuf};

use rustix::fs::{CWD, FileType, Mode, OFlags, fchmod, fstat, openat};
use rustix::process::{Uid, geteuid};

/// Names of the daemon's entries in a data folder, besides those of the database.
const OWN_NAMES: [&str; 3] = ["latch", "lock", "runs"];

/// Restricts a data folder and the daemon's own entries directly in it to the daemon's user: earlier releases let other
/// users read them. Logs the changes.
///
/// No database may be open in this process: closing a file drops all locks that the process has on it, including
/// SQLite's.
pub(super) fn make_private(data: &Path) {
    let changed = made_private(data, geteuid());
    if !changed.is_empty() {
        let paths: Vec<String> = changed.iter().map(|path| path.display().to_string()).collect();
        tracing::info!("removed the access of other users to {}", paths.join(", "));
    }
}

/// The folders and files that were changed. Those owned by other users than `user` stay as they are.
fn made_private(data: &Path, user: Uid) -> Vec<PathBuf> {
    let entries = fs::read_dir(data).into_iter().flatten().flatten();
    let own = entries.filter(|entry| entry.file_name().to_str().is_some_and(is_own)).map(|entry| entry.path());
    let is_changed = |path: &PathBuf| {
        removed_access(path, user).unwrap_or_else(|error| {
            tracing::warn!("{}: cannot remove the access of other users: {error}", path.display());
            false
        })
    };
    once(data.to_owned()).chain(own).filter(is_changed).collect()
}

fn is_own(name: &str) -> bool {
    name.starts_with("upm.db") || OWN_NAMES.contains(&name)
}

/// True when other users had access and have none now. Follows no link, and ignores everything except files and
/// folders.
fn removed_access(path: &Path, user: Uid) -> io::Result<bool> {
    let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let Ok(file) = openat(CWD, path, flags, Mode::empty()) else { return Ok(false) };
    let found = fstat(&file)?;
    let (mode, others) = (Mode::from_raw_mode(found.st_mode), Mode::RWXG | Mode::RWXO);
    let is_kind = matches!(FileType::from_raw_mode(found.st_mode), FileType::RegularFile | FileType::Directory);
    if !is_kind || found.st_uid != user.as_raw() || !mode.intersects(others) {
        return Ok(false);
    }
    fchmod(&file, mode - others)?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::os::unix::fs::{PermissionsExt, symlink};

    use super::*;

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).unwrap().permissions().mode() & 0o777
    }

    fn set_mode(path: &Path, mode: u32) {
        fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
    }

    /// A data folder as earlier releases made it, with a user's note and links to the outside, in its own temporary
    /// folder.
    fn readable_data() -> (tempfile::TempDir, PathBuf) {
        let around = tempfile::tempdir().unwrap();
        let data = around.path().join("data");
        for folder in ["data", "data/latch", "data/runs", "elsewhere"] {
            fs::create_dir(around.path().join(folder)).unwrap();
            set_mode(&around.path().join(folder), 0o755);
        }
        for file in ["data/lock", "data/note", "data/upm.db", "data/upm.db-wal", "text"] {
            fs::write(around.path().join(file), "").unwrap();
            set_mode(&around.path().join(file), 0o644);
        }
        symlink("../elsewhere", data.join("upm.db-shm")).unwrap();
        symlink("../text", data.join("upm.db.v1")).unwrap();
        (around, data)
    }

    #[test]
    fn readable_files_of_the_daemon_become_private_and_nothing_else_does() {
        let (around, data) = readable_data();
        let mut changed = made_private(&data, geteuid());
        changed.sort();
        let names = ["", "latch", "lock", "runs", "upm.db", "upm.db-wal"];
        let paths = names.map(|name| if name.is_empty() { data.clone() } else { data.join(name) });
        assert_eq!(changed, paths);
        assert_eq!(paths.map(|path| mode(&path)), [0o700, 0o700, 0o600, 0o700, 0o600, 0o600]);
        let others = ["data/note", "text", "elsewhere"].map(|name| mode(&around.path().join(name)));
        assert_eq!(others, [0o644, 0o644, 0o755]);
        assert_eq!(made_private(&data, geteuid()), Vec::<PathBuf>::new(), "once");
    }

    #[test]
    fn files_of_another_user_and_a_linked_data_folder_keep_their_modes() {
        let (around, data) = readable_data();
        let another = Uid::from_raw(geteuid().as_raw() + 1);
        assert_eq!(made_private(&data, another), Vec::<PathBuf>::new());
        assert_eq!([mode(&data), mode(&data.join("upm.db"))], [0o755, 0o644]);
        let link = around.path().join("link");
        symlink("data", &link).unwrap();
        assert!(!removed_access(&link, geteuid()).unwrap());
        assert_eq!(mode(&data), 0o755);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn fifo_is_left_alone_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        rustix::fs::mknodat(CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        set_mode(&path, 0o644);
        assert!(!removed_access(&path, geteuid()).unwrap());
        assert_eq!(mode(&path), 0o644);
    }
}
