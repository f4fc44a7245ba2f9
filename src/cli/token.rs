use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use serde_json::json;

use super::args::Common;
use super::output::{Failure, print};
use super::run_args::TokenArgs;

/// Random bytes of a token; each gives two hex digits.
const BYTES: usize = 32;

/// Creates a token file for a daemon and its clients; never overwrites a file.
pub(super) fn token(args: &TokenArgs, common: Common) -> Result<u8, Failure> {
    let file = &args.file;
    let mut bytes = [0; BYTES];
    getrandom::fill(&mut bytes).map_err(|error| Failure::failed(format!("no random numbers: {error}")))?;
    let token: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    write(file, &token).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => {
            let file = file.display();
            Failure::bad_input(format!("{file}: expected no file, found one; a token is never overwritten"))
        }
        _ => Failure::write(file, error),
    })?;
    print(common.json, &json!({ "file": file.display().to_string() }), || {
        let file = file.display();
        outln!("{file}: a new token")?;
        outln!("  {:10} \"token_file\": \"{file}\" in its file, relative to that", "daemon")?;
        outln!("  {:10} --token-file {file}, or UPM_TOKEN_FILE={file}", "clients")
    })
}

/// Creates a file atomically, readable by its owner only.
fn write(file: &Path, token: &str) -> io::Result<()> {
    let mut made = OpenOptions::new().write(true).create_new(true).mode(0o600).open(file)?;
    let written = writeln!(made, "{token}").and_then(|()| made.sync_all());
    if written.is_err() {
        fs::remove_file(file).ok();
    }
    written
}
