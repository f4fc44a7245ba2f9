use super::delay::SwingVerdict;
use super::steps::PulseOutcome;
use crate::found::{Found, Reason};
use upm_core::job::{Finding, RunnerUp};
use upm_core::signal::{CHANNEL_NAMES, Drive};
use upm_core::units::GRAVITY_MPS2;
use upm_perception::estimation::{
    AccelerometerPair, BEARABLE_GAINS, ChannelFault, ExpectedMotion, FitFault, MotionVerdict, PlateFit, judge,
};
use upm_planning::cor_library::{CoilResponse, Library};
use upm_planning::planner::PlannedPulse;

/// Names of the voice coils.
const COILS: [&str; 4] = ["x1", "x2", "y1", "y2"];
/// Largest friction of a part on the plate: of dry metal.
const MOST_FRICTION: f64 = 0.5;
/// Relative deviation of a motion from its plan above which the run ends.
const FAR_OFF: f64 = 0.25;

/// A finding on coils or accelerometers from one pulse.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionFinding {
    /// The finding, and the coil or channel it is about.
    pub found: Found,
    /// The reason, with the runner-up of the judgement.
    pub reason: Reason,
    /// True when no more pulses may be played.
    pub ends: bool,
}

/// The plate's responses to each coil, for both kinds of pulse.
#[derive(Clone, Debug)]
pub struct CoilResponses {
    field: Option<CoilResponse>,
    rotation: Option<CoilResponse>,
    /// See [`ExpectedMotion::load_mps2`].
    pub load_mps2: f64,
    /// See [`ExpectedMotion::limit`].
    pub limit: f64,
}

impl CoilResponses {
    /// The responses in `library`. `parts_share` is the mass of the parts over that of the plate, and `limit` the
    /// deviation that is a finding.
    pub fn new(library: &Library, parts_share: f64, limit: f64) -> Self {
        let load_mps2 = MOST_FRICTION * GRAVITY_MPS2 * parts_share;
        Self { field: library.field_coils(), rotation: library.rotation_coils(), load_mps2, limit }
    }

    /// The expected motion of a pulse; `None` where the library does not give it.
    pub fn expected<'a>(&'a self, planned: &PlannedPulse, drive: &'a Drive) -> Option<ExpectedMotion<'a>> {
        let coils = match planned {
            PlannedPulse::Field(_) => self.field.as_ref()?,
            PlannedPulse::Rotation(_) => self.rotation.as_ref()?,
        };
        Some(ExpectedMotion { drive, coils, load_mps2: self.load_mps2, limit: self.limit })
    }
}

/// Measurements of one pulse by the accelerometers and the camera.
#[derive(Clone, Copy, Debug)]
pub struct PulseReading<'a> {
    /// The plate's motion, fitted to the accelerometers' trace.
    pub fit: &'a Result<PlateFit, FitFault>,
    /// Places and gains of the accelerometers.
    pub sensors: &'a AccelerometerPair,
    /// How most parts moved, by the camera; `None` where it could not tell.
    pub went: Option<PulseOutcome>,
    /// How the plate swung, by the camera.
    pub swing: SwingVerdict,
}

/// Compares the measured motion of each pulse with the planned one.
#[derive(Clone, Debug, Default)]
pub struct MotionGuard {
    /// Pulses that were read, and the largest deviation among them, in tolerances.
    pub read: (u64, f64),
    /// True when an earlier pulse has shown that the accelerometers are at fault.
    doubts_sensors: bool,
    /// True when it has named a channel, or shown that the channels disagree.
    knows_fault: bool,
    /// True when an earlier pulse carried parts as forecast while the accelerometers read another motion of the plate.
    contradicted: bool,
    /// True when an earlier trace was unreadable although parts or plate were seen to move.
    unread: bool,
    /// True when an unreadable trace is known to be the accelerometers' fault. A different motion read before
    /// does not show that: a weak coil causes one, too.
    unread_contradicted: bool,
}

impl MotionGuard {
    /// Judges the motion of one pulse; `None` without a finding.
    pub fn check(&mut self, expected: &ExpectedMotion<'_>, reading: &PulseReading<'_>) -> Option<MotionFinding> {
        let judged = judge(expected, reading.fit.as_ref(), reading.sensors);
        let off = judged.mismatch.map_or(0.0, |mismatch| mismatch.relative);
        if let Some(mismatch) = judged.mismatch {
            self.read = (self.read.0 + 1, self.read.1.max(mismatch.score));
        }
        let mut finding = self.finding(judged.verdict, off, reading.went, reading.swing)?;
        finding.reason.runner_up = judged.runner_up.map(|other| {
            let odds = other.odds.min(f64::from(RunnerUp::MOST_ODDS)) as u32;
            RunnerUp { what: name_of(other.verdict), odds }
        });
        Some(finding)
    }

    fn finding(
        &mut self,
        verdict: MotionVerdict,
        off: f64,
        went: Option<PulseOutcome>,
        swing: SwingVerdict,
    ) -> Option<MotionFinding> {
        let saw_it_go = matches!(went, Some(PulseOutcome::There | PulseOutcome::About));
        let shows_drive = swing == SwingVerdict::AsDriven;
        let went_there = went == Some(PulseOutcome::There);
        // a pulse that fails half way, or with one weak coil of two, still carries parts about where they should go;
        // a plate driven the wrong way round swings as far as planned, and a part on ice may glide about there
        let is_reversed = (off - 2.0).abs() <= FAR_OFF;
        let shows_motion = shows_drive && (went_there || !is_reversed);
        let saw_it_all = saw_it_go && shows_motion || went_there && self.doubts_sensors;
        let is_unread = matches!(verdict, MotionVerdict::Unreadable { strong: true });
        if is_unread && (saw_it_go || shows_drive) {
            // the parts alone are weak evidence for a single pulse: one that fails half way carries them about there
            self.unread_contradicted |= shows_drive || self.unread || self.knows_fault;
            self.contradicted |= self.unread_contradicted;
            (self.unread, self.doubts_sensors) = (true, true);
        }
        // a pulse too small for its parts to show it is judged by the plate's swing, or as the last one with evidence
        let has_evidence = if is_unread { self.unread_contradicted } else { self.contradicted };
        let is_as_known = went.is_none() && (has_evidence || self.doubts_sensors && shows_motion);
        let is_sensors = (saw_it_all || is_as_known) && swing != SwingVerdict::Otherwise;
        // a channel known to be at fault hides a small motion: there is no evidence of another one
        let is_hidden = self.knows_fault && went.is_none() && swing != SwingVerdict::Otherwise;
        self.knows_fault |= matches!(verdict, MotionVerdict::Channel { .. } | MotionVerdict::Channels);
        self.doubts_sensors |= self.knows_fault;
        let percent = 100.0 * off;
        let (found, reason, ends) = match verdict {
            MotionVerdict::AsPlanned | MotionVerdict::Unreadable { strong: false } => return None,
            MotionVerdict::Channel { channel, kind } => {
                let shows = match kind {
                    ChannelFault::Gain(gain) => format!("shows {gain:.2} of the motion"),
                    ChannelFault::Erratic => "does not agree with the other three".to_owned(),
                };
                let reason = format!("{} {shows}: pulses are watched by the camera alone", name_of(verdict));
                (Found::about(Finding::AccelerometerFault, channel), reason, false)
            }
            MotionVerdict::Coil { coil, gain } => {
                let name = name_of(verdict);
                let reason =
                    format!("the plate moved {percent:.0} % off the plan: {name} gives {gain:.2} of its force");
                (Found::about(Finding::CoilFault, coil), reason, !BEARABLE_GAINS.contains(&gain))
            }
            MotionVerdict::Swapped { coils: [coil, _] } => {
                (Found::about(Finding::CoilFault, coil), name_of(verdict), true)
            }
            MotionVerdict::Channels => {
                let reason = "the accelerometers show what no motion of a plate shows".to_owned();
                (Finding::AccelerometerFault.into(), reason, false)
            }
            MotionVerdict::Other if is_sensors && off > FAR_OFF => {
                (self.doubts_sensors, self.contradicted) = (true, true);
                let reason =
                    format!("the accelerometers read a motion {percent:.0} % off the plan, the parts went as forecast");
                (Finding::AccelerometerFault.into(), reason, false)
            }
            MotionVerdict::Other => {
                (Finding::MotionOff.into(), format!("the plate moved {percent:.0} % off the plan"), off > FAR_OFF)
            }
            MotionVerdict::Unreadable { strong: true } if saw_it_go || shows_drive || is_sensors || is_hidden => {
                let reason = "the accelerometer trace is unreadable, and the camera shows nothing wrong".to_owned();
                (Finding::AccelerometerFault.into(), reason, false)
            }
            MotionVerdict::Unreadable { strong: true } => {
                let reason = "the accelerometer trace of the plate's motion is unreadable".to_owned();
                (Finding::MotionOff.into(), reason, true)
            }
        };
        Some(MotionFinding { found, reason: reason.into(), ends })
    }
}

/// The coil, channel or pair of coils that a verdict is about.
fn name_of(verdict: MotionVerdict) -> String {
    match verdict {
        MotionVerdict::Coil { coil, .. } => format!("coil {}", COILS[coil]),
        MotionVerdict::Channel { channel, .. } => format!("accelerometer channel {}", CHANNEL_NAMES[channel]),
        MotionVerdict::Swapped { coils: [a, b] } => format!("coils {} and {} swapped", COILS[a], COILS[b]),
        _ => "another motion".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends(verdict: MotionVerdict, off: f64, went: Option<PulseOutcome>) -> Option<bool> {
        MotionGuard::default().finding(verdict, off, went, SwingVerdict::Unclear).map(|finding| finding.ends)
    }

    #[test]
    fn each_verdict_is_ignored_reported_or_ends_the_run() {
        let coil = |gain| MotionVerdict::Coil { coil: 0, gain };
        let channel = MotionVerdict::Channel { channel: 2, kind: ChannelFault::Gain(0.0) };
        let unread = |strong| MotionVerdict::Unreadable { strong };
        assert_eq!(ends(MotionVerdict::AsPlanned, 0.01, None), None);
        assert_eq!([0.85, 0.0, -1.0].map(|gain| ends(coil(gain), 0.1, None)), [Some(false), Some(true), Some(true)]);
        assert_eq!(ends(channel, 0.4, Some(PulseOutcome::Elsewhere)), Some(false));
        assert_eq!(ends(MotionVerdict::Swapped { coils: [0, 1] }, 0.9, None), Some(true));
        assert_eq!(
            [None, Some(PulseOutcome::There)].map(|seen| ends(MotionVerdict::Other, 0.5, seen)),
            [Some(true); 2]
        );
        let seen_to_swing = MotionGuard::default().finding(
            MotionVerdict::Other,
            0.5,
            Some(PulseOutcome::There),
            SwingVerdict::AsDriven,
        );
        assert_eq!(seen_to_swing.map(|finding| finding.ends), Some(false));
        let reversed = |off: f64, went: PulseOutcome| {
            MotionGuard::default().finding(MotionVerdict::Other, off, Some(went), SwingVerdict::AsDriven)
        };
        let ends_reversed = |off, went| reversed(off, went).map(|finding| finding.ends);
        assert_eq!(ends_reversed(1.999, PulseOutcome::About), Some(true), "all coils reversed, and a part that glides");
        assert_eq!(ends_reversed(1.999, PulseOutcome::There), Some(false));
        assert_eq!(ends_reversed(1.4, PulseOutcome::About), Some(false));
        let mut doubting = MotionGuard::default();
        doubting.finding(MotionVerdict::Channels, 0.9, None, SwingVerdict::Unclear);
        let known = doubting.finding(MotionVerdict::Other, 0.5, Some(PulseOutcome::There), SwingVerdict::Unclear);
        assert_eq!(known.map(|finding| finding.ends), Some(false), "the accelerometers are known to be at fault");
        let about =
            doubting.clone().finding(MotionVerdict::Other, 0.5, Some(PulseOutcome::About), SwingVerdict::Unclear);
        assert_eq!(about.map(|finding| finding.ends), Some(true), "a dead coil of two carries parts about there");
        let mut swinging = MotionGuard::default();
        let by_swing = |guard: &mut MotionGuard| guard.finding(MotionVerdict::Other, 0.5, None, SwingVerdict::AsDriven);
        assert_eq!(by_swing(&mut swinging.clone()).map(|finding| finding.ends), Some(true), "nothing was known before");
        swinging.finding(
            MotionVerdict::Channel { channel: 3, kind: ChannelFault::Gain(0.0) },
            0.5,
            None,
            SwingVerdict::AsDriven,
        );
        assert_eq!(by_swing(&mut swinging).map(|finding| finding.ends), Some(false), "a second accelerometer");
        let swings_otherwise =
            doubting.clone().finding(MotionVerdict::Other, 0.5, Some(PulseOutcome::There), SwingVerdict::Otherwise);
        assert_eq!(swings_otherwise.map(|finding| finding.ends), Some(true), "the camera saw another motion, too");
        let mut small =
            |seen| doubting.finding(MotionVerdict::Other, 0.5, seen, SwingVerdict::Unclear).map(|finding| finding.ends);
        assert_eq!(
            [small(None), small(Some(PulseOutcome::Elsewhere))],
            [Some(false), Some(true)],
            "a small pulse is judged as the last"
        );
        assert_eq!([false, true].map(|strong| ends(unread(strong), 0.0, None)), [None, Some(true)]);
        assert_eq!(ends(unread(true), 0.0, Some(PulseOutcome::About)), Some(false));
        let mut unread_before = MotionGuard::default();
        unread_before.finding(unread(true), 0.0, None, SwingVerdict::AsDriven);
        let unread_again = |seen| unread_before.clone().finding(unread(true), 0.0, None, seen).map(|found| found.ends);
        assert_eq!([SwingVerdict::Unclear, SwingVerdict::Otherwise].map(unread_again), [Some(false), Some(true)]);
        let mut one_at_fault = MotionGuard::default();
        one_at_fault.finding(channel, 0.4, None, SwingVerdict::Unclear);
        let unread_small =
            |seen, swing| one_at_fault.clone().finding(unread(true), 0.0, seen, swing).map(|found| found.ends);
        assert_eq!(unread_small(None, SwingVerdict::Unclear), Some(false), "the channel hides the motion");
        let mut half_way = MotionGuard::default();
        let mut unread_at =
            |went| half_way.finding(unread(true), 0.0, went, SwingVerdict::Unclear).map(|found| found.ends);
        assert_eq!(
            [unread_at(Some(PulseOutcome::There)), unread_at(None)],
            [Some(false), Some(true)],
            "coils died in the first"
        );
        assert_eq!(unread_small(None, SwingVerdict::Otherwise), Some(true));
        assert_eq!(unread_small(Some(PulseOutcome::Elsewhere), SwingVerdict::Unclear), Some(true));
        assert_eq!(ends(MotionVerdict::Channels, 0.9, None), Some(false));
    }

    #[test]
    fn another_motion_that_was_read_does_not_excuse_a_trace_without_any() {
        let unread = MotionVerdict::Unreadable { strong: true };
        let mut guard = MotionGuard::default();
        let weak_coil = guard.finding(MotionVerdict::Other, 0.57, Some(PulseOutcome::There), SwingVerdict::AsDriven);
        assert_eq!(weak_coil.map(|finding| finding.ends), Some(false));
        // the coils die in the middle of the first, which carries its parts half way
        let mut ends = |went| guard.finding(unread, 0.0, went, SwingVerdict::Unclear).map(|finding| finding.ends);
        assert_eq!([ends(Some(PulseOutcome::About)), ends(None)], [Some(false), Some(true)]);
    }

    #[test]
    fn slight_deviation_is_reported_and_the_run_goes_on() {
        assert_eq!([0.1, 0.5].map(|off| ends(MotionVerdict::Other, off, None)), [Some(false), Some(true)]);
    }
}
