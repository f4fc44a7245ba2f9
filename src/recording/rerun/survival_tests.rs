//! What a recording holds when nobody gets to close it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::thread;
use std::time::Duration;

use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};

use super::RerunSink;
use super::recorder::PLATE_TIME;
use super::tests::{context, keeping};
use crate::control::{EventLevel, Sink};
use crate::recording::RerunMode;
use crate::recording::testing::SyntheticRun;
use crate::time::{Clock, MonotonicClock};

/// The newest moment of every series in the file at `path`, which may still be written, s.
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

/// Runs `frame` 60 times a second for 2.5 s and reads the growing file at `path` all along. The age of the oldest of
/// these series in it, s: the middle one of all readings.
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
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut run = SyntheticRun::new(2);
    run.draw();
    let mut sink = RerunSink::start(&RerunMode::Save, &path, context(&run), &keeping()).unwrap();
    let age_s = age_in_file_s(&path, &["/log", "/errors/sensing_mm", "/table/measured"], || {
        run.look(&mut sink, false, true);
        sink.event(run.now(), EventLevel::Info, "a frame");
        run.now().secs()
    });
    assert!(age_s <= 0.5, "{age_s} s");
    sink.finish().unwrap();
}

#[test]
fn looks_do_not_wait_for_the_end_of_a_long_cycle() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut run = SyntheticRun::new(2);
    let mut sink = RerunSink::start(&RerunMode::Save, &path, context(&run), &keeping()).unwrap();
    let age_s = age_in_file_s(&path, &["/errors/sensing_mm", "/table/measured"], || {
        run.look(&mut sink, true, false);
        run.now().secs()
    });
    assert!(age_s <= 0.5, "{age_s} s");
    sink.finish().unwrap();
}
