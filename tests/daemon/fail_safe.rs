//! Lost, replaced or incompatible files of the daemon have safe consequences.

use std::fs;
use std::io::{Seek, SeekFrom, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use super::daemon_process::{LEFT, RIGHT, TestDaemon, rest, serve, status_of, until};

#[test]
fn stop_whose_latch_file_is_lost_holds_over_an_orderly_restart() {
    let served = TestDaemon::start();
    served.status(&["estop", LEFT], 0);
    let served = served.again(|served| {
        assert!(served.terminate().success());
        fs::remove_dir_all(served.folder.path().join("data/latch")).unwrap();
    });
    for plate in [LEFT, RIGHT] {
        assert_eq!(served.plate(plate)["state"], "stopped", "whether it was stopped is not known any more");
    }
    let log = fs::read_to_string(served.folder.path().join("log")).unwrap();
    assert!(log.contains("latch/left: expected the latch file of a known plate, found none"), "{log}");
    served.status(&["reset", LEFT, "--operator", "Ada", "--reason", "test"], 0);
    let served = served.again(|served| assert!(served.terminate().success()));
    assert_ne!(served.plate(LEFT)["state"], "stopped");
    assert_eq!(served.plate(RIGHT)["state"], "stopped");
}

#[test]
fn store_of_another_version_is_bad_input_in_one_line() {
    let mut served = TestDaemon::start();
    assert!(served.terminate().success());
    let db = served.folder.path().join("data/upm.db");
    // `user_version` in the header of the database
    let mut file = fs::File::options().write(true).open(&db).unwrap();
    file.seek(SeekFrom::Start(60)).unwrap();
    file.write_all(&99u32.to_be_bytes()).unwrap();
    let before = fs::read(&db).unwrap();
    fs::write(served.folder.path().join("log"), "").unwrap();
    let output = serve(served.folder.path(), "127.0.0.1:0").output().unwrap();
    status_of(&output, &["serve"], 2);
    let log = fs::read_to_string(served.folder.path().join("log")).unwrap();
    let lines: Vec<&str> = log.lines().filter(|line| line.starts_with("upm: ")).collect();
    assert_eq!(lines.len(), 1, "{log}");
    assert!(lines[0].contains("data/upm.db: expected a job store of version 4, found version 99"), "{log}");
    assert!(fs::read(&db).unwrap() == before && !served.folder.path().join("data/upm.db-wal").exists());
}

#[test]
fn files_of_the_daemon_are_its_users_alone() {
    let served = TestDaemon::start();
    let id = served.submit(&rest("one"), "max");
    until("the job ends", || served.job(&id)["finished_at"].as_str().map(drop));
    let data = served.folder.path().join("data");
    let open: Vec<PathBuf> = all_below(&data).into_iter().filter(|path| mode(path) & 0o077 != 0).collect();
    assert!(open.is_empty(), "{open:?}");
    assert_eq!([mode(&data), mode(&data.join("upm.db")), mode(&served.run_folder("one"))], [0o700, 0o600, 0o700]);
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode() & 0o777
}

/// A folder and everything below it.
fn all_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = vec![folder.to_owned()];
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { found.extend(all_below(&path)) } else { found.push(path) }
    }
    found
}
