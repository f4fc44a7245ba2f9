//! Plate, parts and camera assumed in a search.

use super::scale::SideSource;
use crate::cli::args::LocateArgs;
use crate::cli::output::Failure;
use upm_core::geometry::Lens;
use upm_core::rig::{PartKind, RigModel};
use upm_core::signal::Frame;
use upm_core::units::{INCH_M, m_from_mm};
use upm_runner::config::{KindSpec, RigSpec, one_of};

/// Longest side of a plate, mm.
const MOST_SIDE_MM: f64 = 1e5;

/// Side of the papers' plate, m.
const PAPERS_SIDE_M: f64 = 8.0 * INCH_M;
/// Focal lengths tried without a rig, in longer sides of the picture: from a distant camera, which sees all parts from
/// straight above, to a telephone's.
const FOCAL_SIDES: [f64; 4] = [4.0, 2.0, 1.2, 0.8];

/// Plate, parts and camera of a search.
pub(super) struct LocateSetup {
    /// The plate's side, m, and its source; `None` if neither the command line nor the rig gives it.
    pub plate_side: Option<(f64, SideSource)>,
    /// Kinds to look for.
    pub kinds: Vec<PartKind>,
    /// All kinds with a name.
    pub known: Vec<PartKind>,
    pub dark_parts: bool,
    /// The rig, with the size and the lens of its camera.
    rig: Option<RigModel>,
}

impl LocateSetup {
    /// Setting of the rig file, or of the papers' table with the changes of the options.
    pub(super) fn of(args: &LocateArgs) -> Result<Self, Failure> {
        let Some(path) = &args.rig else { return Self::without_rig(args) };
        let RigSpec { model, kinds, .. } = RigSpec::load(path).map_err(Failure::of_files)?;
        Ok(Self {
            plate_side: Some((model.plate_side_m, SideSource::Rig)),
            kinds: chosen(&args.kinds, &kinds)?,
            known: chosen(&[], &kinds)?,
            dark_parts: model.dark_parts,
            rig: Some(model),
        })
    }

    fn without_rig(args: &LocateArgs) -> Result<Self, Failure> {
        let plate_side = match args.plate_side_mm {
            None => None,
            Some(side_mm) if side_mm > 0.0 && side_mm <= MOST_SIDE_MM => Some((m_from_mm(side_mm), SideSource::Given)),
            Some(side_mm) => {
                let allowed = format!("a length above 0, up to {MOST_SIDE_MM} mm");
                return Err(Failure::bad_input(format!("--plate-side-mm: expected {allowed}, found {side_mm}")));
            }
        };
        let coins = RigSpec::upm_1().map_err(Failure::faults)?.kinds;
        let (kinds, known) = (chosen(&args.kinds, &coins)?, chosen(&[], &coins)?);
        Ok(Self { plate_side, kinds, known, dark_parts: !args.light_parts, rig: None })
    }

    pub(super) fn has_rig(&self) -> bool {
        self.rig.is_some()
    }

    /// Names of some of the known kinds.
    pub(super) fn known_names(&self, kinds: &[usize]) -> Vec<&str> {
        kinds.iter().filter_map(|&kind| self.known.get(kind)).map(|kind| kind.name.as_str()).collect()
    }

    /// The plate's side, m; the papers' if it is unknown.
    pub(super) fn assumed_side_m(&self) -> f64 {
        self.plate_side.map_or(PAPERS_SIDE_M, |(side_m, _)| side_m)
    }

    /// Name of the kind with this index.
    pub(super) fn kind_name(&self, kind: usize) -> &str {
        self.kinds.get(kind).map_or("?", |kind| kind.name.as_str())
    }

    /// Lenses through which `frame` may have been taken, the most likely first: the rig's, or ideal ones.
    pub(super) fn lenses(&self, frame: &Frame) -> Result<Vec<Lens>, String> {
        let Some(rig) = &self.rig else {
            let lens = |focal_sides| Lens::centered([frame.width, frame.height], focal_sides);
            return Ok(FOCAL_SIDES.map(lens).into());
        };
        let [width, height] = rig.frame_size_px;
        if [frame.width, frame.height] != [width, height] {
            let (found, rig) = (format!("{}x{} px", frame.width, frame.height), &rig.name);
            return Err(format!("expected {width}x{height} px from the camera of rig {rig}, found {found}"));
        }
        Ok(vec![rig.lens])
    }
}

/// Kinds called `names`, or all of them; kinds too small to be seen do not count.
fn chosen(names: &[String], kinds: &[KindSpec]) -> Result<Vec<PartKind>, Failure> {
    let seen = || kinds.iter().filter(|spec| spec.can_be_seen()).map(|spec| &spec.kind);
    for name in names {
        if seen().all(|kind| kind.name != *name) {
            let allowed: Vec<&str> = seen().map(|kind| kind.name.as_str()).collect();
            return Err(Failure::bad_input(format!("--kinds: expected {}, found {name:?}", one_of(name, &allowed))));
        }
    }
    Ok(seen().filter(|kind| names.is_empty() || names.contains(&kind.name)).cloned().collect())
}
