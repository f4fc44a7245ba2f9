//! Messages about discs that are not parts, and about missing parts or tables.

use super::naming::{OtherDisc, RejectionReason};
use super::scale::{PlateSide, SideCandidate, SideSource};
use super::setup::LocateSetup;
use upm_core::signal::Frame;
use upm_core::units::mm_from_m;
use upm_perception::vision::{Survey, TableFault};

/// Relative difference in diameter below which discs are grouped.
const ONE_SIZE: f64 = 0.03;

/// One line for each group of similar discs that are not parts.
pub(super) fn about_others(others: &[OtherDisc], setting: &LocateSetup) -> Vec<String> {
    let mut sorted: Vec<&OtherDisc> = others.iter().collect();
    sorted.sort_by(|a, b| a.disc.radius_m.total_cmp(&b.disc.radius_m));
    let alike = |a: &&OtherDisc, b: &&OtherDisc| a.why == b.why && b.disc.radius_m / a.disc.radius_m - 1.0 < ONE_SIZE;
    sorted.chunk_by(alike).filter_map(|group| about(group, setting)).collect()
}

fn about(group: &[&OtherDisc], setting: &LocateSetup) -> Option<String> {
    let middle = group.get(group.len() / 2)?;
    let discs = if group.len() == 1 { "1 disc".to_owned() } else { format!("{} discs", group.len()) };
    let size = format!("{discs} of {:.1} mm", 2.0 * mm_from_m(middle.disc.radius_m));
    Some(match (&middle.why, suggestion(&middle.why, setting)) {
        (RejectionReason::NotLookedFor { kind }, Some(option)) => format!("{size}: {kind}? use {option}"),
        (RejectionReason::Unclear { kind }, _) => {
            format!("{size}: {kind}? size, rim or tone do not fit well enough to say")
        }
        (RejectionReason::OtherPolarity { kind }, option) => {
            let tone = if setting.dark_parts { "lighter" } else { "darker" };
            let kind = kind.as_ref().map_or(String::new(), |kind| format!(": {kind}?"));
            let option = option.map_or(String::new(), |option| format!("; use {option}"));
            format!("{size}, {tone} than the plate{kind}{option}")
        }
        _ => format!("{size}: no known kind ({})", known_sizes(setting)),
    })
}

/// Command line option with which such a disc would be named.
pub(super) fn suggestion(why: &RejectionReason, setting: &LocateSetup) -> Option<String> {
    match why {
        RejectionReason::NotLookedFor { kind } => {
            let names: Vec<&str> = setting.kinds.iter().map(|kind| kind.name.as_str()).chain([kind.as_str()]).collect();
            Some(format!("--kinds {}", names.join(",")))
        }
        RejectionReason::OtherPolarity { .. } if setting.has_rig() => None,
        RejectionReason::OtherPolarity { .. } if setting.dark_parts => Some("--light-parts".to_owned()),
        RejectionReason::OtherPolarity { .. } => Some("no --light-parts".to_owned()),
        RejectionReason::Unclear { .. } | RejectionReason::UnknownSize => None,
    }
}

fn known_sizes(setting: &LocateSetup) -> String {
    let size = |kind: &upm_core::rig::PartKind| format!("{} {:.2}", kind.name, 2.0 * mm_from_m(kind.radius_m));
    setting.known.iter().map(size).collect::<Vec<_>>().join(", ")
}

/// Basis of the plate's side where neither the command line nor a rig gives it.
pub(super) fn about_side(side: &PlateSide, setting: &LocateSetup) -> Option<String> {
    let basis = match side.source {
        SideSource::Given | SideSource::Rig => return None,
        SideSource::Parts | SideSource::TwoKinds => ", from the ratio of the parts' sizes".to_owned(),
        SideSource::Assumed if side.candidates.is_empty() => " assumed; --plate-side-mm sets it".to_owned(),
        SideSource::Assumed => {
            let fit = |candidate: &SideCandidate| {
                let kinds = setting.known_names(&candidate.kinds).join(" and ");
                format!("{:.0} mm for {kinds}", mm_from_m(candidate.side_m))
            };
            let fits = side.candidates.iter().map(fit).collect::<Vec<_>>().join(", ");
            format!(" assumed; the sizes allow {fits}; --plate-side-mm sets it")
        }
    };
    Some(format!("plate: {:.1} mm{basis}", mm_from_m(side.side_m)))
}

/// Message if no part was found, with the discs that were.
pub(super) fn no_parts_message(others: &[OtherDisc], survey: &Survey, setting: &LocateSetup) -> String {
    let seen = match others {
        [] => "no disc was found".to_owned(),
        [_] => "1 disc was found".to_owned(),
        several => format!("{} discs were found", several.len()),
    };
    let [darker, lighter] = [1.0 - survey.darkest, survey.lightest - 1.0].map(|share| 100.0 * share.max(0.0));
    let remedy = match () {
        () if !others.is_empty() => "",
        () if setting.dark_parts && lighter > 2.0 * darker.max(5.0) && !setting.has_rig() => {
            "; --light-parts looks for parts lighter than the plate"
        }
        () if darker.max(lighter) < 10.0 => "; the plate looks bare",
        () => "; --stages DIR draws the inspected stages",
    };
    format!(
        "no parts: the table was found, {seen}; darkest place {darker:.0} % darker than the plate, lightest {lighter:.0} % \
         lighter{remedy}"
    )
}

/// Fault of the table search, with the remedy.
pub(super) fn about_table(fault: &TableFault, frame: &Frame) -> String {
    let remedy = match fault {
        TableFault::NoEdges => {
            let level = |share: f64| quantile(&frame.pixels, share);
            format!("levels {} to {}: plate and ground need to differ", level(0.01), level(0.99))
        }
        TableFault::TooFewLines { .. } | TableFault::NotASquare => {
            "the plate's four sides need to stand out from the ground; --stages DIR draws the edges found".to_owned()
        }
        TableFault::CutByFrame => "the whole plate has to be in the picture".to_owned(),
        TableFault::SideHidden { .. } => "that side has to be in view".to_owned(),
        TableFault::MoreThanOne => "crop the picture to one".to_owned(),
        _ => return fault.to_string(),
    };
    format!("{fault}; {remedy}")
}

/// Gray level below which that share of the pixels is.
fn quantile(pixels: &[u8], share: f64) -> u8 {
    let mut levels = pixels.to_vec();
    let index = (share * levels.len() as f64) as usize;
    if levels.is_empty() { 0 } else { *levels.select_nth_unstable(index).1 }
}
