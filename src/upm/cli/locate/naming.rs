//! Kind and score of each disc found: a part of a kind looked for, or another disc with the reason.

use super::scale::{PictureScale, SHARP};
use super::setup::LocateSetup;
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_perception::vision::{DetectedDisc, Table, seen_outline_m};

/// Largest relative deviation of a disc's diameter from its kind's.
const MOST_OFF: f64 = 0.035;
/// Relative deviation of the diameter that halves a score.
const HALF_OFF: f64 = 0.03;
/// Share of the outline from which on a score is not reduced, and sharpness of the rim that reduces it to a tenth.
const WHOLE_OUTLINE: f64 = 0.85;
const BLURRED: f64 = 0.30;
/// Least score of a named part; below it the disc is reported as unclear.
const LEAST_SCORE: f64 = 0.4;
/// Factors below this are reported as doubts.
const DOUBT_THRESHOLD: f64 = 0.85;
/// Diameter, relative to the smallest known kind, below which a disc is a speck.
const SPECK: f64 = 0.6;

/// A disc named as a part, with the doubts about it.
pub(super) struct NamedPart {
    pub disc: DetectedDisc,
    /// Index into the known kinds.
    pub kind: usize,
    /// Middle of its foot, m.
    pub foot_m: Vec2,
    pub score: f64,
    pub doubts: Vec<String>,
}

/// A disc that is not a part.
pub(super) struct OtherDisc {
    pub disc: DetectedDisc,
    /// The known kind that is nearest in size, an index; `None` if none is near.
    pub like: Option<usize>,
}

/// Names the discs of a picture.
pub(super) fn named(
    discs: &[DetectedDisc],
    table: &Table,
    setting: &LocateSetup,
    scale: &PictureScale,
) -> (Vec<NamedPart>, Vec<OtherDisc>) {
    let smallest_m = setting.known.iter().map(|kind| kind.radius_m).fold(f64::INFINITY, f64::min);
    let (mut parts, mut others) = (Vec::new(), Vec::new());
    for disc in discs.iter().filter(|disc| disc.radius_m > SPECK * smallest_m) {
        let off = |kind: &PartKind| disc.radius_m / seen_outline_m(table, disc.at_m, kind).1 - 1.0;
        let near = setting.known.iter().map(off).enumerate().filter(|(_, off)| off.abs() <= MOST_OFF);
        let nearest = |all: &dyn Fn(usize) -> bool| {
            let some = near.clone().filter(|(kind, _)| all(*kind));
            some.min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        };
        let part = nearest(&|kind| setting.wanted[kind]).map(|(kind, off)| {
            let foot_m = 2.0 * disc.at_m - seen_outline_m(table, disc.at_m, &setting.known[kind]).0;
            // without height and side wall
            let part = DetectedDisc { radius_m: setting.known[kind].radius_m * (1.0 + off), ..disc.clone() };
            scored(disc, NamedPart { disc: part, kind, foot_m, score: scale.trust(), doubts: Vec::new() }, off)
        });
        match part.filter(|part| part.score >= LEAST_SCORE) {
            Some(part) => parts.push(part),
            None => others.push(OtherDisc { disc: disc.clone(), like: nearest(&|_| true).map(|(kind, _)| kind) }),
        }
    }
    (parts, others)
}

/// The part with its score and doubts; its diameter is `off` its kind's, relative.
fn scored(disc: &DetectedDisc, mut part: NamedPart, off: f64) -> NamedPart {
    let mut weigh = |factor: f64, doubt: String| {
        part.score *= factor;
        part.doubts.extend((factor < DOUBT_THRESHOLD).then_some(doubt));
    };
    weigh(1.0 / (1.0 + (off / HALF_OFF).powi(2)), format!("diameter {:+.1} %", 100.0 * off));
    let share = disc.outline_share;
    weigh((share / WHOLE_OUTLINE).min(1.0), format!("{:.0} % of its outline shows", 100.0 * share));
    let sharp = 0.1 + 0.9 * (disc.crispness - BLURRED) / (SHARP - BLURRED);
    weigh(sharp.clamp(0.1, 1.0), "its rim is soft".to_owned());
    part
}
