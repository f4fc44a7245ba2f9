use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use rerun::external::re_uri::ProxyUri;

use super::file::RrdFile;
use super::live::{Live, LiveQueue};
use super::recorder::{Logged, Looks, Message, Recorder};
use crate::control::{CycleFacts, EventLevel, FrameFacts, LocalisedFacts, PulseFacts, Sink};
use crate::library::Library;
use crate::planner::Method;
use crate::recording::keeping::Keeping;
use crate::recording::records::EventRecord;
use crate::recording::rerun_mode::RerunMode;
use crate::rig::RigModel;
use crate::signal::Frame;
use crate::sim::TruthProbe;
use crate::time::PlateTime;

/// Messages that may wait for the recorder; at most so many frames are held.
const QUEUE: usize = 32;

/// Looks kept for trails, a second of plate time.
const LOOKS_HZ: f64 = 15.0;

/// Looks are gathered no longer than this, s of plate time.
const GATHER_S: f64 = 0.2;

/// What a recording should know of its run.
#[derive(Clone, Debug)]
pub struct RunContext {
    /// Name of the job.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// Names the centres of rotation.
    pub library: Arc<Library>,
    /// The rig.
    pub model: RigModel,
    /// How cycles are planned.
    pub method: Method,
    /// Every part, in the order of the job.
    pub parts: Vec<PartLook>,
    /// Where everything truly is, where the rig tells.
    pub truth: Option<TruthProbe>,
}

/// How a part is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct PartLook {
    /// Name in this run: `penny-1`.
    pub id: String,
    /// Its kind.
    pub kind: String,
    /// Its outline, m.
    pub radius_m: f64,
}

/// Why a recording could not be made or is not whole.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file could not be made.
    #[error("cannot create {path}: {reason}")]
    Create {
        /// Where.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The address is none of a viewer.
    #[error("`{url}` is no viewer's address, like rerun+http://127.0.0.1:9876/proxy: {reason}")]
    Address {
        /// What was given.
        url: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No viewer could be started.
    #[error("cannot start the Rerun viewer (`pip install rerun-sdk==0.36.3` brings one): {0}")]
    Spawn(String),
    /// A thread could not be started, or died.
    #[error("recorder thread: {0}")]
    Thread(String),
    /// Something could not be encoded or written; the file ends before it.
    #[error("recording {path} is not whole: {reason}")]
    Write {
        /// The file.
        path: PathBuf,
        /// What failed first.
        reason: String,
    },
}

/// What a finished recording holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordingStats {
    /// Size of the file, bytes.
    pub file_bytes: u64,
    /// Messages in it.
    pub messages: u64,
    /// Messages a viewer missed because it lagged.
    pub viewer_missed: u64,
    /// True when a viewer was fed and took all that was left at the end.
    pub viewer_caught_up: bool,
}

/// Streams a run to Rerun. Dropping it closes the file as well, but only [`RerunSink::finish`] tells of faults.
pub struct RerunSink(Option<Running>);

struct Running {
    path: PathBuf,
    queue: SyncSender<Message>,
    spare_pixels: Receiver<Vec<u8>>,
    recorder: JoinHandle<Result<(), String>>,
    file: RrdFile,
    live: Option<Live>,
    truth: Option<TruthProbe>,
    looks: Looks,
    last_look: Option<PlateTime>,
}

impl RerunSink {
    /// Refuses a mode with an address that is none, before anything is started.
    pub fn check(mode: &RerunMode) -> Result<(), RecordingError> {
        match mode {
            RerunMode::Connect { url: Some(url) } => parse_address(url.clone()).map(|_| ()),
            _ => Ok(()),
        }
    }

    /// Starts recording into `path`; with [`RerunMode::Off`] does nothing, now and later.
    pub fn start(
        mode: &RerunMode,
        path: &Path,
        context: RunContext,
        keeping: &Keeping,
    ) -> Result<Self, RecordingError> {
        if *mode == RerunMode::Off {
            return Ok(Self(None));
        }
        let (file, live) = open(mode, path)?;
        Self::into_writer(file, live, path, context, keeping)
    }

    /// Records into `out`, which is called `path` in errors.
    pub(super) fn into_writer(
        out: Box<dyn Write + Send>,
        live: Option<(Live, LiveQueue)>,
        path: &Path,
        context: RunContext,
        keeping: &Keeping,
    ) -> Result<Self, RecordingError> {
        let path = path.to_owned();
        let (live, live_queue) = live.unzip();
        let file =
            RrdFile::new(out, live_queue).map_err(|reason| RecordingError::Write { path: path.clone(), reason })?;
        let (queue, messages) = sync_channel(QUEUE);
        let (pixels_back, spare_pixels) = sync_channel(QUEUE);
        let truth = context.truth.clone();
        let looks = Looks::new(context.parts.len());
        let (stream_file, clock) = (file.clone(), keeping.clock);
        let recorder = thread::Builder::new()
            .name("recorder".into())
            .spawn(move || Recorder::start(stream_file, context)?.run(&messages, &pixels_back, &clock))
            .map_err(thread_fault)?;
        Ok(Self(Some(Running { path, queue, spare_pixels, recorder, file, live, truth, looks, last_look: None })))
    }

    /// Waits until everything is written and closes the file. `Err` with the first fault of the whole run.
    pub fn finish(mut self) -> Result<RecordingStats, RecordingError> {
        self.0.take().map_or(Ok(RecordingStats::default()), Running::close)
    }
}

impl Drop for RerunSink {
    fn drop(&mut self) {
        if let Some(running) = self.0.take() {
            running.close().ok();
        }
    }
}

impl Running {
    fn close(mut self) -> Result<RecordingStats, RecordingError> {
        self.send_looks();
        drop(self.queue);
        let recorded = match self.recorder.join() {
            Ok(recorded) => recorded,
            Err(_) => Err("recorder thread died".to_owned()),
        };
        close(&self.path, &self.file, self.live, recorded)
    }

    /// Waits when the recorder lags. A dead recorder is told of by `close`.
    fn send(&self, message: Message) {
        self.queue.send(message).ok();
    }

    fn send_looks(&mut self) {
        if !self.looks.is_empty() {
            let next = Looks::new(self.looks.parts());
            let looks = std::mem::replace(&mut self.looks, next);
            self.send(Message::Looks(looks));
        }
    }

    fn look(&mut self, facts: &FrameFacts<'_>) {
        let at = facts.frame.exposed_at;
        self.looks.tracked_in(facts.track_us);
        let due = self.last_look.is_none_or(|last| at.secs_since(last) >= 1.0 / LOOKS_HZ);
        if due || facts.starts_cycle {
            self.last_look = Some(at);
            let truth = self.truth.as_ref().map(TruthProbe::read);
            self.looks.push(at, facts.tracks, truth.as_ref());
        }
        let oldest = self.looks.at.first();
        if facts.starts_cycle || oldest.is_some_and(|&oldest| at.secs_since(oldest) >= GATHER_S) {
            self.send_looks();
        }
        if facts.starts_cycle {
            let mut pixels = self.spare_pixels.try_recv().unwrap_or_default();
            pixels.clone_from(&facts.frame.pixels);
            let Frame { width, height, index, exposed_at, .. } = *facts.frame;
            let frame = Frame { width, height, pixels, index, exposed_at };
            self.send(Message::Picture { frame, tracks: facts.tracks.to_vec() });
        }
    }
}

impl Sink for RerunSink {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        if let Some(running) = &mut self.0 {
            running.send(Message::Localised(Box::new(facts.into())));
        }
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        if let Some(running) = &mut self.0 {
            running.look(facts);
        }
    }

    fn pulse(&mut self, facts: &PulseFacts<'_>) {
        if let Some(running) = &mut self.0 {
            running.send(Message::Pulse(Box::new(facts.into())));
        }
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        if let Some(running) = &mut self.0 {
            running.send_looks();
            running.send(Message::Cycle(Box::new(facts.into())));
        }
    }

    fn event(&mut self, at: PlateTime, level: EventLevel, text: &str) {
        if let Some(running) = &mut self.0 {
            running.send(Message::Event(EventRecord { at, level, text: text.to_owned() }));
        }
    }
}

/// Makes a whole recording at once by `log`, into the file at `path` and to the viewer of `mode`. With
/// [`RerunMode::Off`] does nothing.
pub(super) fn record(
    mode: &RerunMode,
    path: &Path,
    log: impl FnOnce(RrdFile) -> Logged,
) -> Result<RecordingStats, RecordingError> {
    if *mode == RerunMode::Off {
        return Ok(RecordingStats::default());
    }
    let (out, live) = open(mode, path)?;
    let (live, queue) = live.unzip();
    let file = RrdFile::new(out, queue).map_err(|reason| RecordingError::Write { path: path.to_owned(), reason })?;
    let recorded = log(file.clone());
    close(path, &file, live, recorded)
}

/// Where a recording goes: a file, and with a viewer what feeds it.
type Destination = (Box<dyn Write + Send>, Option<(Live, LiveQueue)>);

/// Opens the file at `path` and the viewer of `mode`, if there is one.
fn open(mode: &RerunMode, path: &Path) -> Result<Destination, RecordingError> {
    let live = viewer_address(mode)?.map(Live::start).transpose().map_err(thread_fault)?;
    let file =
        File::create(path).map_err(|e| RecordingError::Create { path: path.to_owned(), reason: e.to_string() })?;
    Ok((Box::new(file), live))
}

/// Closes `file` and lets the viewer take what is left. `Err` with the first fault of writing it or of what was
/// `recorded`.
fn close(
    path: &Path,
    file: &RrdFile,
    live: Option<Live>,
    recorded: Result<(), String>,
) -> Result<RecordingStats, RecordingError> {
    let closed = file.close();
    let (viewer_missed, viewer_caught_up) = live.map_or((0, false), Live::finish);
    match (closed, recorded) {
        (Err(reason), _) | (_, Err(reason)) => Err(RecordingError::Write { path: path.to_owned(), reason }),
        (Ok((file_bytes, messages)), Ok(())) => {
            Ok(RecordingStats { file_bytes, messages, viewer_missed, viewer_caught_up })
        }
    }
}

fn thread_fault(fault: std::io::Error) -> RecordingError {
    RecordingError::Thread(fault.to_string())
}

/// Where the viewer of `mode` listens; starts it for [`RerunMode::Spawn`].
fn viewer_address(mode: &RerunMode) -> Result<Option<ProxyUri>, RecordingError> {
    let url = match mode {
        RerunMode::Off | RerunMode::Save => return Ok(None),
        RerunMode::Connect { url } => url.clone().unwrap_or_else(|| rerun::DEFAULT_CONNECT_URL.to_owned()),
        RerunMode::Spawn => {
            // the viewer's own default is to listen on every interface
            let extra_args = vec!["--bind".to_owned(), "127.0.0.1".to_owned()];
            let options = rerun::SpawnOptions { hide_welcome_screen: true, extra_args, ..Default::default() };
            let viewer = rerun::spawn(&options).map_err(|e| RecordingError::Spawn(first_line(&e.to_string())))?;
            format!("rerun+http://127.0.0.1:{}/proxy", viewer.port)
        }
    };
    parse_address(url).map(Some)
}

fn parse_address(url: String) -> Result<ProxyUri, RecordingError> {
    let address = url.parse::<ProxyUri>().map_err(|e| e.to_string());
    address.map_err(|reason| RecordingError::Address { url, reason })
}

/// Rerun's words for a missing viewer go on over a dozen lines, with the whole search path among them.
fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().trim_end().to_owned()
}
