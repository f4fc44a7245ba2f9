mod first_observation;
mod missing;
mod motion;
mod naming;
mod relocate;
mod scene;
mod settling;

use self::first_observation::find_table;
use self::missing::MissingParts;
use self::naming::name_parts;
use self::scene::{SceneMonitor, longest_s};
use self::settling::{Displacement, PlateInImage, SwingOut};
use super::findings::Findings;
use super::guards::{DelayGuard, Guards, Unusable};
use super::run_end::{OrEnd, RunEnd};
use super::{FrameFacts, LocalisedFacts, RunIo, Sink};
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_core::rig::{PartKind, Rig, RigModel};
use upm_core::signal::Frame;
use upm_core::time::PlateTime;
use upm_perception::vision::{CoinFinder, Table, TableMotion, Track, Tracker};

pub use self::naming::ExpectedPart;

/// Number of observations at rest without the table, once it was found, before it counts as missing.
const TABLE_OBSERVATIONS: usize = 5;
/// Number of frames without sight after which the motors are silenced and the condition is reported, and the limit for
/// that time where frames are slow, s.
const BLIND_FRAMES: f64 = 3.0;
const BLIND_S: f64 = 0.1;
/// Number of consecutive observations at rest that must show a foreign object.
const FOREIGN: u32 = 2;
/// Distance beyond the edge from which on a part's centre is off the plate, m: more than the plate's swing.
const EDGE_M: f64 = 1e-3;

/// Tolerance for a part's place, m, independent of its displacement.
const REACH_M: f64 = 3e-3;

/// Use of a frame: within a pulse, or as the start of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FramePurpose {
    /// To track the parts during a pulse.
    Pulse,
    /// To start the next cycle as soon as everything is at rest.
    Cycle,
    /// To start a cycle that does not wait for rest.
    Segment,
    /// To watch a plate that moves without pauses.
    Moving,
}

/// Turns the camera's frames into part positions: locates the table once, tracks every part in every frame, and checks
/// both.
pub struct Perception {
    frame: Frame,
    pub(crate) table: Table,
    tracker: Tracker,
    scene: SceneMonitor,
    guards: Guards,
    model: RigModel,
    /// Time since which nothing can be seen, and the first finding.
    blind: Option<(PlateTime, Finding)>,
    /// True when the last pulse was silenced because the view, or a part, was lost.
    pub(crate) motors_stopped: bool,
    swing_out: SwingOut,
    displaced: Displacement,
    /// Number of consecutive observations at rest that show a foreign object.
    foreign: u32,
    missing: MissingParts,
    observed_at: PlateTime,
    /// True when the table was located anew since the last pulse began: its frames are no evidence about that pulse.
    pub(crate) relocated: bool,
    /// Expected place of each part when it is next seen at rest, and the tolerance, m.
    expected_m: Vec<(Vec2, f64)>,
    pub(crate) delay: DelayGuard,
    pub(crate) findings: Findings,
}

impl Perception {
    /// Captures frames until the table is found, waiting while a hand or darkness may hide it, then finds the parts and
    /// names them.
    pub fn open(io: &mut RunIo<'_>, kinds: &[PartKind], parts: &[ExpectedPart], guards: Guards) -> OrEnd<Self> {
        let model = io.model;
        let [width, height] = model.frame_size_px;
        let mut frame = Frame::new(width, height);
        let (table, started) = find_table(io, &mut frame, &guards)?;
        let mut finder = CoinFinder::new(&table, model.frame_size_px, kinds, model.dark_parts);
        let found = finder.find(&frame);
        let detections = name_parts(found, kinds, parts, guards.has(Finding::PartCount))?;
        let localise_us = (io.clock.elapsed() - started).as_secs_f64() * 1e6;
        io.sink.localised(&LocalisedFacts { frame: &frame, table: &table, detections: &detections, localise_us });
        let expected_m = detections.iter().map(|detection| (detection.position_m, REACH_M)).collect();
        let scene = SceneMonitor::new(&table, model, kinds, &frame, io.rig.now());
        let tracker = Tracker::new(&table, model.frame_size_px, kinds, model.dark_parts, detections);
        Ok(Self {
            frame,
            table,
            tracker,
            scene,
            guards,
            model: model.clone(),
            blind: None,
            motors_stopped: false,
            swing_out: SwingOut::default(),
            displaced: Displacement::default(),
            foreign: 0,
            missing: MissingParts::default(),
            observed_at: PlateTime::default(),
            relocated: false,
            expected_m,
            delay: DelayGuard::new(model.frame_hz, f64::INFINITY),
            findings: Findings::default(),
        })
    }

    /// Captures the next frame and tracks every part in it. Returns true when it was taken at rest and is reliable: it
    /// is of the present, nothing hides the plate, and the plate is where it was.
    ///
    /// # Errors
    /// The ending of a run whose view stays lost.
    pub fn observe(&mut self, io: &mut RunIo<'_>, purpose: FramePurpose) -> OrEnd<bool> {
        let _span = tracing::trace_span!("observe").entered();
        io.rig.capture(&mut self.frame)?;
        let motion = self.scene.table_motion(&self.frame);
        let swing_px = self.swing_px(motion);
        self.swing_out.observe(self.frame.exposed_at, motion.swing_px());
        let at_rest =
            self.frame.exposed_at - io.rig.settled_at().max(self.swing_out.from) >= 0.5 * self.model.exposure_s;
        let start = io.clock.elapsed();
        let stale = self.stale(io.rig.now(), motion.corner_px());
        if stale.is_some() {
            self.tracker.miss();
        } else {
            self.tracker.track(&self.frame);
        }
        let (blind, place) = match stale {
            Some(blind) => (Some(blind), PlateInImage::Unknown),
            None if at_rest => self.examine(),
            None => {
                let watches_plate = matches!(purpose, FramePurpose::Segment | FramePurpose::Moving);
                (self.covered(swing_px.filter(|_| watches_plate)), PlateInImage::Unknown)
            }
        };
        let is_blind = blind.is_some();
        let swing_px = swing_px.filter(|_| !is_blind);
        let is_astray = !is_blind && swing_px.is_none() && motion == TableMotion::Displaced;
        self.delay.frame(self.frame.exposed_at.secs(), swing_px, is_astray);
        let track_us = (io.clock.elapsed() - start).as_secs_f64() * 1e6;
        let is_plain = at_rest && !is_blind && matches!(place, PlateInImage::Same) && self.foreign == 0;
        io.sink.frame(&FrameFacts {
            frame: &self.frame,
            tracks: self.tracker.tracks(),
            driving: !at_rest,
            blind: is_blind,
            starts_cycle: purpose == FramePurpose::Segment || is_plain && purpose == FramePurpose::Cycle,
            track_us,
        });
        self.settle_blind(blind, io)?;
        if at_rest && !is_blind {
            self.settle_foreign(io.sink)?;
            self.settle_place(&place, io)?;
        }
        let is_off_plate = self.tracker.tracks().iter().any(|track| self.is_off_plate(track));
        self.missing.off_plate = if is_off_plate { self.missing.off_plate + 1 } else { 0 };
        let frames = self.frame.exposed_at.secs_since(self.observed_at) * self.model.frame_hz;
        // a time stamp in the future must not stop the count
        self.observed_at = self.observed_at.max(self.frame.exposed_at.min(io.rig.now()));
        let is_in_view = !is_blind && motion.corner_px().is_some() && !self.displaced.is_noted;
        match self.frames_missing() {
            0 => self.missing.clear(),
            _ if is_in_view => self.missing.count(frames),
            _ => {}
        }
        if is_plain {
            self.check_jumps(io.sink)?;
            self.expected_m = self.positions_m().into_iter().map(|place_m| (place_m, REACH_M)).collect();
        }
        Ok(is_plain)
    }

    /// The view and the plate's place in a frame at rest.
    fn examine(&mut self) -> (Option<Unusable>, PlateInImage) {
        let before_m = self.scene.foreign_m.filter(|_| self.foreign > 0);
        let (blind, place) = self.scene.examine(&self.frame, self.tracker.tracks());
        // an object that lay beside all parts stays foreign where the tracker takes it for one that is gone
        let is_taken = |at_m: &Vec2| self.positions_m().iter().any(|part_m| (part_m - at_m).norm() < REACH_M);
        self.scene.foreign_m = self.scene.foreign_m.or(before_m.filter(is_taken));
        let blind = blind.filter(|(finding, _)| self.guards.has(*finding));
        self.count_foreign(blind.is_none());
        let place = if self.guards.has(Finding::CameraMoved) { place } else { PlateInImage::Same };
        (blind, place)
    }

    fn count_foreign(&mut self, is_clear: bool) {
        // while a part is missing, an object on the plate may be that part
        let is_foreign =
            self.scene.foreign_m.is_some() && self.frames_missing() == 0 && self.guards.has(Finding::ForeignPart);
        self.foreign = if is_foreign && is_clear { self.foreign + 1 } else { 0 };
    }

    /// True while frames show an object on the moving plate that is no part: a look at rest decides.
    pub(crate) fn suspects_foreign(&self) -> bool {
        self.foreign >= FOREIGN
    }

    /// Waits with motors at zero while nothing can be seen, up to the limit of the cause.
    fn settle_blind(&mut self, blind: Option<Unusable>, io: &mut RunIo<'_>) -> OrEnd {
        let now = io.rig.now();
        let Some((finding, why)) = blind else {
            if let Some((_, Finding::CameraDark | Finding::ViewHidden)) = self.blind.take() {
                // the plate's appearance behind a hand is unreliable
                self.scene.forget_plate(&self.table, &self.frame);
                self.foreign = 0;
            }
            return Ok(());
        };
        // the stamp of a bad frame may lie long before the frames that were good
        let blind_from = self.frame.exposed_at.max(self.observed_at).min(now);
        let (since, _) = *self.blind.get_or_insert((blind_from, finding));
        let for_s = now.secs_since(since);
        let frame_hz = self.model.frame_hz;
        if for_s + 1e-9 >= (BLIND_FRAMES / frame_hz).min(BLIND_S.max(1.5 / frame_hz)) {
            self.stop_motors(io.rig);
            self.findings.note(now, finding, why.clone(), io.sink);
        }
        if for_s > longest_s(finding) {
            return Err(RunEnd::failed_because(finding, format!("{why} for {for_s:.1} s")));
        }
        Ok(())
    }

    fn settle_foreign(&mut self, sink: &mut dyn Sink) -> OrEnd {
        let Some(at_m) = self.scene.foreign_m.filter(|_| self.foreign >= FOREIGN) else { return Ok(()) };
        let at_mm = at_m * 1e3;
        let reason = format!("something that is no part of the job lies at ({:.0}, {:.0}) mm", at_mm.x, at_mm.y);
        Err(self.end_by(Finding::ForeignPart, reason, sink))
    }

    /// The end of the run that a finding in the newest frame causes.
    fn end_by(&mut self, finding: Finding, reason: String, sink: &mut dyn Sink) -> RunEnd {
        self.findings.note(self.frame.exposed_at, finding, reason.clone(), sink);
        RunEnd::failed_because(finding, reason)
    }

    /// Ends the current pulse, if any; the plate swings on for a while.
    pub fn stop_motors(&mut self, rig: &mut dyn Rig) {
        if rig.settled_at() > rig.now() && !self.motors_stopped {
            rig.stop();
            self.motors_stopped = true;
            self.delay.cut();
            self.foreign = 0;
            self.expect_less();
            self.swing_out = SwingOut::after_stop_at(rig.now());
        }
    }

    /// True when the last pulse was silenced or the table located anew: pulses planned before no longer apply.
    pub fn invalidates_plan(&self) -> bool {
        self.motors_stopped || self.relocated
    }

    /// Last seen positions of the parts, m, in the order of the job.
    pub fn positions_m(&self) -> Vec<Vec2> {
        self.tracker.tracks().iter().map(|track| track.seen.position_m).collect()
    }

    /// Position of each part in the newest frame, m; `None` for those that it does not show.
    pub(crate) fn seen_m(&self) -> Vec<Option<Vec2>> {
        let tracks = self.tracker.tracks().iter();
        tracks.map(|track| (track.frames_unseen == 0).then_some(track.seen.position_m)).collect()
    }

    /// Indices of the parts that the newest frame does not show on the plate.
    pub fn missing_parts(&self) -> Vec<usize> {
        let tracks = self.tracker.tracks().iter().enumerate();
        let is_unseen = |track: &Track| track.frames_unseen > 0 || self.is_off_plate(track);
        tracks.filter(|(_, track)| is_unseen(track)).map(|(part, _)| part).collect()
    }

    /// Number of frames for which the longest missing part has been missing; 0 when the newest frame shows all on the
    /// plate.
    pub fn frames_missing(&self) -> u32 {
        self.tracker.tracks().iter().map(|track| track.frames_unseen).fold(self.missing.off_plate, u32::max)
    }

    /// True for a part whose centre is beyond the edge: it has fallen, or is about to.
    fn is_off_plate(&self, track: &Track) -> bool {
        track.seen.position_m.amax() > 0.5 * self.table.side_m + EDGE_M
    }

    /// Number of frames, those that never arrived included, since frames of the present with an unobstructed view lack
    /// a part.
    pub fn frames_missing_in_clear_view(&self) -> u32 {
        self.missing.frames()
    }

    /// Largest displacement of the plate's corners in the newest frame, px; `None` where it does not show them.
    pub(crate) fn corner_px(&self) -> Option<f64> {
        self.scene.table_motion(&self.frame).corner_px()
    }

    /// Time of the newest frame's exposure.
    pub fn seen_at(&self) -> PlateTime {
        self.frame.exposed_at
    }
}
