use std::process::{Command, Stdio};

use super::args::RunFolderArgs;
use super::failure::Failure;

/// The viewer that reads this version's recordings.
const VIEWER: &str = "0.36.3";

pub(super) fn replay(args: &RunFolderArgs) -> Result<u8, Failure> {
    let recording = if args.run.is_dir() { args.run.join("run.rrd") } else { args.run.clone() };
    if !recording.is_file() {
        return Err(Failure::bad_input(format!(
            "{}: no recording there; `upm run --rerun save` makes one",
            recording.display()
        )));
    }
    let viewer = Command::new("rerun").arg(&recording).stdin(Stdio::null()).status();
    match viewer {
        Ok(status) if status.success() => Ok(0),
        Ok(status) => Err(Failure::failed(format!("the viewer ended with {status}"))),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Err(Failure::failed(format!(
            "the Rerun viewer is not installed: `pip install rerun-sdk=={VIEWER}` or `cargo install rerun-cli --version \
             {VIEWER}`, then `rerun {}`",
            recording.display()
        ))),
        Err(error) => Err(Failure::failed(format!("the viewer does not start: {error}"))),
    }
}
