//! Names and scores of what was found: parts, and discs that are none of the kinds looked for.

use image::RgbImage;

use super::scale::SideSource;
use super::setting::Setting;
use super::tone::{contradicted, metal_of};
use upm_core::rig::PartKind;
use upm_perception::vision::{Detection, Disc, Survey, Table, seen_radius_m};

/// How far a disc's diameter may be from its kind's, as a part of it: one that the part finder found, and another.
const MOST_OFF: f64 = 0.05;
const MOST_OFF_ALONE: f64 = 0.035;
/// A disc that the part finder did not find is a part where it shows this much of its outline, this sharp.
const LEAST_SHARE: f64 = 0.55;
const LEAST_CRISPNESS: f64 = 0.4;
/// A diameter off by this halves a score.
const HALF_OFF: f64 = 0.03;
/// Share of an outline and sharpness of a rim that leave a score as it is; the sharpness that leaves a tenth.
const WHOLE_OUTLINE: f64 = 0.85;
const SHARP: f64 = 0.57;
const BLURRED: f64 = 0.30;
/// A score where the tone is another metal's, where no outline was measured, and on a plate whose side is not sure.
const OTHER_TONE: f64 = 0.6;
const UNMEASURED: f64 = 0.6;
const UNSURE_SCALE: f64 = 0.9;
/// A lower score is no name: the disc is reported as unclear.
const LEAST_SCORE: f64 = 0.4;
/// Below these a factor is told as a doubt.
const TOLD: f64 = 0.85;
/// Discs as faint as this and as small, against the smallest known kind, are specks.
const SPECK_CONTRAST: f64 = 0.15;
const SPECK_SIZE: f64 = 0.6;

/// A part with what speaks against it.
#[derive(Clone, Debug)]
pub(super) struct NamedPart {
    pub part: Detection,
    pub diameter_m: f64,
    pub doubts: Vec<String>,
}

/// Why a disc is no part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Unnamed {
    /// It has the size of a kind that is not looked for.
    NotLookedFor { kind: String },
    /// It is lighter than the plate where parts are darker, or darker where they are lighter.
    OtherPolarity { kind: Option<String> },
    /// It has about the size of a kind that is looked for; its outline shows too little of it.
    Unclear { kind: String },
    /// It has the size of no known kind.
    UnknownSize,
}

/// A disc that is no part.
#[derive(Clone, Debug)]
pub(super) struct OtherDisc {
    pub disc: Disc,
    pub why: Unnamed,
}

/// Names what the part finder found and what the survey found besides.
pub(super) fn named(
    found: Vec<Detection>,
    survey: &Survey,
    table: &Table,
    setting: &Setting,
    side: SideSource,
    colors: Option<&RgbImage>,
) -> (Vec<NamedPart>, Vec<OtherDisc>) {
    let judge = Judge { table, setting, side };
    let mut taken = vec![false; survey.discs.len()];
    let mut parts: Vec<(NamedPart, Option<&Disc>)> = Vec::new();
    let mut others = Vec::new();
    for detection in found {
        let near = |disc: &Disc| (disc.center_px - detection.center_px).norm() < 0.5 * detection.radius_px;
        let Some(i) = survey.discs.iter().position(near) else {
            parts.push((judge.unmeasured(detection), None));
            continue;
        };
        if std::mem::replace(&mut taken[i], true) {
            continue;
        }
        let disc = &survey.discs[i];
        match judge.part(disc, Some(detection)) {
            Some(part) => parts.push((part, Some(disc))),
            None => others.push(judge.other(disc)),
        }
    }
    for (disc, _) in survey.discs.iter().zip(&taken).filter(|(_, taken)| !**taken) {
        match judge.part(disc, None) {
            Some(part) => parts.push((part, Some(disc))),
            None => others.push(judge.other(disc)),
        }
    }
    others.retain(|other| !judge.is_speck(&other.disc));
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

/// Lowers the scores of coins that have another metal's tone.
fn judge_tones(parts: &mut [(NamedPart, Option<&Disc>)], setting: &Setting, colors: Option<&RgbImage>) {
    if !setting.has_metals() {
        return;
    }
    let measured: Vec<usize> = (0..parts.len()).filter(|&i| parts[i].1.is_some()).collect();
    let of = |&i: &usize| parts[i].1.map(|disc| (metal_of(setting.kind_name(parts[i].0.part.kind)), disc));
    let metals: Vec<_> = measured.iter().filter_map(of).collect();
    for (i, is_other) in measured.into_iter().zip(contradicted(&metals, colors)) {
        if is_other {
            let (named, _) = &mut parts[i];
            named.part.score *= OTHER_TONE;
            named.doubts.push("tone of another metal".into());
        }
    }
}

struct Judge<'a> {
    table: &'a Table,
    setting: &'a Setting,
    side: SideSource,
}

impl Judge<'_> {
    /// The kind whose diameter is nearest to a disc's, and how far that is, as a part of it.
    fn nearest<'k>(&self, disc: &Disc, kinds: &'k [PartKind]) -> Option<(usize, &'k PartKind, f64)> {
        let off = |kind: &PartKind| disc.radius_m / seen_radius_m(self.table, disc.at_m, kind) - 1.0;
        let all = kinds.iter().enumerate().map(|(i, kind)| (i, kind, off(kind)));
        all.min_by(|a, b| a.2.abs().total_cmp(&b.2.abs()))
    }

    fn has_polarity(&self, disc: &Disc) -> bool {
        (disc.level < 1.0) == self.setting.dark_parts
    }

    /// A disc as a part, found by the part finder too or not; `None` where it is none of the kinds looked for.
    fn part(&self, disc: &Disc, found: Option<Detection>) -> Option<NamedPart> {
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
            if factor < TOLD {
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

    /// Where the survey alone saw a part: its foot is half the parallax of its top nearer to the point below the camera.
    fn detection(&self, disc: &Disc, kind: usize, spec: &PartKind) -> Detection {
        Detection {
            kind,
            center_px: disc.center_px,
            radius_px: disc.radius_px,
            position_m: disc.at_m - self.table.parallax(disc.at_m, spec.thickness_m).0 / 2.0,
            score: 1.0,
            covariance_px2: disc.covariance_px2,
        }
    }

    fn other(&self, disc: &Disc) -> OtherDisc {
        let name = |kinds| {
            let near = self.nearest(disc, kinds).filter(|(.., off)| off.abs() <= MOST_OFF_ALONE);
            near.map(|(_, kind, _)| kind.name.clone())
        };
        let why = match (name(&self.setting.kinds), name(&self.setting.known)) {
            (_, kind) if !self.has_polarity(disc) => Unnamed::OtherPolarity { kind },
            (Some(kind), _) => Unnamed::Unclear { kind },
            (None, Some(kind)) => Unnamed::NotLookedFor { kind },
            (None, None) => Unnamed::UnknownSize,
        };
        OtherDisc { disc: disc.clone(), why }
    }

    fn unclear(&self, disc: &Disc) -> OtherDisc {
        let kind = self.nearest(disc, &self.setting.kinds).map_or(String::new(), |(_, kind, _)| kind.name.clone());
        OtherDisc { disc: disc.clone(), why: Unnamed::Unclear { kind } }
    }

    fn is_speck(&self, disc: &Disc) -> bool {
        let smallest = self.setting.known.iter().map(|kind| kind.radius_m).fold(f64::INFINITY, f64::min);
        (disc.level - 1.0).abs() < SPECK_CONTRAST && disc.radius_m < SPECK_SIZE * smallest
    }
}
