//! Messages about discs that are not parts, and about missing parts or tables.

use super::naming::{OtherDisc, RejectionReason};
use super::scale::{PlateSide, SideSource};
use super::setup::LocateSetup;
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
pub(super) fn about_side(side: &PlateSide) -> Option<String> {
    let basis = match side.source {
        SideSource::Given | SideSource::Rig => return None,
        SideSource::Parts | SideSource::TwoKinds => ", from the ratio of the parts' sizes",
        SideSource::Assumed => " assumed; --plate-side-mm sets it",
    };
    Some(format!("plate: {:.1} mm{basis}", mm_from_m(side.side_m)))
}

/// Message if no part was found, with the number of discs that were.
pub(super) fn no_parts_message(others: &[OtherDisc], survey: &Survey) -> String {
    let [darker, lighter] = [1.0 - survey.darkest, survey.lightest - 1.0].map(|share| 100.0 * share.max(0.0));
    let seen = match others {
        [] => format!("no disc was found; the plate is {darker:.0} % darker and {lighter:.0} % lighter in places"),
        [_] => "1 disc was found".to_owned(),
        several => format!("{} discs were found", several.len()),
    };
    format!("no parts: the table was found, {seen}")
}

/// Fault of the table search, with the remedy.
pub(super) fn about_table(fault: &TableFault) -> String {
    let remedy = match fault {
        TableFault::NoEdges => "plate and ground need to differ",
        TableFault::TooFewLines { .. } | TableFault::NotASquare => {
            "the plate's four sides need to stand out from the ground; --stages DIR draws the edges found"
        }
        TableFault::CutByFrame => "the whole plate has to be in the picture",
        TableFault::SideHidden { .. } => "that side has to be in view",
        TableFault::MoreThanOne => "crop the picture to one",
        _ => return fault.to_string(),
    };
    format!("{fault}; {remedy}")
}
