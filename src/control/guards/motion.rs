use super::steps::PulseOutcome::{self, About, AsPlanned, Otherwise};
use crate::found::{Found, Reason};
use upm_core::job::Finding::{AccelerometerFault, CoilFault, MotionOff};
use upm_core::job::RunnerUp;
use upm_core::signal::CHANNEL_NAMES;
use upm_perception::estimation::{BEARABLE_GAINS, MotionJudgement, MotionVerdict};

/// Names of the voice coils.
const COILS: [&str; 4] = ["x1", "x2", "y1", "y2"];
/// Relative deviation of a motion from its plan above which the run ends: that of four coils as weak as a run bears.
const FAR_OFF: f64 = 1.0 - *BEARABLE_GAINS.start();

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

/// A pulse as the camera saw it: how it carried most parts, and how the plate swung; `None` where that is not clear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sight {
    pub parts: Option<PulseOutcome>,
    pub plate: Option<PulseOutcome>,
}

/// Witnesses that make certain that the accelerometers are at fault.
const CERTAIN: u8 = 2;

/// Weighs the measured motion of each pulse against what the camera saw of it.
#[derive(Clone, Debug, Default)]
pub struct MotionGuard {
    /// Pulses that were read, and the largest deviation among them, in tolerances.
    pub read: (u64, f64),
    /// Witnesses, up to [`CERTAIN`], that another motion which the accelerometers read is their fault: parts or plate
    /// went as planned while they read another one or none, or one of them was named.
    misread: u8,
    /// The same for a trace without any motion. Another motion read before is no such witness: a weak coil causes one,
    /// too.
    unread: u8,
}

impl MotionGuard {
    /// Judges the motion of one pulse; `None` without a finding.
    pub fn check(&mut self, judged: &MotionJudgement, sight: Sight) -> Option<MotionFinding> {
        let MotionJudgement { off, score, verdict, runner_up } = judged.clone();
        if let Some(score) = score {
            self.read = (self.read.0 + 1, self.read.1.max(score));
        }
        if matches!(verdict, MotionVerdict::Channel(..) | MotionVerdict::Channels) {
            (self.misread, self.unread) = (self.misread.max(1), CERTAIN);
        }
        let (name, off_plan) = (name_of(verdict), format!("the plate moved {:.0} % off the plan", 100.0 * off));
        let unread = "the accelerometer trace of the plate's motion is unreadable";
        let (found, text, ends) = match verdict {
            MotionVerdict::AsPlanned => return None,
            MotionVerdict::Channel(channel, gain) => {
                let other = || "does not agree with the other three".to_owned();
                let shows = gain.map_or_else(other, |gain| format!("shows {gain:.2} of the motion"));
                let text = format!("{name} {shows}: pulses are watched by the camera alone");
                (Found::about(AccelerometerFault, channel), text, false)
            }
            MotionVerdict::Channels => {
                (AccelerometerFault.into(), "the accelerometers show what no motion of a plate shows".to_owned(), false)
            }
            MotionVerdict::Coil(coil, gain) => {
                let text = format!("{off_plan}: {name} gives {gain:.2} of its force");
                (Found::about(CoilFault, coil), text, !BEARABLE_GAINS.contains(&gain))
            }
            MotionVerdict::Swapped([coil, _]) => (Found::about(CoilFault, coil), name, true),
            MotionVerdict::Other if self.is_misread(off, sight) => {
                (AccelerometerFault.into(), format!("{off_plan} by the accelerometers, not by the camera"), false)
            }
            MotionVerdict::Other => (MotionOff.into(), off_plan, off > FAR_OFF),
            MotionVerdict::Unreadable if self.is_unread(sight) => {
                (AccelerometerFault.into(), format!("{unread}, and the camera shows nothing wrong"), false)
            }
            MotionVerdict::Unreadable => (MotionOff.into(), unread.to_owned(), true),
        };
        let most = f64::from(RunnerUp::MOST_ODDS);
        let told = |(other, odds): (_, f64)| RunnerUp { what: name_of(other), odds: odds.min(most) as u32 };
        Some(MotionFinding { found, reason: Reason { text, runner_up: runner_up.map(told) }, ends })
    }

    /// True where the camera saw enough of a pulse to say that the accelerometers misread its motion.
    fn is_misread(&mut self, off: f64, Sight { parts, plate }: Sight) -> bool {
        let shows_drive = plate == Some(AsPlanned);
        // a plate driven the wrong way round swings as far as planned, and a part on ice may glide about there
        let shows_motion = shows_drive && (off - 2.0).abs() > FAR_OFF;
        let is_excused = match parts {
            Some(AsPlanned) => self.misread + u8::from(shows_drive) > 0,
            // a pulse that fails half way, or with one weak coil of two, still carries parts about where they should go
            Some(About) => shows_motion,
            Some(Otherwise) => false,
            // a pulse too small for its parts to show it is judged by the plate's swing, or as the last with witnesses
            None => self.misread + u8::from(shows_motion) >= CERTAIN,
        };
        let is_misread = is_excused && off > FAR_OFF && plate != Some(Otherwise);
        self.misread = if is_misread { CERTAIN } else { self.misread };
        is_misread
    }

    /// True where it saw enough to say that they do not show a motion that there was.
    fn is_unread(&mut self, Sight { parts, plate }: Sight) -> bool {
        let shows_drive = plate == Some(AsPlanned);
        let is_unread = match parts {
            Some(AsPlanned | About) => true,
            Some(Otherwise) => shows_drive,
            // a channel known to be at fault hides a small motion: there is no evidence of another one
            None => shows_drive || self.unread >= CERTAIN && plate.is_none(),
        };
        if is_unread && (parts, plate) != (None, None) {
            // the parts alone are weak evidence for a single pulse: one that fails half way carries them about there
            self.unread = if shows_drive { CERTAIN } else { CERTAIN.min(self.unread + 1) };
            self.misread = self.misread.max(self.unread);
        }
        is_unread
    }
}

/// The coil, channel or pair of coils that a verdict is about.
fn name_of(verdict: MotionVerdict) -> String {
    match verdict {
        MotionVerdict::Coil(coil, _) => format!("coil {}", COILS[coil]),
        MotionVerdict::Channel(channel, _) => format!("accelerometer channel {}", CHANNEL_NAMES[channel]),
        MotionVerdict::Swapped([a, b]) => format!("coils {} and {} swapped", COILS[a], COILS[b]),
        _ => "another motion".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use MotionVerdict::{Channel, Channels, Coil, Other, Swapped, Unreadable};

    /// How parts and plate went.
    type Seen = (Option<PulseOutcome>, Option<PulseOutcome>);

    /// Whether each of these pulses of a run ends it; `None` without a finding.
    fn ends<const N: usize>(pulses: [(MotionVerdict, f64, Seen); N]) -> [Option<bool>; N] {
        let mut guard = MotionGuard::default();
        pulses.map(|(verdict, off, (parts, plate))| {
            let judged = MotionJudgement { off, score: None, verdict, runner_up: None };
            guard.check(&judged, Sight { parts, plate }).map(|found| found.ends)
        })
    }

    fn ends_last<const N: usize>(pulses: [(MotionVerdict, f64, Seen); N]) -> bool {
        ends(pulses)[N - 1].unwrap()
    }

    const UNSEEN: Seen = (None, None);

    #[test]
    fn each_verdict_is_ignored_reported_or_ends_the_run() {
        let of = |verdict, off, sight| ends([(verdict, off, sight)])[0];
        let coil = |gain| of(Coil(0, gain), 0.1, UNSEEN);
        assert_eq!(
            [of(MotionVerdict::AsPlanned, 0.01, UNSEEN), coil(0.85), coil(0.0), coil(-1.0)],
            [None, Some(false), Some(true), Some(true)]
        );
        assert_eq!(of(Channel(2, Some(0.0)), 0.4, (Some(Otherwise), None)), Some(false));
        assert_eq!(of(Swapped([0, 1]), 0.9, UNSEEN), Some(true));
        assert_eq!(of(Channels, 0.9, UNSEEN), Some(false));
        assert_eq!([None, Some(AsPlanned)].map(|went| of(Other, 0.5, (went, None))), [Some(true); 2]);
        assert_eq!(of(Other, 0.5, (None, Some(AsPlanned))), Some(true), "nothing was known before");
        assert_eq!(of(Other, 0.5, (Some(AsPlanned), Some(AsPlanned))), Some(false));
        assert_eq!(
            of(Other, 1.999, (Some(About), Some(AsPlanned))),
            Some(true),
            "all coils reversed, and a part that glides"
        );
        assert_eq!(of(Other, 1.999, (Some(AsPlanned), Some(AsPlanned))), Some(false));
        assert_eq!(of(Other, 1.4, (Some(About), Some(AsPlanned))), Some(false));
        assert_eq!([0.1, 0.5].map(|off| of(Other, off, UNSEEN)), [Some(false), Some(true)], "slight or not");
        assert_eq!(of(Unreadable, 0.0, UNSEEN), Some(true));
        assert_eq!(of(Unreadable, 0.0, (Some(About), None)), Some(false));
    }

    #[test]
    fn accelerometers_known_to_be_at_fault_are_believed_less() {
        let (disagree, went_there) = ((Channels, 0.9, UNSEEN), (Other, 0.5, (Some(AsPlanned), None)));
        assert!(!ends_last([disagree, went_there]));
        let then = |sight| ends_last([disagree, went_there, (Other, 0.5, sight)]);
        assert!(then((Some(About), None)), "a dead coil of two carries parts about there");
        assert!(then((Some(AsPlanned), Some(Otherwise))), "the camera saw another motion, too");
        assert!(!then(UNSEEN), "a small pulse is judged as the last");
        assert!(then((Some(Otherwise), None)));
        let channel = (Channel(2, Some(0.0)), 0.4, UNSEEN);
        assert!(!ends_last([channel, (Other, 0.5, (None, Some(AsPlanned)))]), "a second accelerometer");
        let unread = |sight| (Unreadable, 0.0, sight);
        assert!(!ends_last([channel, unread(UNSEEN)]), "the channel hides the motion");
        assert!(ends_last([channel, unread(UNSEEN), (Other, 0.5, UNSEEN)]), "which is no witness");
        assert!(ends_last([channel, unread((None, Some(Otherwise)))]));
        assert!(ends_last([channel, unread((Some(Otherwise), None))]));
    }

    #[test]
    fn trace_without_motion_is_excused_by_the_plate_or_by_parts_twice() {
        let unread = |sight| (Unreadable, 0.0, sight);
        assert!(!ends_last([unread((None, Some(AsPlanned))), unread(UNSEEN)]));
        assert!(ends_last([unread((None, Some(AsPlanned))), unread((None, Some(Otherwise)))]));
        let there = unread((Some(AsPlanned), None));
        assert!(ends_last([there, unread(UNSEEN)]), "coils died in the first, which carried its parts half way");
        assert!(!ends_last([there, there, unread(UNSEEN)]));
        // a weak coil causes another motion
        let weak_coil = (Other, 0.57, (Some(AsPlanned), Some(AsPlanned)));
        assert_eq!(
            ends([weak_coil, unread((Some(About), None)), unread(UNSEEN)]),
            [Some(false), Some(false), Some(true)]
        );
    }
}
