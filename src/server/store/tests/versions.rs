//! Stores of other schema versions.

use std::collections::BTreeMap;
use std::fs;

use super::*;
use crate::store::connection::writing;
use crate::store::schema::VERSION;

/// All files below a folder with their contents, except SQLite's index of the log, which holds no data and which every
/// reader changes.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => found.extend(contents(&path)),
            false if path.ends_with("upm.db-shm") => {}
            false => _ = found.insert(path.display().to_string(), fs::read(&path).unwrap()),
        }
    }
    found
}

#[test]
fn store_of_another_version_is_refused_and_left_untouched() {
    for found in [VERSION - 1, VERSION + 1] {
        let (folder, store) = new_store(limits());
        queue(&store, "one", "a");
        assert!(store.close(TIMEOUT));
        drop(store);
        let database = folder.path().join("upm.db");
        writing(&database).unwrap().pragma_update(None, "user_version", found).unwrap();
        let before = contents(folder.path());
        let fault = try_open(folder.path(), limits()).map(|_| ()).unwrap_err();
        let file = database.display().to_string();
        assert_eq!(fault, StoreFault::OtherVersion { file, found, expected: VERSION });
        assert!(fault.to_string().contains(&format!("expected a job store of version 1, found version {found}")));
        assert!(contents(folder.path()) == before, "something was changed");
    }
}
