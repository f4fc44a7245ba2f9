use super::delay::SwingVerdict;
use super::steps::PulseOutcome;
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

/// A pulse as the camera saw it: how most parts moved, `None` where it could not tell, and how the plate swung.
pub type Sight = (Option<PulseOutcome>, SwingVerdict);

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
        if let Some(score) = judged.score {
            self.read = (self.read.0 + 1, self.read.1.max(score));
        }
        let (found, text, ends) = self.finding(judged.verdict, judged.off, sight)?;
        let runner_up = judged.runner_up.map(|(other, odds)| {
            let odds = odds.min(f64::from(RunnerUp::MOST_ODDS)) as u32;
            RunnerUp { what: name_of(other), odds }
        });
        Some(MotionFinding { found, reason: Reason { text, runner_up }, ends })
    }

    /// True where the camera saw enough of a pulse to say that the accelerometers are wrong about it.
    fn contradicts(&self, verdict: MotionVerdict, off: f64, (went, swing): Sight) -> bool {
        let shows_drive = swing == SwingVerdict::AsDriven;
        // a plate driven the wrong way round swings as far as planned, and a part on ice may glide about there
        let shows_motion = shows_drive && (off - 2.0).abs() > FAR_OFF;
        let is_other = verdict == MotionVerdict::Other;
        match went {
            _ if is_other && (swing == SwingVerdict::Otherwise || off <= FAR_OFF) => false,
            Some(PulseOutcome::There) => !is_other || shows_drive || self.misread > 0,
            // a pulse that fails half way, or with one weak coil of two, still carries parts about where they should go
            Some(PulseOutcome::About) => !is_other || shows_motion,
            Some(_) => !is_other && shows_drive,
            // a pulse too small for its parts to show it is judged by the plate's swing, or as the last with witnesses;
            // a channel known to be at fault hides a small motion: there is no evidence of another one
            None if is_other => self.misread >= CERTAIN || self.misread > 0 && shows_motion,
            None => shows_drive || self.unread >= CERTAIN && swing != SwingVerdict::Otherwise,
        }
    }

    /// The finding, its reason, and whether it ends the run.
    fn finding(&mut self, verdict: MotionVerdict, off: f64, sight: Sight) -> Option<(Found, String, bool)> {
        let is_contradicted = self.contradicts(verdict, off, sight);
        match (verdict, sight) {
            (MotionVerdict::Channel(..) | MotionVerdict::Channels, _) => {
                (self.misread, self.unread) = (self.misread.max(1), CERTAIN);
            }
            (MotionVerdict::Other, _) if is_contradicted => self.misread = CERTAIN,
            // the parts alone are weak evidence for a single pulse: one that fails half way carries them about there
            (MotionVerdict::Unreadable, (_, swing)) if is_contradicted && sight != (None, SwingVerdict::Unclear) => {
                self.unread = if swing == SwingVerdict::AsDriven { CERTAIN } else { CERTAIN.min(self.unread + 1) };
                self.misread = self.misread.max(self.unread);
            }
            _ => {}
        }
        let (name, off_plan) = (name_of(verdict), format!("the plate moved {:.0} % off the plan", 100.0 * off));
        let unread = "the accelerometer trace of the plate's motion is unreadable".to_owned();
        Some(match verdict {
            MotionVerdict::AsPlanned => return None,
            MotionVerdict::Channel(channel, gain) => {
                let shows = gain.map(|gain| format!("shows {gain:.2} of the motion"));
                let shows = shows.unwrap_or_else(|| "does not agree with the other three".to_owned());
                let reason = format!("{name} {shows}: pulses are watched by the camera alone");
                (Found::about(AccelerometerFault, channel), reason, false)
            }
            MotionVerdict::Coil(coil, gain) => {
                let reason = format!("{off_plan}: {name} gives {gain:.2} of its force");
                (Found::about(CoilFault, coil), reason, !BEARABLE_GAINS.contains(&gain))
            }
            MotionVerdict::Swapped([coil, _]) => (Found::about(CoilFault, coil), name, true),
            MotionVerdict::Channels => {
                (AccelerometerFault.into(), "the accelerometers show what no motion of a plate shows".to_owned(), false)
            }
            MotionVerdict::Other if is_contradicted => {
                (AccelerometerFault.into(), format!("{off_plan} by the accelerometers, not by the camera"), false)
            }
            MotionVerdict::Other => (MotionOff.into(), off_plan, off > FAR_OFF),
            MotionVerdict::Unreadable if is_contradicted => {
                (AccelerometerFault.into(), format!("{unread}, and the camera shows nothing wrong"), false)
            }
            MotionVerdict::Unreadable => (MotionOff.into(), unread, true),
        })
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
    use MotionVerdict::{AsPlanned, Channel, Channels, Coil, Other, Swapped, Unreadable};
    use PulseOutcome::{About, Elsewhere, There};
    use SwingVerdict::{AsDriven, Otherwise, Unclear};

    /// Whether each of these pulses of a run ends it; `None` without a finding.
    fn ends<const N: usize>(pulses: [(MotionVerdict, f64, Sight); N]) -> [Option<bool>; N] {
        let mut guard = MotionGuard::default();
        pulses.map(|(verdict, off, sight)| guard.finding(verdict, off, sight).map(|(_, _, ends)| ends))
    }

    fn ends_last<const N: usize>(pulses: [(MotionVerdict, f64, Sight); N]) -> bool {
        ends(pulses)[N - 1].unwrap()
    }

    const UNSEEN: Sight = (None, Unclear);

    #[test]
    fn each_verdict_is_ignored_reported_or_ends_the_run() {
        let of = |verdict, off, sight| ends([(verdict, off, sight)])[0];
        let coil = |gain| of(Coil(0, gain), 0.1, UNSEEN);
        assert_eq!(
            [of(AsPlanned, 0.01, UNSEEN), coil(0.85), coil(0.0), coil(-1.0)],
            [None, Some(false), Some(true), Some(true)]
        );
        assert_eq!(of(Channel(2, Some(0.0)), 0.4, (Some(Elsewhere), Unclear)), Some(false));
        assert_eq!(of(Swapped([0, 1]), 0.9, UNSEEN), Some(true));
        assert_eq!(of(Channels, 0.9, UNSEEN), Some(false));
        assert_eq!([None, Some(There)].map(|went| of(Other, 0.5, (went, Unclear))), [Some(true); 2]);
        assert_eq!(of(Other, 0.5, (None, AsDriven)), Some(true), "nothing was known before");
        assert_eq!(of(Other, 0.5, (Some(There), AsDriven)), Some(false));
        assert_eq!(of(Other, 1.999, (Some(About), AsDriven)), Some(true), "all coils reversed, and a part that glides");
        assert_eq!(of(Other, 1.999, (Some(There), AsDriven)), Some(false));
        assert_eq!(of(Other, 1.4, (Some(About), AsDriven)), Some(false));
        assert_eq!([0.1, 0.5].map(|off| of(Other, off, UNSEEN)), [Some(false), Some(true)], "slight or not");
        assert_eq!(of(Unreadable, 0.0, UNSEEN), Some(true));
        assert_eq!(of(Unreadable, 0.0, (Some(About), Unclear)), Some(false));
    }

    #[test]
    fn accelerometers_known_to_be_at_fault_are_believed_less() {
        let (disagree, went_there) = ((Channels, 0.9, UNSEEN), (Other, 0.5, (Some(There), Unclear)));
        assert!(!ends_last([disagree, went_there]));
        let then = |sight| ends_last([disagree, went_there, (Other, 0.5, sight)]);
        assert!(then((Some(About), Unclear)), "a dead coil of two carries parts about there");
        assert!(then((Some(There), Otherwise)), "the camera saw another motion, too");
        assert!(!then(UNSEEN), "a small pulse is judged as the last");
        assert!(then((Some(Elsewhere), Unclear)));
        let channel = (Channel(2, Some(0.0)), 0.4, UNSEEN);
        assert!(!ends_last([channel, (Other, 0.5, (None, AsDriven))]), "a second accelerometer");
        let unread = |sight| (Unreadable, 0.0, sight);
        assert!(!ends_last([channel, unread(UNSEEN)]), "the channel hides the motion");
        assert!(ends_last([channel, unread(UNSEEN), (Other, 0.5, UNSEEN)]), "which is no witness");
        assert!(ends_last([channel, unread((None, Otherwise))]));
        assert!(ends_last([channel, unread((Some(Elsewhere), Unclear))]));
    }

    #[test]
    fn trace_without_motion_is_excused_by_the_plate_or_by_parts_twice() {
        let unread = |sight| (Unreadable, 0.0, sight);
        assert!(!ends_last([unread((None, AsDriven)), unread(UNSEEN)]));
        assert!(ends_last([unread((None, AsDriven)), unread((None, Otherwise))]));
        let there = unread((Some(There), Unclear));
        assert!(ends_last([there, unread(UNSEEN)]), "coils died in the first, which carried its parts half way");
        assert!(!ends_last([there, there, unread(UNSEEN)]));
        // a weak coil causes another motion
        let weak_coil = (Other, 0.57, (Some(There), AsDriven));
        assert_eq!(
            ends([weak_coil, unread((Some(About), Unclear)), unread(UNSEEN)]),
            [Some(false), Some(false), Some(true)]
        );
    }
}
