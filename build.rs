//! Embeds the shipped configurations, so that `upm init` can write them anywhere: `$OUT_DIR/shipped.rs` is a list of
//! their paths and texts.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Folders of the shipped configurations. The paths among them stay as they are in the repository.
const FOLDERS: [&str; 2] = ["configs", "assets/libraries"];

fn main() -> io::Result<()> {
    let variable = |name| env::var_os(name).map(PathBuf::from).ok_or(io::ErrorKind::NotFound);
    let (root, out) = (variable("CARGO_MANIFEST_DIR")?, variable("OUT_DIR")?);
    let mut files = Vec::new();
    for folder in FOLDERS {
        println!("cargo:rerun-if-changed={folder}");
        json_files(&root, Path::new(folder), &mut files)?;
    }
    files.sort();
    let mut list = String::from("&[\n");
    for file in files {
        let _ = writeln!(list, "    ({:?}, include_str!({:?})),", file, root.join(&file));
    }
    fs::write(out.join("shipped.rs"), list + "]\n")
}

/// Adds the JSON files in `folder` and below, as paths from `root` with slashes.
fn json_files(root: &Path, folder: &Path, files: &mut Vec<String>) -> io::Result<()> {
    for entry in fs::read_dir(root.join(folder))? {
        let name = entry?.file_name();
        let path = folder.join(&name);
        if root.join(&path).is_dir() {
            json_files(root, &path, files)?;
        } else if path.extension().is_some_and(|ending| ending == "json") {
            files.push(path.to_string_lossy().replace('\\', "/"));
        }
    }
    Ok(())
}
