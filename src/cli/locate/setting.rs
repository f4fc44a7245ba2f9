//! Plate, parts and camera that pictures are searched for.

use crate::cli::args::LocateArgs;
use crate::cli::output::Failure;
use upm_core::geometry::Lens;
use upm_core::rig::PartKind;
use upm_core::signal::Frame;
use upm_core::units::{INCH_M, m_from_mm};
use upm_runner::config::{KindSpec, RigSpec, one_of};

/// Longest side of a plate, mm.
const MOST_SIDE_MM: f64 = 1e5;

/// Plate, parts and camera.
pub(super) struct Setting {
    pub plate_side_m: f64,
    pub kinds: Vec<PartKind>,
    pub dark_parts: bool,
    camera: Option<RigCamera>,
}

/// Camera of a rig.
struct RigCamera {
    rig: String,
    frame_size_px: [usize; 2],
    lens: Lens,
}

impl Setting {
    /// As the rig file has it, or else the papers' table as changed by the options.
    pub(super) fn of(args: &LocateArgs) -> Result<Self, Failure> {
        let Some(path) = &args.rig else { return Self::without_rig(args) };
        let RigSpec { model, kinds, .. } = RigSpec::load(path).map_err(Failure::of_files)?;
        Ok(Self {
            plate_side_m: model.plate_side_m,
            kinds: chosen(&args.kinds, &kinds)?,
            dark_parts: model.dark_parts,
            camera: Some(RigCamera { rig: model.name, frame_size_px: model.frame_size_px, lens: model.lens }),
        })
    }

    fn without_rig(args: &LocateArgs) -> Result<Self, Failure> {
        let plate_side_m = match args.plate_side_mm {
            None => 8.0 * INCH_M,
            Some(side_mm) if side_mm > 0.0 && side_mm <= MOST_SIDE_MM => m_from_mm(side_mm),
            Some(side_mm) => {
                let allowed = format!("a length above 0, up to {MOST_SIDE_MM} mm");
                return Err(Failure::bad_input(format!("--plate-side-mm: expected {allowed}, found {side_mm}")));
            }
        };
        let coins = RigSpec::upm_1().map_err(Failure::faults)?.kinds;
        let pennies = ["penny".to_owned()];
        let kinds = chosen(if args.kinds.is_empty() { &pennies } else { &args.kinds }, &coins)?;
        Ok(Self { plate_side_m, kinds, dark_parts: !args.light_parts, camera: None })
    }

    /// Name of that kind.
    pub(super) fn kind_name(&self, kind: usize) -> &str {
        self.kinds.get(kind).map_or("?", |kind| kind.name.as_str())
    }

    /// The lens that `frame` was taken through; [`Lens::long`] without a rig.
    pub(super) fn lens(&self, frame: &Frame) -> Result<Lens, String> {
        let Some(camera) = &self.camera else {
            return Ok(Lens::long([frame.width, frame.height]));
        };
        let [width, height] = camera.frame_size_px;
        if [frame.width, frame.height] != [width, height] {
            let (found, rig) = (format!("{}x{} px", frame.width, frame.height), &camera.rig);
            return Err(format!("expected {width}x{height} px from the camera of rig {rig}, found {found}"));
        }
        Ok(camera.lens)
    }
}

/// The kinds called `names`, or all; those too small to be seen are none.
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
