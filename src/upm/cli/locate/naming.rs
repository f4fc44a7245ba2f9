//! Kind and score of each disc found: a part of a kind looked for, or another disc with the reason.

use image::RgbImage;

use super::scale::SideSource;
use super::setup::LocateSetup;
use super::tone::{contradicted, metal_of};
use upm_core::rig::PartKind;
use upm_perception::vision::{DetectedDisc, Detection, Survey, Table, seen_radius_m};

/// Largest relative deviation of a disc's diameter from its kind's, for discs that the part finder found and for
/// others.
const MOST_OFF: f64 = 0.05;
const MOST_OFF_ALONE: f64 = 0.035;
/// Least visible share of the outline, and least sharpness of it, for a part that the part finder did not find.
const LEAST_SHARE: f64 = 0.55;
const LEAST_CRISPNESS: f64 = 0.4;
/// Relative deviation of the diameter that halves a score.
const HALF_OFF: f64 = 0.03;
/// Share of the outline and sharpness of the rim from which on a score is not reduced; sharpness that reduces it to a
/// tenth.
const WHOLE_OUTLINE: f64 = 0.85;
const SHARP: f64 = 0.57;
const BLURRED: f64 = 0.30;
/// Factors on the score if the tone is another metal's, if no outline was measured, and if the plate's side is
/// uncertain.
const OTHER_TONE: f64 = 0.6;
const UNMEASURED: f64 = 0.6;
const UNSURE_SCALE: f64 = 0.9;
/// Least score of a named part; below it the disc is reported as unclear.
const LEAST_SCORE: f64 = 0.4;
/// Factors below this are reported as doubts.
const DOUBT_THRESHOLD: f64 = 0.85;
/// Contrast and diameter, relative to the smallest known kind, below which a disc is a speck.
const SPECK_CONTRAST: f64 = 0.15;
const SPECK_SIZE: f64 = 0.6;

/// A part with the doubts about it.
#[derive(Clone, Debug)]
pub(super) struct NamedPart {
    pub part: Detection,
    pub diameter_m: f64,
    pub doubts: Vec<String>,
}

/// Reason why a disc is not a part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum RejectionReason {
    /// It has the size of a kind that was not looked for.
    NotLookedFor { kind: String },
    /// It is lighter than the plate although parts are darker, or the reverse.
    OtherPolarity { kind: Option<String> },
    /// It is about the size of a kind looked for, but its size, rim or tone do not fit well enough.
    Unclear { kind: String },
    /// It has the size of no known kind.
    UnknownSize,
}

/// A disc that is not a part.
#[derive(Clone, Debug)]
pub(super) struct OtherDisc {
    pub disc: DetectedDisc,
    pub why: RejectionReason,
}

/// Names the detections of the part finder and the additional discs of the survey.
pub(super) fn named(
    mut found: Vec<Detection>,
    survey: &Survey,
    table: &Table,
    setting: &LocateSetup,
    side: SideSource,
    colors: Option<&RgbImage>,
) -> (Vec<NamedPart>, Vec<OtherDisc>) {
    let judge = KindJudge { table, setting, side };
    let mut parts: Vec<(NamedPart, Option<&DetectedDisc>)> = Vec::new();
    let mut others = Vec::new();
    for disc in &survey.discs {
        let (near, far): (Vec<_>, Vec<_>) = found.into_iter().partition(|part| is_near(part, disc));
        found = far;
        match judge.part(disc, near.into_iter().next()) {
            Some(part) => parts.push((part, Some(disc))),
            None if judge.is_speck(disc) => {}
            None => others.push(judge.other(disc)),
        }
    }
    parts.extend(found.into_iter().map(|part| (judge.unmeasured(part), None)));
    judge_tones(&mut parts, setting, colors);
    let (parts, unclear): (Vec<_>, Vec<_>) =
        parts.into_iter().partition(|(named, disc)| named.part.score >= LEAST_SCORE || disc.is_none());
    others.extend(unclear.into_iter().filter_map(|(_, disc)| disc).map(|disc| judge.unclear(disc)));
    let mut parts: Vec<NamedPart> = parts.into_iter().map(|(part, _)| part).collect();
    let place = |part: &NamedPart| part.part.center_px;
    parts.sort_by(|a, b| place(a).y.total_cmp(&place(b).y).then(place(a).x.total_cmp(&place(b).x)));
    others.sort_by(|a, b| a.disc.center_px.y.total_cmp(&b.disc.center_px.y));
    (parts, others)
}

/// True if the part finder's detection is of this disc.
pub(super) fn is_near(part: &Detection, disc: &DetectedDisc) -> bool {
    (disc.center_px - part.center_px).norm() < 0.5 * part.radius_px
}

/// Lowers the scores of coins whose tone is that of another metal.
fn judge_tones(parts: &mut [(NamedPart, Option<&DetectedDisc>)], setting: &LocateSetup, colors: Option<&RgbImage>) {
    // a rig's parts may be painted; without a rig the kinds are real coins
    if setting.has_rig() {
        return;
    }
    let (measured, metals): (Vec<&mut NamedPart>, Vec<_>) = parts
        .iter_mut()
        .filter_map(|(named, disc)| {
            let metal = metal_of(setting.kind_name(named.part.kind));
            disc.map(|disc| (named, (metal, disc)))
        })
        .unzip();
    for (named, _) in measured.into_iter().zip(contradicted(&metals, colors)).filter(|(_, is_other)| *is_other) {
        named.part.score *= OTHER_TONE;
        named.doubts.push("tone of another metal".into());
    }
}

struct KindJudge<'a> {
    table: &'a Table,
    setting: &'a LocateSetup,
    side: SideSource,
}

impl KindJudge<'_> {
    /// Kind with the diameter nearest to a disc's, and the relative deviation from it.
    fn nearest<'k>(&self, disc: &DetectedDisc, kinds: &'k [PartKind]) -> Option<(usize, &'k PartKind, f64)> {
        let off = |kind: &PartKind| disc.radius_m / seen_radius_m(self.table, disc.at_m, kind) - 1.0;
        let all = kinds.iter().enumerate().map(|(i, kind)| (i, kind, off(kind)));
        all.min_by(|a, b| a.2.abs().total_cmp(&b.2.abs()))
    }

    fn has_polarity(&self, disc: &DetectedDisc) -> bool {
        (disc.level < 1.0) == self.setting.dark_parts
    }

    /// The disc as a part, with the part finder's detection if there is one; `None` for a disc of
    /// another kind.
    fn part(&self, disc: &DetectedDisc, found: Option<Detection>) -> Option<NamedPart> {
        let (kind, spec, off) = self.nearest(disc, &self.setting.kinds)?;
        let clear = disc.outline_share >= LEAST_SHARE && disc.crispness >= LEAST_CRISPNESS;
        let allowed = if found.is_some() { MOST_OFF } else { MOST_OFF_ALONE };
        if off.abs() > allowed || !(found.is_some() || clear && self.has_polarity(disc)) {
            return None;
        }
        let fill = found.as_ref().map_or(1.0, |part| part.score);
        let agrees = |part: &Detection| part.kind == kind && (part.radius_px / disc.radius_px - 1.0).abs() < 0.02;
        let part = found.filter(agrees).unwrap_or_else(|| self.detection(disc, kind, spec));
        let mut doubts = Vec::new();
        let mut score = fill;
        let mut weigh = |factor: f64, doubt: &dyn Fn() -> String| {
            score *= factor;
            if factor < DOUBT_THRESHOLD {
                doubts.push(doubt());
            }
        };
        weigh(1.0 / (1.0 + (off / HALF_OFF).powi(2)), &|| format!("diameter {:+.1} %", 100.0 * off));
        let share = disc.outline_share;
        weigh((share / WHOLE_OUTLINE).min(1.0), &|| format!("{:.0} % of its outline shows", 100.0 * share));
        let sharp = 0.1 + 0.9 * (disc.crispness - BLURRED) / (SHARP - BLURRED);
        weigh(sharp.clamp(0.1, 1.0), &|| "its rim is soft".into());
        score *= self.scale_factor();
        let part = Detection { score, ..part };
        Some(NamedPart { part, diameter_m: 2.0 * disc.radius_m, doubts })
    }

    fn scale_factor(&self) -> f64 {
        match self.side {
            SideSource::Given | SideSource::Rig | SideSource::Parts => 1.0,
            SideSource::TwoKinds | SideSource::Assumed => UNSURE_SCALE,
        }
    }

    fn unmeasured(&self, part: Detection) -> NamedPart {
        let diameter_m = 2.0 * part.radius_px / self.table.px_per_m_at(part.position_m);
        let score = UNMEASURED * self.scale_factor() * part.score;
        NamedPart { part: Detection { score, ..part }, diameter_m, doubts: vec!["its outline is not clear".into()] }
    }

    /// Detection of a part seen only by the survey: its foot is displaced by half the parallax of its top, towards the
    /// point below the camera.
    fn detection(&self, disc: &DetectedDisc, kind: usize, spec: &PartKind) -> Detection {
        Detection {
            kind,
            center_px: disc.center_px,
            radius_px: disc.radius_px,
            position_m: disc.at_m - self.table.parallax(disc.at_m, spec.thickness_m).0 / 2.0,
            score: 1.0,
            covariance_px2: disc.covariance_px2,
        }
    }

    fn other(&self, disc: &DetectedDisc) -> OtherDisc {
        let name = |kinds| {
            let near = self.nearest(disc, kinds).filter(|(.., off)| off.abs() <= MOST_OFF_ALONE);
            near.map(|(_, kind, _)| kind.name.clone())
        };
        let why = match (name(&self.setting.kinds), name(&self.setting.known)) {
            (_, kind) if !self.has_polarity(disc) => RejectionReason::OtherPolarity { kind },
            (Some(kind), _) => RejectionReason::Unclear { kind },
            (None, Some(kind)) => RejectionReason::NotLookedFor { kind },
            (None, None) => RejectionReason::UnknownSize,
        };
        OtherDisc { disc: disc.clone(), why }
    }

    fn unclear(&self, disc: &DetectedDisc) -> OtherDisc {
        let kind = self.nearest(disc, &self.setting.kinds).map(|(_, kind, _)| kind.name.clone()).unwrap_or_default();
        OtherDisc { disc: disc.clone(), why: RejectionReason::Unclear { kind } }
    }

    fn is_speck(&self, disc: &DetectedDisc) -> bool {
        let smallest = self.setting.known.iter().map(|kind| kind.radius_m).fold(f64::INFINITY, f64::min);
        (disc.level - 1.0).abs() < SPECK_CONTRAST && disc.radius_m < SPECK_SIZE * smallest
    }
}
