//! `upm token` as a subprocess.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};

use tempfile::TempDir;

use super::status;

#[test]
fn token_file_is_new_each_time_and_for_its_owner_alone() {
    let folder = TempDir::new().unwrap();
    let mut tokens = BTreeSet::new();
    for name in ["a", "b", "c"] {
        let file = folder.path().join(name);
        let (stdout, _) = status(&["token", file.to_str().unwrap()], 0);
        let text = fs::read_to_string(&file).unwrap();
        let token = text.strip_suffix('\n').unwrap().to_owned();
        assert!(token.len() == 64 && token.bytes().all(|b| b.is_ascii_hexdigit()), "{token}");
        assert!(stdout.contains("token_file") && !stdout.contains(&token), "{stdout}");
        assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
        tokens.insert(token);
    }
    assert_eq!(tokens.len(), 3);
}

#[test]
fn file_that_is_there_is_never_overwritten() {
    let folder = TempDir::new().unwrap();
    let [file, link, dangling] = ["token", "link", "dangling"].map(|name| folder.path().join(name));
    fs::write(&file, "precious").unwrap();
    symlink(&file, &link).unwrap();
    symlink(folder.path().join("nothing"), &dangling).unwrap();
    for taken in [file.as_path(), &link, &dangling, folder.path()] {
        let (stdout, stderr) = status(&["token", taken.to_str().unwrap()], 2);
        assert!(stdout.is_empty() && stderr.lines().count() == 1 && stderr.contains("never overwritten"), "{stderr}");
    }
    assert_eq!(fs::read_to_string(&file).unwrap(), "precious");
    assert!(!folder.path().join("nothing").exists());
    status(&["token", folder.path().join("no/folder/token").to_str().unwrap()], 1);
}
