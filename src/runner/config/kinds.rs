use super::read::{NAMES, is_name};
use super::rig_file::RigFile;
use upm_core::document::{Diagnostics, Path};
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_core::units::{m_from_mm, written_mm};
use upm_sim::PartParams;

/// US coins: name, diameter mm, mass g, height mm.
const COINS: [(&str, f64, f64, f64); 4] = [
    ("penny", 19.05, 2.50, 1.52),
    ("nickel", 21.21, 5.00, 1.95),
    ("dime", 17.91, 2.27, 1.35),
    ("quarter", 24.26, 5.67, 1.75),
];

/// A kind of part with the properties that only the simulation knows.
#[derive(Clone, Debug, PartialEq)]
pub struct KindSpec {
    /// Name, outline, height.
    pub kind: PartKind,
    /// Mass of one part, kg.
    pub mass_kg: f64,
    /// Coulomb friction against the plate.
    pub friction: f64,
}

/// A group of parts of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct PartGroup {
    /// Index into the rig's kinds.
    pub kind: usize,
    /// Number of parts; 1 if there is a position.
    pub count: usize,
    /// Name of a single part.
    pub name: Option<String>,
    /// Start position, m; `None` for a random one.
    pub position_m: Option<Vec2>,
}

/// Least radius of a part that the camera must find, m.
pub(super) const LEAST_SEEN_RADIUS_M: f64 = 5e-4;

impl KindSpec {
    /// Parameters of a simulated part of this kind, with the kind's mean friction.
    pub fn part(&self) -> PartParams {
        let PartKind { radius_m, thickness_m, .. } = self.kind;
        PartParams { radius_m, thickness_m, mass_kg: self.mass_kg, friction: self.friction }
    }

    /// True if the camera can find parts of this kind; smaller ones, points included, are for open-loop experiments
    /// only.
    pub fn can_be_seen(&self) -> bool {
        self.kind.radius_m >= LEAST_SEEN_RADIUS_M
    }
}

/// The four coins, then the rig's kinds by name.
pub(super) fn kinds_of(rig: &RigFile, at: &Path, faults: &mut Diagnostics) -> Vec<KindSpec> {
    let friction = rig.friction.coefficient;
    let coin = |&(name, d, m, h): &(_, _, _, _)| disc(name, m_from_mm(d), m * 1e-3, m_from_mm(h), friction);
    let mut kinds: Vec<KindSpec> = COINS.iter().map(coin).collect();
    for (name, kind) in &rig.kinds {
        let at = at.key("kinds").key(name);
        faults.require(is_name(name), &at, format!("{name:?}"), NAMES);
        let known = COINS.iter().any(|(coin, ..)| coin == name);
        faults.require(!known, &at, format!("{name:?}"), "a name other than penny, nickel, dime, quarter");
        let allowed = format!("up to {} (the plate's side)", written_mm(rig.plate.side_m));
        let fits = kind.diameter_m <= rig.plate.side_m;
        faults.require(fits, at.key("diameter_mm"), written_mm(kind.diameter_m), allowed);
        kinds.push(disc(name, kind.diameter_m, kind.mass_kg, kind.thickness_m, kind.friction.unwrap_or(friction)));
    }
    kinds
}

fn disc(name: &str, diameter_m: f64, mass_kg: f64, thickness_m: f64, friction: f64) -> KindSpec {
    let kind = PartKind { name: name.to_owned(), radius_m: 0.5 * diameter_m, thickness_m };
    KindSpec { kind, mass_kg, friction }
}

/// Kind of each part in the order of the job.
pub(super) fn each_kind(groups: &[PartGroup]) -> Vec<usize> {
    groups.iter().flat_map(|group| std::iter::repeat_n(group.kind, group.count)).collect()
}

/// Id of each part, in the order of the job: its name, or kind and number within it (`penny-1`). A kind that does not
/// exist is a `part`.
pub(super) fn part_ids(groups: &[PartGroup], kinds: &[KindSpec]) -> Vec<String> {
    let each = each_kind(groups);
    let number = |i: usize, kind: &usize| each.iter().take(i + 1).filter(|other| *other == kind).count();
    let name = |kind: &usize| kinds.get(*kind).map_or("part", |spec| spec.kind.name.as_str());
    let given = groups.iter().flat_map(|group| std::iter::repeat_n(&group.name, group.count));
    let id = |((i, kind), given): ((usize, &usize), &Option<String>)| {
        given.clone().unwrap_or_else(|| format!("{}-{}", name(kind), number(i, kind)))
    };
    each.iter().enumerate().zip(given).map(id).collect()
}
