use std::fs::File;
use std::net::Ipv4Addr;
use std::path::Path;

use rerun::SpawnOptions;
use rerun::external::re_uri::ProxyUri;

use super::live::{Live, MessageSink};
use crate::types::RecordingError;
use upm_recording::RerunMode;

/// Opens the viewer of `mode`, if it has one, and creates the file at `path`.
pub(super) fn open(mode: &RerunMode, path: &Path) -> Result<(File, Option<(Live, MessageSink)>), RecordingError> {
    let viewer = viewer_address(mode)?.map(Live::start).transpose().map_err(thread_fault)?;
    let created = |e: std::io::Error| RecordingError::Create { path: path.to_owned(), reason: e.to_string() };
    Ok((File::create(path).map_err(created)?, viewer))
}

pub(super) fn thread_fault(fault: std::io::Error) -> RecordingError {
    RecordingError::Thread(fault.to_string())
}

/// Address of the viewer of `mode`; starts one for [`RerunMode::Spawn`].
fn viewer_address(mode: &RerunMode) -> Result<Option<ProxyUri>, RecordingError> {
    let url = match mode {
        RerunMode::Off | RerunMode::Save => return Ok(None),
        RerunMode::Connect { url } => url.clone().unwrap_or_else(|| rerun::DEFAULT_CONNECT_URL.to_owned()),
        RerunMode::Spawn => {
            let viewer = rerun::spawn(&loopback_viewer());
            // the first line of Rerun's message for a missing viewer, which has the whole search path in a dozen
            let viewer = viewer.map_err(|e| {
                RecordingError::Spawn(e.to_string().lines().next().unwrap_or_default().trim_end().to_owned())
            })?;
            format!("rerun+http://{}:{}/proxy", Ipv4Addr::LOCALHOST, viewer.port)
        }
    };
    parse_address(url).map(Some)
}

/// Options for a viewer that is reachable from this machine only: by default it listens on every interface.
fn loopback_viewer() -> SpawnOptions {
    let extra_args = vec!["--bind".to_owned(), Ipv4Addr::LOCALHOST.to_string()];
    SpawnOptions { hide_welcome_screen: true, extra_args, ..Default::default() }
}

pub(super) fn parse_address(url: String) -> Result<ProxyUri, RecordingError> {
    let address = url.parse::<ProxyUri>().map_err(|e| e.to_string());
    address.map_err(|reason| RecordingError::Address { url, reason })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spawned_viewer_listens_on_the_loopback_alone() {
        let options = loopback_viewer();
        let bound: Vec<_> = options.extra_args.windows(2).filter(|pair| pair[0] == "--bind").collect();
        assert_eq!(bound.len(), 1, "{:?}", options.extra_args);
        assert!(bound[0][1].parse::<Ipv4Addr>().unwrap().is_loopback());
        assert_eq!(options.connect_addr().ip(), Ipv4Addr::LOCALHOST, "and is looked for where it listens");
    }
}
