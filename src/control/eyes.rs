use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::conditions::{Condition, Conditions};
use super::ending::{Ending, check_stop};
use super::{FrameFacts, LocalisedFacts, Sink};
use upm_core::geometry::Vec2;
use upm_core::rig::{PartKind, Rig, RigModel};
use upm_core::signal::Frame;
use upm_core::time::{Clock, PlateTime};
use upm_perception::vision::{CoinFinder, Detection, Stages, Table, TableFault, Tracker, locate_table_in_stages};

/// Looks at an empty-handed rig before the table counts as missing.
const TABLE_LOOKS: usize = 5;

/// What a frame is taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// To follow the parts while a pulse sounds.
    Pulse,
    /// To start the next cycle from, as soon as everything rests.
    Cycle,
}

/// A part the job says is on the plate.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpectedPart {
    /// Name for people: `penny-1`.
    pub id: String,
    /// Index into the kinds.
    pub kind: usize,
    /// Where the job says it lies, m; `None` when it may lie anywhere.
    pub expected_m: Option<Vec2>,
}

/// The camera's frames turned into part positions: the table once, then every part in every frame.
pub struct Eyes {
    frame: Frame,
    tracker: Tracker,
    half_exposure_s: f64,
}

impl Eyes {
    /// Captures frames until the table is found, finds the parts and names them.
    pub fn open(
        rig: &mut dyn Rig,
        model: &RigModel,
        kinds: &[PartKind],
        parts: &[ExpectedPart],
        sink: &mut dyn Sink,
        clock: &dyn Clock,
        stop: &AtomicBool,
    ) -> Result<Self, Ending> {
        let [width, height] = model.frame_size_px;
        let mut frame = Frame::new(width, height);
        let (table, mut stages, started) = find_table(rig, model, &mut frame, sink, clock, stop)?;
        let mut finder = CoinFinder::new(&table, model.frame_size_px, kinds, model.dark_parts);
        let found = finder.find(&frame);
        stages.disk_response = finder.response();
        let detections = name_parts(found, kinds, parts)?;
        let localise_us = (clock.elapsed() - started).as_secs_f64() * 1e6;
        sink.localised(&LocalisedFacts {
            frame: &frame,
            table: &table,
            detections: &detections,
            stages: &stages,
            localise_us,
        });
        let tracker = Tracker::new(&table, model.frame_size_px, kinds, model.dark_parts, detections);
        Ok(Self { frame, tracker, half_exposure_s: 0.5 * model.exposure_s })
    }

    /// Captures the next frame and tracks every part in it. Returns true when it was taken at rest.
    pub fn look(
        &mut self,
        rig: &mut dyn Rig,
        moment: Moment,
        sink: &mut dyn Sink,
        clock: &dyn Clock,
    ) -> Result<bool, Ending> {
        rig.capture(&mut self.frame)?;
        let at_rest = self.frame.exposed_at - rig.quiet_at() >= self.half_exposure_s;
        let start = clock.elapsed();
        self.tracker.track(&self.frame);
        let track_us = (clock.elapsed() - start).as_secs_f64() * 1e6;
        sink.frame(&FrameFacts {
            frame: &self.frame,
            tracks: self.tracker.tracks(),
            sounding: !at_rest,
            starts_cycle: at_rest && moment == Moment::Cycle,
            track_us,
        });
        Ok(at_rest)
    }

    /// Where the parts were last seen, m, in the order of the job.
    pub fn positions_m(&self) -> Vec<Vec2> {
        self.tracker.tracks().iter().map(|track| track.seen.position_m).collect()
    }

    /// The parts that the newest frame does not show.
    pub fn unseen(&self) -> Vec<usize> {
        let tracks = self.tracker.tracks().iter().enumerate();
        tracks.filter(|(_, track)| track.frames_unseen > 0).map(|(part, _)| part).collect()
    }

    /// Frames for which the longest missing part has been missing; 0 when the newest frame shows all.
    pub fn missing_for(&self) -> u32 {
        self.tracker.tracks().iter().map(|track| track.frames_unseen).max().unwrap_or(0)
    }

    /// When the newest frame was exposed.
    pub fn seen_at(&self) -> PlateTime {
        self.frame.exposed_at
    }
}

fn find_table(
    rig: &mut dyn Rig,
    model: &RigModel,
    frame: &mut Frame,
    sink: &mut dyn Sink,
    clock: &dyn Clock,
    stop: &AtomicBool,
) -> Result<(Table, Stages, Duration), Ending> {
    let mut last: Option<TableFault> = None;
    let mut stages = Stages::default();
    let mut conditions = Conditions::default();
    for _ in 0..TABLE_LOOKS {
        check_stop(stop)?;
        rig.capture(frame)?;
        let started = clock.elapsed();
        match locate_table_in_stages(frame, &model.lens, model.plate_side_m, &mut stages) {
            Ok(table) => {
                conditions.end_run(frame.exposed_at, sink);
                return Ok((table, stages, started));
            }
            Err(fault) => {
                let reason = || format!("no table in the camera's frames: {fault}");
                conditions.note(frame.exposed_at, Condition::TableMissing, reason, sink);
                last = Some(fault);
            }
        }
        conditions.end_cycle(frame.exposed_at, sink);
    }
    let why = last.map_or_else(String::new, |fault| format!(": {fault}"));
    Err(Ending::failed(format!("no table found in {TABLE_LOOKS} frames{why}")))
}

/// Gives each part of the job its detection: those with a known place take the nearest of their kind, the others
/// what is left from left to right.
fn name_parts(mut found: Vec<Detection>, kinds: &[PartKind], parts: &[ExpectedPart]) -> Result<Vec<Detection>, Ending> {
    count_parts(&found, kinds, parts)?;
    found.sort_by(|a, b| a.position_m.x.total_cmp(&b.position_m.x).then(a.position_m.y.total_cmp(&b.position_m.y)));
    let mut named: Vec<Option<Detection>> = vec![None; parts.len()];
    let by_certainty = (0..parts.len()).filter(|&i| parts[i].expected_m.is_some());
    let rest = (0..parts.len()).filter(|&i| parts[i].expected_m.is_none());
    for i in by_certainty.chain(rest) {
        let part = &parts[i];
        let same_kind = found.iter().enumerate().filter(|(_, detection)| detection.kind == part.kind);
        let choice = match part.expected_m {
            Some(place) => same_kind
                .min_by(|(_, a), (_, b)| {
                    (a.position_m - place).norm_squared().total_cmp(&(b.position_m - place).norm_squared())
                })
                .map(|(at, _)| at),
            None => same_kind.map(|(at, _)| at).next(),
        };
        named[i] = choice.map(|at| found.remove(at));
    }
    named.into_iter().collect::<Option<Vec<_>>>().ok_or_else(|| Ending::failed("a part of the job was not found"))
}

fn count_parts(found: &[Detection], kinds: &[PartKind], parts: &[ExpectedPart]) -> Result<(), Ending> {
    for (kind, spec) in kinds.iter().enumerate() {
        let seen = found.iter().filter(|detection| detection.kind == kind).count();
        let expected = parts.iter().filter(|part| part.kind == kind).count();
        if seen != expected {
            return Err(Ending::failed(format!(
                "the camera sees {seen} of kind {:?}, the job has {expected}",
                spec.name
            )));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn detection(kind: usize, x: f64, y: f64) -> Detection {
        Detection {
            kind,
            center_px: Vec2::zeros(),
            radius_px: 40.0,
            position_m: Vec2::new(x, y),
            score: 1.0,
            covariance_px2: nalgebra::Matrix2::from_diagonal_element(1e-4),
        }
    }

    fn part(kind: usize, expected_m: Option<Vec2>) -> ExpectedPart {
        ExpectedPart { id: String::new(), kind, expected_m }
    }

    fn kinds() -> Vec<PartKind> {
        ["penny", "quarter"].map(|name| PartKind { name: name.into(), radius_m: 0.01, thickness_m: 0.0015 }).to_vec()
    }

    #[test]
    fn known_places_are_served_before_the_rest() {
        let found = vec![detection(0, 0.02, 0.0), detection(1, 0.0, 0.0), detection(0, -0.02, 0.0)];
        let parts = [part(0, None), part(0, Some(Vec2::new(-0.019, 0.0))), part(1, None)];
        let named = name_parts(found, &kinds(), &parts).unwrap();
        let x: Vec<f64> = named.iter().map(|d| d.position_m.x).collect();
        assert_eq!(x, [0.02, -0.02, 0.0]);
    }

    #[test]
    fn a_wrong_count_is_an_ending_in_words() {
        let ending = name_parts(vec![detection(0, 0.0, 0.0)], &kinds(), &[part(0, None), part(0, None)]).unwrap_err();
        assert_eq!(ending.reason, "the camera sees 1 of kind \"penny\", the job has 2");
    }
}
