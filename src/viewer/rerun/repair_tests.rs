use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use proptest::prelude::*;
use rerun::external::re_log_encoding::{Decodable, DecoderApp, MessageHeader, MessageKind, StreamHeader};
use rerun::log::LogMsg;

use super::tests::{context, recording_options, stores};
use super::{RerunSink, repair_recording};
use crate::RecordingError;
use upm_core::job::RecordingRepair;
use upm_fixtures::synthetic_run::SyntheticRun;
use upm_recording::RerunMode;

/// A recording of two cycles, and the end of each of its messages, bytes.
fn recording() -> &'static (Vec<u8>, Vec<usize>) {
    static RECORDING: OnceLock<(Vec<u8>, Vec<usize>)> = OnceLock::new();
    RECORDING.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.rrd");
        let mut run = SyntheticRun::new(2);
        let mut sink = RerunSink::start(&RerunMode::Save, &path, None, context(&run), &recording_options()).unwrap();
        (0..2).for_each(|_| run.cycle(&mut sink));
        sink.finish().unwrap();
        let bytes = fs::read(path).unwrap();
        let (mut at, mut ends) = (StreamHeader::ENCODED_SIZE_BYTES, Vec::new());
        loop {
            let header = &bytes[at..at + MessageHeader::ENCODED_SIZE_BYTES];
            let header = MessageHeader::from_rrd_bytes(header).unwrap();
            if header.kind == MessageKind::End {
                return (bytes, ends);
            }
            at += MessageHeader::ENCODED_SIZE_BYTES + header.len as usize;
            ends.push(at);
        }
    })
}

fn messages(path: &Path) -> Vec<LogMsg> {
    let messages = DecoderApp::decode_lazy(BufReader::new(File::open(path).unwrap()));
    messages.map(Result::unwrap).collect()
}

/// Repairs `bytes`: the folder, the path and the result.
fn repaired(bytes: &[u8]) -> (tempfile::TempDir, PathBuf, Result<RecordingRepair, RecordingError>) {
    let folder = tempfile::tempdir().unwrap();
    let (part, path) = (folder.path().join("run.rrd.part"), folder.path().join("run.rrd"));
    fs::write(&part, bytes).unwrap();
    let done = repair_recording(&part, &path);
    (folder, path, done)
}

/// Number of complete messages in the first `cut` bytes, and their end, bytes.
fn whole_up_to(cut: usize) -> (u64, usize) {
    let ends = recording().1.iter().take_while(|&&end| end <= cut);
    let end = recording().1.iter().rev().find(|&&end| end <= cut);
    (
        ends.count() as u64,
        end.copied().unwrap_or(if cut < StreamHeader::ENCODED_SIZE_BYTES {
            0
        } else {
            StreamHeader::ENCODED_SIZE_BYTES
        }),
    )
}

#[test]
fn cut_anywhere_a_recording_opens_again_with_every_whole_message() {
    let (bytes, ends) = recording();
    assert!(ends.len() > 20, "{} messages", ends.len());
    let cuts = (0..bytes.len()).step_by(9973).chain(0..20).chain(bytes.len() - 40..bytes.len());
    for cut in cuts.chain(ends.iter().flat_map(|&end| [end - 1, end, end + 1])) {
        let (_folder, path, done) = repaired(&bytes[..cut]);
        let (messages, end) = whole_up_to(cut);
        let expected = RecordingRepair { messages, cut_bytes: (cut - end) as u64, was_whole: false };
        assert_eq!(done.unwrap(), expected, "cut at {cut}");
        let left: Vec<_> = fs::read_dir(path.parent().unwrap()).unwrap().map(|entry| entry.unwrap().path()).collect();
        assert_eq!(left, std::slice::from_ref(&path), "nothing else is left");
        // complete now: its footer is in the right place
        let again = repair_recording(&path, &path).unwrap();
        assert_eq!(again, RecordingRepair { messages, cut_bytes: 0, was_whole: true }, "cut at {cut}");
    }
}

#[test]
fn whole_messages_survive_a_repair_unchanged() {
    let (bytes, ends) = recording();
    let (_folder, whole, _) = repaired(bytes);
    let before = messages(&whole);
    let (_folder, path, _) = repaired(&bytes[..ends[ends.len() - 3] + 5]);
    let after = messages(&path);
    assert_eq!(after.len() + 2, before.len());
    assert!(before.iter().zip(&after).all(|(a, b)| a == b));
    stores(&path);
}

#[test]
fn a_whole_recording_is_only_renamed() {
    let (bytes, ends) = recording();
    let (_folder, path, done) = repaired(bytes);
    assert_eq!(done.unwrap(), RecordingRepair { messages: ends.len() as u64, cut_bytes: 0, was_whole: true });
    assert_eq!(&fs::read(path).unwrap(), bytes);
}

#[test]
fn non_recording_and_open_recording_are_left_untouched() {
    let (folder, path, done) = repaired(b"{\"a\": \"journal, that is\"}");
    assert!(matches!(done, Err(RecordingError::Repair { .. })));
    assert!(!path.exists() && folder.path().join("run.rrd.part").exists());

    let mut run = SyntheticRun::new(2);
    let mut sink = RerunSink::start(&RerunMode::Save, &path, None, context(&run), &recording_options()).unwrap();
    run.cycle(&mut sink);
    let refused = repair_recording(&folder.path().join("run.rrd.part"), &path).unwrap_err();
    assert!(refused.to_string().ends_with("another process is writing it"), "{refused}");
    sink.finish().unwrap();
    assert!(path.exists());
}

#[test]
#[cfg(target_os = "linux")]
fn partial_file_that_is_not_regular_is_refused_at_once() {
    use std::os::unix::fs::symlink;
    use std::sync::mpsc::sync_channel;
    use std::time::Duration;

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    let (bytes, ends) = recording();
    let cut = &bytes[..ends[3]];
    let fifo = |path: &Path| mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    for name in ["run.rrd.part", "run.rrd.repair", "link"] {
        let folder = tempfile::tempdir().unwrap();
        let [part, path, elsewhere] = ["run.rrd.part", "run.rrd", "elsewhere"].map(|name| folder.path().join(name));
        fs::write(&elsewhere, cut).unwrap();
        match name {
            "run.rrd.part" => fifo(&part),
            "link" => symlink(&elsewhere, &part).unwrap(),
            repair => {
                fs::write(&part, cut).unwrap();
                fifo(&folder.path().join(repair));
            }
        }
        let (sender, done) = sync_channel(1);
        let args = (part.clone(), path.clone());
        std::thread::spawn(move || sender.send(repair_recording(&args.0, &args.1)).unwrap());
        let refused = done.recv_timeout(Duration::from_secs(60)).unwrap().unwrap_err();
        assert!(refused.to_string().ends_with("expected a regular file, found something else"), "{name}: {refused}");
        assert!(fs::symlink_metadata(&part).is_ok() && !path.exists(), "{name}: it stays as it is");
        assert_eq!(fs::read(&elsewhere).unwrap(), cut);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn garbage_behind_a_cut_is_cut_off(
        cut in 0.0..1.0f64, garbage in prop::collection::vec(any::<u8>(), 20..300), zeros in any::<bool>(),
    ) {
        let (bytes, ends) = recording();
        // after the first message, so that it remains a recording; inside a message or just after one
        let cut = ends[0] + ((ends[ends.len() - 1] - ends[0]) as f64 * cut) as usize;
        let garbage = if zeros { vec![0; garbage.len()] } else { garbage };
        let (messages, end) = whole_up_to(cut);
        let file = [&bytes[..cut], &garbage].concat();
        let (_folder, path, done) = repaired(&file);
        let done = done.unwrap();
        prop_assert!(!done.was_whole && done.messages >= messages, "{done:?}");
        prop_assert!(done.cut_bytes <= (file.len() - end) as u64);
        prop_assert_eq!(repair_recording(&path, &path).unwrap().messages, done.messages);
    }

    #[test]
    fn broken_bytes_inside_a_recording_never_do_harm(at in 0.0..1.0f64, garbage in prop::collection::vec(any::<u8>(), 1..40)) {
        let (bytes, ends) = recording();
        let mut bytes = bytes.clone();
        let at = ends[0] + ((bytes.len() - garbage.len() - ends[0]) as f64 * at) as usize;
        bytes[at..at + garbage.len()].copy_from_slice(&garbage);
        let whole_before = whole_up_to(at).0;
        let (_folder, path, done) = repaired(&bytes);
        let done = done.unwrap();
        prop_assert!(done.messages >= whole_before);
        prop_assert!(done.was_whole || repair_recording(&path, &path).unwrap().was_whole);
    }
}
