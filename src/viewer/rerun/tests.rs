use std::collections::BTreeSet;
use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;

use re_sdk_types::archetypes::{Ellipses2D, Scalars, Transform3D};
use rerun::EntityPath;
use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};

use super::RerunSink;
use crate::{RecordingError, RunContext};
use upm_control::{CycleFacts, EventFacts, EventLevel, PulseFacts, Sink};
use upm_core::time::{MonotonicClock, PlateTime};
use upm_fixtures::{
    rig,
    synthetic_run::{self, SyntheticRun},
};
use upm_planning::planner::{PlannedPulse, PlanningMethod};
use upm_recording::{RecordingOptions, RerunMode};

pub(super) fn context(run: &SyntheticRun) -> RunContext {
    let part = |i| upm_core::job::LayoutPart {
        id: format!("penny-{}", i + 1),
        kind: "penny".to_owned(),
        radius_m: synthetic_run::RADIUS_M,
    };
    RunContext {
        name: "made-up".to_owned(),
        seed: 7,
        library: Arc::new(rig::library()),
        model: rig::model(),
        method: if run.plans_fields { PlanningMethod::SynthesizedField } else { PlanningMethod::CorSequence },
        parts: (0..run.parts_m.len()).map(part).collect(),
        bins: Vec::new(),
        paths: Vec::new(),
        truth: Some(run.truth.clone()),
    }
}

/// A sink that keeps pulses and events.
#[derive(Default)]
pub(super) struct SeenFacts {
    pub(super) pulses: Vec<PulseFacts>,
    pub(super) events: Vec<EventFacts>,
    pub(super) cycles: Vec<CycleFacts>,
}

impl Sink for SeenFacts {
    fn cycle(&mut self, facts: &CycleFacts) {
        self.cycles.push(facts.clone());
    }

    fn pulse(&mut self, facts: &PulseFacts) {
        self.pulses.push(facts.clone());
    }

    fn event(&mut self, event: &EventFacts) {
        self.events.push(event.clone());
    }
}

pub(super) fn recording_options() -> RecordingOptions {
    RecordingOptions::lossless(MonotonicClock::new())
}

fn record(mode: &RerunMode, path: &Path, cycles: usize) -> Result<bool, RecordingError> {
    record_run(SyntheticRun::new(2), mode, path, cycles)
}

fn record_run(mut run: SyntheticRun, mode: &RerunMode, path: &Path, cycles: usize) -> Result<bool, RecordingError> {
    run.wall_us = 180.0;
    let mut sink = RerunSink::start(mode, path, context(&run), &recording_options())?;
    run.localise(&mut sink);
    for _ in 0..cycles {
        run.cycle(&mut sink);
    }
    sink.event(&EventFacts::note(PlateTime::from_secs(0.5), EventLevel::Warning, "a warning in words"));
    sink.finish()
}

/// Chunks of a recording or of its blueprint.
pub(super) struct LoggedChunks {
    /// Name of the recording.
    pub id: String,
    chunks: Vec<Chunk>,
}

impl LoggedChunks {
    pub fn chunks(&self) -> impl Iterator<Item = &Chunk> {
        self.chunks.iter()
    }

    pub fn entities(&self) -> BTreeSet<&EntityPath> {
        self.chunks().map(|chunk| chunk.entity_path()).collect()
    }
}

/// The recording and the blueprint in the file at `path`.
pub(super) fn stores(path: &Path) -> (LoggedChunks, LoggedChunks) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let (mut recordings, mut blueprints) = (Vec::<LoggedChunks>::new(), Vec::new());
    for message in DecoderApp::decode_lazy(file) {
        match message.unwrap() {
            LogMsg::SetStoreInfo(store) => {
                let id = &store.info.store_id;
                let stores = if id.is_recording() { &mut recordings } else { &mut blueprints };
                let id = id.recording_id().to_string();
                if stores.iter().all(|store| store.id != id) {
                    stores.push(LoggedChunks { id, chunks: Vec::new() });
                }
            }
            LogMsg::ArrowMsg(id, message) => {
                let stores = if id.is_recording() { &mut recordings } else { &mut blueprints };
                stores[0].chunks.push(Chunk::from_arrow_msg(&message).unwrap());
            }
            LogMsg::BlueprintActivationCommand(_) => {}
        }
    }
    assert_eq!((recordings.len(), blueprints.len()), (1, 1));
    (recordings.remove(0), blueprints.remove(0))
}

#[test]
fn recording_has_every_expected_entity() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    record(&RerunMode::Save, &path, 4).unwrap();
    let (recording, blueprint) = stores(&path);
    let entities: BTreeSet<String> = recording.entities().iter().map(|path| path.to_string()).collect();
    for path in [
        "camera/image",
        "camera/names",
        "camera/parts",
        "camera/table",
        "camera/targets",
        "camera/trails",
        "table/outline",
        "table/library",
        "table/centers",
        "table/read_centers",
        "table/field",
        "table/measured",
        "table/true",
        "table/trails/measured",
        "table/trails/true",
        "table/wanted/steps",
        "table/wanted/subgoals",
        "table/wanted/targets",
        "plan/d_mm",
        "plan/total_mm",
        "plan/pulses",
        "motors",
        "accelerometers/1/measured",
        "accelerometers/1/fitted",
        "accelerometers/2/measured",
        "accelerometers/2/fitted",
        "errors/to_target_mm",
        "errors/to_subgoal_mm",
        "errors/of_prediction_mm",
        "errors/cross_track_mm",
        "errors/sensing_mm",
        "timing/track_us",
        "timing/plan_us",
        "timing/cycle_us",
        "log",
    ] {
        assert!(entities.contains(&format!("/{path}")), "{path} is not among {entities:#?}");
    }
    let chunks = recording.chunks();
    let timelines: BTreeSet<String> =
        chunks.flat_map(|chunk| chunk.timelines().keys().map(|t| t.to_string())).collect();
    assert_eq!(timelines, BTreeSet::from(["cycle".to_owned(), "plate_time".to_owned()]), "no wall clock");
    let properties = |name: &str| blueprint.entities().iter().filter(|p| p.to_string().ends_with(name)).count();
    assert_eq!(["VisualBounds2D", "VisibleTimeRanges", "TimeAxis"].map(properties), [3, 4, 9]);
}

#[test]
fn fields_are_shown_by_their_effect_on_the_parts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut fields = SyntheticRun::new(2);
    fields.plans_fields = true;
    record_run(fields, &RerunMode::Save, &path, 3).unwrap();
    let (recording, blueprint) = stores(&path);
    let chunks =
        |path: &str| recording.chunks().filter(|chunk| *chunk.entity_path() == path.into()).collect::<Vec<_>>();
    let arrows: usize = chunks("table/forecast").iter().map(|chunk| chunk.num_rows()).sum();
    assert_eq!(arrows, 3, "once a cycle");
    let logged =
        [("table/field", 3), ("plan/pulses", 3), ("plan/harmonics_mm_s", 3), ("plan/d_mm", 0), ("plan/total_mm", 0)];
    for (path, rows) in logged {
        let logged = chunks(path).into_iter().filter(|chunk| !chunk.is_static());
        assert_eq!(logged.map(|chunk| chunk.num_rows()).sum::<usize>(), rows, "{path}");
    }
    let shown: String = blueprint.chunks().map(|chunk| chunk.to_string()).collect();
    assert!(shown.contains("plan/harmonics_mm_s") && !shown.contains("plan/d_mm"), "the panel shows what there is");
}

#[test]
fn a_run_without_pauses_shows_speeds_and_planning_beside_the_segment() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let mut run = SyntheticRun::new(2);
    (run.plans_fields, run.wall_us) = (true, 180.0);
    let context = RunContext { method: PlanningMethod::MovingField, ..context(&run) };
    let mut memory = SeenFacts::default();
    let mut sink = RerunSink::start(&RerunMode::Save, &path, context, &recording_options()).unwrap();
    run.localise(&mut sink);
    (0..3).for_each(|_| run.cycle(&mut sink));
    run.ends_at_rest = false;
    run.cycle(&mut memory);
    sink.cycle(&memory.cycles[0]);
    sink.finish().unwrap();
    let PlannedPulse::Field(field) = &memory.pulses[0].planned else { panic!("{:?}", memory.pulses[0].planned) };
    let segment_us = std::f64::consts::TAU / field.wave.base_radps * 1e6;
    let (recording, blueprint) = stores(&path);
    let values = |path: &str| -> Vec<Vec<f64>> {
        let logged = recording.chunks().filter(|chunk| *chunk.entity_path() == path.into() && !chunk.is_static());
        logged
            .flat_map(|chunk| chunk.iter_slices::<f64>(Scalars::descriptor_scalars().component))
            .map(<[_]>::to_vec)
            .collect()
    };
    assert_eq!(values("timing/plan_us"), vec![vec![180.0, segment_us]; 4]);
    let rows = |path: &str| -> usize {
        let logged = recording.chunks().filter(|chunk| *chunk.entity_path() == path.into() && !chunk.is_static());
        logged.map(|chunk| chunk.num_rows()).sum()
    };
    assert_eq!(rows("table/measured"), rows("table/true") + 1, "places of a moving cycle are those of the journal");
    let speeds = values("motion/speed_mm_s");
    assert!(
        speeds.len() == 4 && speeds.iter().all(|parts| parts.len() == 2 && parts.iter().all(|v| *v > 1.0)),
        "{speeds:?}"
    );
    let shown: String = blueprint.chunks().map(|chunk| chunk.to_string()).collect();
    assert!(shown.contains("motion/speed_mm_s"));
}

#[test]
fn every_sample_and_every_frame_of_a_cycle_arrives() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    record(&RerunMode::Save, &path, 40).unwrap();
    let (recording, _) = stores(&path);
    let rows = |path: &str| -> u64 {
        let chunks = recording.chunks().filter(|chunk| !chunk.is_static());
        chunks.filter(|chunk| *chunk.entity_path() == path.into()).map(|chunk| chunk.num_rows() as u64).sum()
    };
    assert_eq!((rows("camera/image"), rows("plan/d_mm"), rows("errors/to_subgoal_mm")), (40, 40, 40));
    let mut memory = SeenFacts::default();
    let mut run = SyntheticRun::new(2);
    (0..40).for_each(|_| run.cycle(&mut memory));
    let samples = |drive: &upm_core::signal::Drive| (drive.envelope.driven_s() * 1000.0).ceil() as u64 + 1;
    assert_eq!(rows("motors"), memory.pulses.iter().map(|pulse| samples(&pulse.drive)).sum::<u64>());
}

#[test]
fn places_have_the_signs_of_the_journal_and_a_transform_turns_the_view_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let run = SyntheticRun::new(3);
    let at_mm: Vec<[f32; 2]> = run.parts_m.iter().map(|p_m| [p_m.x, p_m.y].map(|m| (1e3 * m) as f32)).collect();
    record_run(run, &RerunMode::Save, &path, 1).unwrap();
    let (recording, _) = stores(&path);
    let of = |path: &str, is_static: bool| {
        let mut chunks = recording.chunks();
        chunks.find(|chunk| *chunk.entity_path() == path.into() && chunk.is_static() == is_static).unwrap()
    };
    let centers = of("table/true", false).iter_slices::<[f32; 2]>(Ellipses2D::descriptor_centers().component);
    assert_eq!(centers.take(1).collect::<Vec<_>>(), [&at_mm[..]]);
    let scale = of("table", true).iter_slices::<[f32; 3]>(Transform3D::descriptor_scale().component);
    assert_eq!(scale.collect::<Vec<_>>(), [&[[1.0_f32, -1.0, 1.0]][..]]);
}

#[test]
fn recording_stays_small() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let size = |cycles| {
        record(&RerunMode::Save, &path, cycles).unwrap();
        path.metadata().unwrap().len()
    };
    let a_cycle = (size(45) - size(15)) / 30;
    assert!(a_cycle < 100_000, "300 cycles of {a_cycle} bytes are more than 30 MB");
}

#[test]
fn a_frozen_viewer_delays_nothing_and_the_file_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("rerun+http://{}/proxy", listener.local_addr().unwrap());
    let path = folder.path().join("live.rrd");
    assert!(!record(&RerunMode::Connect { url: Some(url) }, &path, 60).unwrap(), "the viewer took nothing");
    record(&RerunMode::Save, &folder.path().join("alone.rrd"), 60).unwrap();
    let rows = |path: &Path| stores(path).0.chunks().map(|chunk| chunk.num_rows()).sum::<usize>();
    assert_eq!(rows(&path), rows(&folder.path().join("alone.rrd")));
}

#[test]
fn unusable_path_and_address_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let nowhere = folder.path().join("missing").join("run.rrd");
    let fault = record(&RerunMode::Save, &nowhere, 1).unwrap_err().to_string();
    assert!(fault.starts_with("cannot create "), "{fault}");
    let bad = RerunMode::Connect { url: Some("gopher://x".to_owned()) };
    let fault = record(&bad, &folder.path().join("run.rrd"), 1).unwrap_err().to_string();
    assert!(fault.starts_with("`gopher://x` is not a viewer address"), "{fault}");
}

#[test]
fn off_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    assert!(!record(&RerunMode::Off, &path, 1).unwrap());
    assert!(!path.exists());
}
