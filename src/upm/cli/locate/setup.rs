//! Facts known before a search: plane, scale, kinds of parts and camera.

use crate::cli::args::{LocateArgs, PlateInPicture};
use crate::cli::output::Failure;
use upm_core::geometry::Vec2;
use upm_core::rig::{PartKind, RigModel};
use upm_core::units::m_from_mm;
use upm_runner::config::{RigSpec, coin_set, one_of};

/// Longest side of a plate, mm.
const MOST_SIDE_MM: f64 = 1e5;

/// Where the plane of the parts is in the picture.
pub(super) enum Plane {
    /// Inside four lines that are to be found.
    Found,
    /// Between these corners, px.
    Corners([Vec2; 4]),
    /// Everywhere.
    Whole,
}

/// Scale as far as it is known.
pub(super) enum Scale {
    Unknown,
    /// Sides of the plate, m.
    Size([f64; 2]),
    PxPerM(f64),
    /// A part of this kind, an index into the known kinds, and its place, px.
    Part(usize, Option<Vec2>),
}

/// Plane, scale, parts and camera of a search.
pub(super) struct LocateSetup {
    pub plane: Plane,
    pub scale: Scale,
    /// All kinds with a name.
    pub known: Vec<PartKind>,
    /// True for each that is looked for.
    pub wanted: Vec<bool>,
    pub rig: Option<RigModel>,
}

impl LocateSetup {
    /// Facts from the options and the rig file.
    pub(super) fn of(args: &LocateArgs) -> Result<Self, Failure> {
        let (known, rig) = match &args.rig {
            None => (coin_set(&args.coins).map_err(Failure::of_files)?, None),
            Some(path) => {
                let RigSpec { model, kinds, .. } = RigSpec::load(path).map_err(Failure::of_files)?;
                (kinds.into_iter().filter(|kind| kind.can_be_seen()).map(|spec| spec.kind).collect(), Some(model))
            }
        };
        let mut wanted = vec![args.kinds.is_empty(); known.len()];
        for name in &args.kinds {
            wanted[kind_called(name, &known, "--kinds")?] = true;
        }
        let plane = match &args.corners {
            Some(corners) => {
                let places =
                    corners.iter().map(|text| place(text).ok_or_else(|| refused("--corners", "X,Y in px", text)));
                let places: Vec<Vec2> = places.collect::<Result<_, Failure>>()?;
                Plane::Corners(places.try_into().map_err(|_| Failure::bad_input("--corners: expected four places"))?)
            }
            None if args.plate == PlateInPicture::Whole => Plane::Whole,
            None => Plane::Found,
        };
        let scale = match &rig {
            Some(rig) => Scale::Size([rig.plate_side_m; 2]),
            None => scale(args, &known)?,
        };
        Ok(Self { plane, scale, known, wanted, rig })
    }
}

fn scale(args: &LocateArgs, known: &[PartKind]) -> Result<Scale, Failure> {
    let is_length = |mm: &f64| *mm > 0.0 && *mm <= MOST_SIDE_MM;
    if let Some(side_mm) = args.plate_side_mm {
        let allowed = format!("a length above 0, up to {MOST_SIDE_MM} mm");
        let side_mm = Some(side_mm).filter(is_length).ok_or_else(|| refused("--plate-side-mm", &allowed, side_mm))?;
        return Ok(Scale::Size([m_from_mm(side_mm); 2]));
    }
    if let Some(text) = &args.rectangle {
        let allowed = format!("two lengths above 0, up to {MOST_SIDE_MM} mm, as 297x210");
        let sides = numbers(text, 'x').filter(|sides| sides.iter().all(is_length));
        return Ok(Scale::Size(sides.ok_or_else(|| refused("--rectangle", &allowed, text))?.map(m_from_mm)));
    }
    if let Some(text) = &args.scale {
        let px_per_mm = text.strip_suffix("px/mm").and_then(|number| number.trim().parse().ok());
        let px_per_mm = px_per_mm.filter(|scale: &f64| *scale >= 1e-3 && *scale <= 1e4);
        let allowed = "a number from 0.001 to 10000 and its unit, as 12.3px/mm";
        return Ok(Scale::PxPerM(1e3 * px_per_mm.ok_or_else(|| refused("--scale", allowed, text))?));
    }
    let Some(text) = &args.scale_from else { return Ok(Scale::Unknown) };
    let (name, at) = text.split_once('@').map_or((text.as_str(), None), |(name, at)| (name, Some(at)));
    let kind = kind_called(name, known, "--scale-from")?;
    let place = |at: &str| place(at).ok_or_else(|| refused("--scale-from", "KIND@X,Y with X and Y in px", text));
    Ok(Scale::Part(kind, at.map(place).transpose()?))
}

fn kind_called(name: &str, known: &[PartKind], option: &str) -> Result<usize, Failure> {
    let names: Vec<&str> = known.iter().map(|kind| kind.name.as_str()).collect();
    let found = names.iter().position(|known| *known == name);
    found.ok_or_else(|| Failure::bad_input(format!("{option}: expected {}, found {name:?}", one_of(name, &names))))
}

fn refused(option: &str, allowed: &str, found: impl std::fmt::Display) -> Failure {
    Failure::bad_input(format!("{option}: expected {allowed}, found {found}"))
}

fn place(text: &str) -> Option<Vec2> {
    numbers(text, ',').map(Vec2::from)
}

fn numbers(text: &str, between: char) -> Option<[f64; 2]> {
    let (first, second) = text.split_once(between)?;
    let both = [first.trim().parse().ok()?, second.trim().parse().ok()?];
    both.iter().all(|number: &f64| number.is_finite()).then_some(both)
}
