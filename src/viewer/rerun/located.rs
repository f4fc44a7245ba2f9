//! A recording of a single picture with its detections, on the page that shows the first frame of a run.

use std::path::Path;

use super::blueprint::{self, ViewLayout};
use super::file::RrdFile;
use super::run_stream::{LogResult, RunStream};
use super::sink::record;
use super::vision;
use crate::types::{RecordingError, RecordingStats};
use upm_recording::LocalisedRecord;
use upm_recording::RerunMode;

/// Records the findings `found` in a picture, with the names of the parts' `kinds`, into the file at `path` and to the
/// viewer of `mode`; `title` names the recording. Does nothing with [`RerunMode::Off`].
pub fn record_located(
    mode: &RerunMode,
    path: &Path,
    title: &str,
    found: &LocalisedRecord,
    kinds: &[&str],
) -> Result<RecordingStats, RecordingError> {
    record(mode, path, |file| log(file, title, found, kinds))
}

fn log(file: RrdFile, title: &str, found: &LocalisedRecord, kinds: &[&str]) -> LogResult {
    let stream = RunStream::start(file, title.to_owned(), |stream| {
        let mut layout = ViewLayout::default();
        let page = blueprint::vision(&mut layout, [found.frame.width, found.frame.height]);
        layout.send(stream, vec![page])
    })?;
    stream.at(found.frame.exposed_at, 0);
    vision::log(&stream, found, (kinds, kinds))?;
    stream.flush()
}

#[cfg(test)]
mod tests {
    use super::super::task_tests::{logged, text_of};
    use super::super::tests::stores;
    use super::*;
    use upm_chart::{Ground, Palette};
    use upm_fixtures::synthetic_run::SyntheticRun;
    use upm_recording::MemorySink;

    #[test]
    fn a_picture_is_recorded_as_the_first_frame_of_a_run() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.rrd");
        let mut seen = MemorySink::default();
        SyntheticRun::new(2).localise(&mut seen);
        let found = seen.localised.remove(0);
        let stats = record_located(&RerunMode::Save, &path, "made up", &found, &["penny"]).unwrap();
        assert_eq!(stats.file_bytes, path.metadata().unwrap().len());
        let (recording, blueprint) = stores(&path);
        let entities: Vec<String> = recording.entities().iter().map(ToString::to_string).collect();
        for path in ["frame/image", "frame/table", "frame/parts", "edges/map", "hough/votes", "disk_response/map"] {
            assert!(entities.contains(&format!("/vision/{path}")), "{path} is not among {entities:#?}");
        }
        let bounded = blueprint.entities().into_iter().filter(|path| path.to_string().ends_with("VisualBounds2D"));
        assert_eq!(bounded.count(), 3);
        assert!(record_located(&RerunMode::Off, &folder.path().join("off.rrd"), "", &found, &[]).is_ok());
        assert!(!folder.path().join("off.rrd").exists());
    }

    #[test]
    fn kinds_that_differ_only_after_a_dash_have_different_colours() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.rrd");
        let mut seen = MemorySink::default();
        SyntheticRun::new(2).localise(&mut seen);
        let kinds = ["washer-m6", "washer-m8"];
        record_located(&RerunMode::Save, &path, "made up", &seen.localised.remove(0), &kinds).unwrap();
        let names = logged(&stores(&path).0, "vision/frame/names");
        let palette = Palette::of(&kinds, Ground::Dark);
        for kind in kinds {
            assert!(
                names.contains(kind) && names.contains(&text_of(palette.parts()[usize::from(kind == kinds[1])])),
                "{names}"
            );
        }
    }
}
