//! Tests of recordings whose process never closes them.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufReader, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};

use super::RerunSink;
use super::run_stream::PLATE_TIME;
use super::tests::{SeenFacts, context, recording_options, stores};
use upm_control::{EventFacts, EventLevel, Sink};
use upm_core::background::OverflowPolicy;
use upm_core::time::{Clock, MonotonicClock};
use upm_fixtures::synthetic_run::SyntheticRun;
use upm_recording::{Fanout, RecordingOptions, RecordingState, RerunMode, report_recording_end};

/// A folder, and the path of the recording in it.
fn place() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    (folder, path)
}

/// The newest time of every series in the file at `path`, which may still be written, s.
fn newest_s(path: &Path) -> BTreeMap<String, f64> {
    let mut newest = BTreeMap::new();
    for message in DecoderApp::decode_lazy(BufReader::new(File::open(path).unwrap())) {
        if let LogMsg::ArrowMsg(_, message) = message.unwrap() {
            let chunk = Chunk::from_arrow_msg(&message).unwrap();
            for times in chunk.timelines().values().filter(|times| times.name() == PLATE_TIME) {
                let series: &mut f64 = newest.entry(chunk.entity_path().to_string()).or_default();
                *series = series.max(times.time_range().max().as_i64() as f64 * 1e-9);
            }
        }
    }
    newest
}

/// Runs `frame` 60 times a second for 2.5 s and reads the growing file at `path` meanwhile. Returns the age of the
/// oldest of these series in it, s: the median of all readings.
fn age_in_file_s(path: &Path, series: &[&str], mut frame: impl FnMut() -> f64) -> f64 {
    let clock = MonotonicClock::new();
    let mut ages_s = Vec::new();
    for i in 0..150 {
        thread::sleep(Duration::from_secs_f64(f64::from(i) / 60.0).saturating_sub(clock.elapsed()));
        let now_s = frame();
        if i >= 60 && i % 10 == 0 {
            let newest = newest_s(path);
            let age_s = |name: &&str| now_s - newest.get(*name).copied().unwrap_or(f64::NEG_INFINITY);
            ages_s.push(series.iter().map(age_s).fold(0.0, f64::max));
        }
    }
    ages_s.sort_by(f64::total_cmp);
    ages_s[ages_s.len() / 2]
}

#[test]
fn images_at_60_hz_keep_no_other_series_out_of_the_file() {
    let (_folder, path) = place();
    let mut run = SyntheticRun::new(2);
    run.snow();
    let mut sink = RerunSink::start(&RerunMode::Save, &path, context(&run), &recording_options()).unwrap();
    // so large that Rerun sends them at once and defers everything else
    let age_s = age_in_file_s(&path, &["/log", "/errors/sensing_mm", "/table/measured"], || {
        run.observe(&mut sink, false, true);
        sink.event(&EventFacts::note(run.now, EventLevel::Info, "a frame"));
        run.now.secs()
    });
    assert!(age_s <= 0.5, "{age_s} s");
    sink.finish().unwrap();
}

#[test]
fn cut_recording_is_read_up_to_the_cut() {
    let (_folder, path) = place();
    let (mut run, recording_options) = (SyntheticRun::new(2), recording_options());
    let mut sink = RerunSink::start(&RerunMode::Save, &path, context(&run), &recording_options).unwrap();
    run.cycle(&mut sink);
    assert!(matches!(recording_options.recording.state(), RecordingState::Writing { bytes } if bytes > 0));
    sink.finish().unwrap();
    assert_eq!(path.metadata().unwrap().len(), recording_options.recording.bytes());
    assert_eq!(
        (recording_options.recording.state(), recording_options.recording.ended_early()),
        (RecordingState::Whole, None)
    );
    let bytes = fs::read(path).unwrap();
    let messages = |cut: usize| DecoderApp::decode_lazy(&bytes[..cut]).map_while(Result::ok).count();
    let mut before = 0;
    for cut in (100..bytes.len()).step_by(bytes.len() / 50).chain([bytes.len()]) {
        let found = messages(cut);
        assert!(found >= before, "{found} messages in {cut} bytes, {before} in less");
        before = found;
    }
    assert!((1..before).contains(&messages(bytes.len() / 2)), "{}", messages(bytes.len() / 2));
}

/// Plays cycles until `done`, and reports the recording as a run does.
fn cycles_until(
    run: &mut SyntheticRun,
    sink: &mut RerunSink,
    recording_options: &RecordingOptions,
    done: RecordingState,
) -> SeenFacts {
    let mut seen = SeenFacts::default();
    let mut report_end = |sinks: &mut dyn Sink, at| report_recording_end(&recording_options.recording, sinks, at);
    let mut sinks = Fanout { sinks: vec![&mut seen, sink], after_frame: Some(&mut report_end) };
    for _ in 0..400 {
        run.cycle(&mut sinks);
        if recording_options.recording.state() == done {
            run.cycle(&mut sinks);
            break;
        }
    }
    assert_eq!(recording_options.recording.state(), done);
    seen
}

#[test]
fn a_write_that_fails_is_reported_at_once_and_the_file_stays() {
    struct Full(File, usize);
    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let fits = bytes.len().min(self.1);
            if fits == 0 {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.1 -= fits;
            self.0.write(&bytes[..fits])
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let (_folder, path) = place();
    let (mut run, recording_options) = (SyntheticRun::new(2), recording_options());
    let out = Box::new(Full(File::create(&path).unwrap(), 200_000));
    let mut sink = RerunSink::into_file(out, &path, None, context(&run), &recording_options).unwrap();
    let failed = RecordingState::Failed("Failed to write: no storage space".into());
    let seen = cycles_until(&mut run, &mut sink, &recording_options, failed.clone());
    let events: Vec<_> = seen.events.iter().map(|event| (event.level, event.text.as_str())).collect();
    assert_eq!(events, [(EventLevel::Warning, "the recording ends early: Failed to write: no storage space")]);
    assert!(sink.finish().unwrap_err().to_string().starts_with(&format!("recording {} is not", path.display())));
    assert_eq!(recording_options.recording.state(), failed);
    assert_eq!(path.metadata().unwrap().len(), 200_000, "no footer behind half a message");
}

/// A file on a disk that hangs while the mutex is held.
struct HangingFile(File, Arc<Mutex<()>>);

impl Write for HangingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        drop(self.1.lock().unwrap());
        self.0.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_disk_that_hangs_ends_the_recording_and_not_the_run() {
    let (_folder, path) = place();
    let (mut run, gate) = (SyntheticRun::new(2), Arc::new(Mutex::new(())));
    let recording_options = RecordingOptions { recording_overflow: OverflowPolicy::GiveUp, ..recording_options() };
    let out = Box::new(HangingFile(File::create(&path).unwrap(), Arc::clone(&gate)));
    let mut sink = RerunSink::into_file(out, &path, None, context(&run), &recording_options).unwrap();
    run.draw();
    let hanging = gate.lock().unwrap();
    let lagging = RecordingState::Failed("the recorder lags".into());
    let frames = (1..=5000).find(|_| {
        run.observe(&mut sink, false, true);
        recording_options.recording.state() == lagging
    });
    assert!(frames.is_some(), "{:?}", recording_options.recording.state());
    drop(hanging);
    assert!(sink.finish().unwrap_err().to_string().ends_with("is not whole: the recorder lags"));
    assert_eq!(recording_options.recording.state(), lagging);
    let (recording, _) = stores(&path);
    let logged: String = recording.chunks().map(|chunk| chunk.to_string()).collect();
    assert!(logged.contains("the recorder lags"), "what was taken is there, and why no more");
}
