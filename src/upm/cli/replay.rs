use std::process::{Command, Stdio};

use super::output::Failure;
use super::run_args::RunFolderArgs;
use super::run_folder::run_folder;

/// Version of the viewer that reads this version's recordings.
const VIEWER: &str = "0.36.3";

pub(super) fn replay(args: &RunFolderArgs) -> Result<u8, Failure> {
    let run = run_folder(args)?;
    let recording = if run.is_dir() { run.join("run.rrd") } else { run.clone() };
    let shown = recording.display();
    if !recording.is_file() {
        return Err(Failure::bad_input(format!("{shown}: no recording there; `upm run --rerun save` makes one")));
    }
    // by default the viewer listens on every interface
    let viewer = Command::new("rerun").args(["--bind", "127.0.0.1"]).arg(&recording).stdin(Stdio::null()).status();
    match viewer {
        Ok(status) if status.success() => Ok(0),
        Ok(status) => Err(Failure::failed(format!("the viewer ended with {status}"))),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Err(Failure::failed(format!(
            "the Rerun viewer is not installed: `pip install rerun-sdk=={VIEWER}` or `cargo install rerun-cli --version \
             {VIEWER}`, then `rerun --bind 127.0.0.1 {shown}`"
        ))),
        Err(error) => Err(Failure::failed(format!("the viewer does not start: {error}"))),
    }
}
