use std::fs::File;
use std::net::Ipv4Addr;
use std::path::Path;
use std::time::Duration;

use rerun::SpawnOptions;
use rerun::external::re_uri::ProxyUri;
use rerun::log::LogMsg;
use rerun::sink::{GrpcSink, LogSink};

use crate::types::RecordingError;
use upm_core::background::{BackgroundThread, OverflowPolicy, Queue};
use upm_recording::RerunMode;

/// Capacity of a viewer's queue, messages.
pub(super) const VIEWER_QUEUE: usize = 512;

/// Time for which the end of a run waits for the viewer to take the remaining messages.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(3);

/// A function that passes messages of a recording on to viewers. Never blocks.
pub(super) type MessageSink = Box<dyn FnMut(LogMsg) + Send>;

/// The thread that feeds a viewer. A gRPC sink blocks forever when its viewer is frozen or absent, so it is fed through
/// a queue that drops messages when it is full.
pub(super) struct Live {
    thread: BackgroundThread<bool>,
    queue: Queue<LogMsg>,
}

impl Live {
    /// Starts feeding the viewer at `uri`.
    pub(super) fn start(uri: ProxyUri) -> std::io::Result<(Self, MessageSink)> {
        let (queue, messages) = Queue::bounded(VIEWER_QUEUE, OverflowPolicy::GiveUp);
        let thread = BackgroundThread::start("viewer", false, move || {
            let viewer = GrpcSink::new(uri);
            messages.iter().for_each(|message| viewer.send(message));
            viewer.flush_blocking(CLOSE_TIMEOUT).is_ok()
        })?;
        let fed = queue.clone();
        let feed = Box::new(move |message| {
            fed.send(message).ok();
        });
        Ok((Self { thread, queue }, feed))
    }

    /// Waits briefly for the viewer to take the remaining messages; a stuck thread is abandoned. To be called when
    /// every [`MessageSink`] is dropped. True if the viewer has all messages.
    pub(super) fn finish(self) -> bool {
        let Self { thread, queue } = self;
        let is_whole = queue.lost() == 0;
        drop(queue);
        thread.wait_within(CLOSE_TIMEOUT) == Ok(true) && is_whole
    }
}

/// Opens the viewer of `mode`, if it has one, and creates the file at `path`.
pub(super) fn open(mode: &RerunMode, path: &Path) -> Result<(File, Option<(Live, MessageSink)>), RecordingError> {
    let viewer = viewer_address(mode)?.map(Live::start).transpose().map_err(thread_fault)?;
    let created = |e: std::io::Error| RecordingError(format!("cannot create {}: {e}", path.display()));
    Ok((File::create(path).map_err(created)?, viewer))
}

pub(super) fn thread_fault(fault: std::io::Error) -> RecordingError {
    RecordingError(format!("recorder thread: {fault}"))
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
                let (text, brings) = (e.to_string(), "(`pip install rerun-sdk==0.36.3` brings one)");
                let first = text.lines().next().unwrap_or_default().trim_end();
                RecordingError(format!("cannot start the Rerun viewer {brings}: {first}"))
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
    url.parse::<ProxyUri>().map_err(|reason| {
        let expected = "something like rerun+http://127.0.0.1:9876/proxy";
        RecordingError(format!("`{url}` is not a viewer address; expected {expected}: {reason}"))
    })
}

#[cfg(test)]
mod destination_tests {
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
