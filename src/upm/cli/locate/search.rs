//! Search of one picture: plane, discs, scale, names.

use std::path::Path;

use serde::Serialize;

use super::naming::{NamedPart, OtherDisc, named};
use super::picture;
use super::scale::{PictureScale, ScaleFit, ScaleSource, Sizes};
use super::setup::{LocateSetup, Plane, Scale};
use crate::cli::output::Failure;
use upm_core::geometry::{Lens, Vec2};
use upm_core::rig::PartKind;
use upm_core::signal::Frame;
use upm_core::time::{Clock, MonotonicClock};
use upm_core::units::INCH_M;
use upm_perception::vision::{
    DetectedDisc, Table, TableError, focal_from_corners, locate_corners, locate_table, survey,
};

/// Side of the papers' plate, m: of a plate without a scale.
const PAPERS_SIDE_M: f64 = 8.0 * INCH_M;
/// Focal length of a camera about which nothing is known, in longer sides of the picture, and the deviation of such a
/// guess and of what a picture file says, relative.
const FOCAL_SIDES: f64 = 1.0;
const GUESS_SD: f64 = 0.6;
const FILE_SD: f64 = 0.05;
/// Standard deviation of corners that were found, and of those that a person gave, px.
const FOUND_SD_PX: f64 = 0.15;
const GIVEN_SD_PX: f64 = 3.0;
/// Cells along the short side of the averages in which a plate is searched, one after the other: the fewer, the less
/// remains of rulings, which are lines like its sides.
const CELLS: [usize; 3] = [50, 100, 200];
/// Most times that the tilt of a picture is corrected.
const LEANINGS: usize = 4;
/// Tolerances of a rectangle, as of [`Table::of_rectangle`].
const FOUND_OFF: [f64; 2] = [0.01, 0.02];
const GIVEN_OFF: [f64; 2] = [0.2, 0.3];

/// Result of the search of one picture.
pub(super) struct LocatedPicture {
    pub frame: Frame,
    pub table: Table,
    pub scale: PictureScale,
    pub parts: Vec<NamedPart>,
    /// Discs that are not parts.
    pub others: Vec<OtherDisc>,
    pub time_us: TimeUs,
}

/// Wall times of one picture, µs.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct TimeUs {
    /// Time to read and decode the file.
    pub decode: f64,
    pub table: f64,
    /// Time to find discs, measure, scale and name them.
    pub parts: f64,
}

/// Reads the picture at `image`, finds the plane and the discs on it, scales and names them.
pub(super) fn locate_picture(image: &Path, setting: &LocateSetup) -> Result<LocatedPicture, Failure> {
    let clock = MonotonicClock::new();
    let picture = picture::read(image)?;
    if let Some(bits) = picture.bits {
        tracing::info!("{}: 16-bit picture; using {bits} significant bits", image.display());
    }
    let decoded = clock.elapsed();
    let frame = picture.frame;
    let failed = |why: String| Failure::failed(format!("{}: {why}", image.display()));
    if let Some(rig) = setting.rig.as_ref().filter(|rig| rig.frame_size_px != [frame.width, frame.height]) {
        let ([width, height], name, image) = (rig.frame_size_px, &rig.name, image.display());
        let wanted = format!("{image}: expected {width}x{height} px from the camera of rig {name}");
        return Err(Failure::bad_input(format!("{wanted}, found {}x{} px", frame.width, frame.height)));
    }
    let plane = seen_plane(&frame, setting, picture.focal_sides)
        .map_err(|fault| failed(about_table(&fault, &setting.plane)))?;
    let found = clock.elapsed();
    let discs = survey(&frame, &plane.0);
    let leaning = match setting.plane {
        Plane::Whole => leaning(&frame, setting, picture.focal_sides, &discs),
        _ => Ok(None),
    };
    let doubt = leaning.as_ref().err().cloned();
    let (plane, discs) = leaning.ok().flatten().map_or((plane, discs), |(table, discs)| ((table, 0.0), discs));
    let (table, discs, mut scale) = scaled(plane, discs, setting).map_err(failed)?;
    scale.doubt = doubt.or(scale.doubt);
    let (parts, others) = named(&discs, &table, setting, &scale);
    let [decode, table_time, parts_time] =
        [decoded, found - decoded, clock.elapsed() - found].map(|time| 1e6 * time.as_secs_f64());
    let time_us = TimeUs { decode, table: table_time, parts: parts_time };
    Ok(LocatedPicture { frame, table, scale, parts, others, time_us })
}

/// The plane through the rig's lens, or through one that follows from the plate's corners, of a provisional size where
/// its scale is not known; and the relative deviation of the focal length.
fn seen_plane(frame: &Frame, setting: &LocateSetup, focal_sides: Option<f64>) -> Result<(Table, f64), TableError> {
    let picture_px = [frame.width, frame.height];
    let size_m = if let Scale::Size(size_m) = setting.scale { size_m } else { [PAPERS_SIDE_M; 2] };
    let through = |corners: [Vec2; 4], most_off: [f64; 2], sd_px: f64| {
        let size_m = as_it_lies(corners, size_m);
        let (lens, focal_sd) = match &setting.rig {
            Some(rig) => (rig.lens, 0.0),
            None => {
                let expected = Lens::centered(picture_px, focal_sides.unwrap_or(FOCAL_SIDES));
                let known = focal_from_corners(corners, size_m[1] / size_m[0], [expected.focal_px, sd_px], &expected);
                let (focal_px, share) = known.ok_or(TableError::NotASquare)?;
                let sd = if focal_sides.is_some() { FILE_SD } else { GUESS_SD };
                (Lens { focal_px, ..expected }, sd * (1.0 - share))
            }
        };
        let ideal = corners.map(|corner| lens.ideal_from_image(corner));
        Ok((Table::of_rectangle(ideal, size_m, &lens, most_off)?, focal_sd))
    };
    match (&setting.plane, &setting.rig) {
        (Plane::Whole, _) => {
            // from so far that parts show no height
            Ok((Table::of_picture(picture_px, &Lens::centered(picture_px, 1e6), Vec2::zeros(), size_m[0])?, 0.0))
        }
        (Plane::Found, Some(rig)) => Ok((locate_table(frame, &rig.lens, size_m[0])?, 0.0)),
        (Plane::Found, None) => {
            let with = |cells| {
                let corners = locate_corners(frame, size_m[0] / size_m[1], cells)?;
                through(corners, FOUND_OFF, FOUND_SD_PX)
            };
            let mut found = Err(TableError::NoEdges);
            for cells in CELLS {
                found = found.or_else(|_| with(cells));
            }
            found
        }
        (Plane::Corners(corners), _) => through(in_turn(*corners), GIVEN_OFF, GIVEN_SD_PX),
    }
}

/// Plane and discs of a whole picture that was not taken from straight above, as the sizes of the discs say; `straight`
/// are those found as if it were. `None` where no tilt is needed; a doubt where several would explain them.
fn leaning(
    frame: &Frame,
    setting: &LocateSetup,
    focal_sides: Option<f64>,
    straight: &[DetectedDisc],
) -> Result<Option<(Table, Vec<DetectedDisc>)>, String> {
    let part = if let Scale::Part(kind, at_px) = setting.scale { Some((kind, at_px)) } else { None };
    let chosen = |kind: &usize| setting.wanted[*kind] || part.is_some_and(|part| part.0 == *kind);
    let kinds: Vec<usize> = (0..setting.known.len()).filter(chosen).collect();
    let named = part.and_then(|(kind, at_px)| Some((kinds.iter().position(|chosen| *chosen == kind)?, at_px?)));
    let kinds: Vec<PartKind> = kinds.into_iter().map(|kind| setting.known[kind].clone()).collect();
    let size_px = [frame.width, frame.height];
    let lens = Lens::centered(size_px, focal_sides.unwrap_or(FOCAL_SIDES));
    let focal_sd = if focal_sides.is_some() { FILE_SD } else { GUESS_SD };
    let (mut tilt, mut found) = (Vec2::zeros(), None);
    for _ in 0..LEANINGS {
        let table = Table::of_picture(size_px, &lens, tilt, PAPERS_SIDE_M).map_err(|fault| fault.to_string())?;
        let discs = if tilt == Vec2::zeros() { straight.to_vec() } else { survey(frame, &table) };
        let tilts = Sizes { table: &table, discs: &discs, kinds: &kinds, focal_sd }.tilts(named);
        let [fit] = &tilts[..] else {
            return Err(format!("{} tilts of the camera explain the sizes alike", tilts.len()));
        };
        if tilt != Vec2::zeros() {
            found = Some((table.clone(), discs));
        }
        if fit.tilt == Vec2::zeros() {
            break;
        }
        tilt += table.picture_gradient(fit.tilt);
    }
    Ok(found)
}

/// Corners in the order in which they go round clockwise as the picture is seen.
fn in_turn(corners: [Vec2; 4]) -> [Vec2; 4] {
    let middle = corners.iter().sum::<Vec2>() / 4.0;
    let mut corners = corners;
    let angle = |corner: &Vec2| libm::atan2((corner - middle).y, (corner - middle).x);
    corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    corners
}

/// Sides along x and along y: the longer one is the one that looks longer.
fn as_it_lies(corners: [Vec2; 4], [a, b]: [f64; 2]) -> [f64; 2] {
    let [first, second] = [0, 1].map(|i| [i, i + 2].map(|k| corners[(k + 1) % 4] - corners[k]));
    let length = |sides: [Vec2; 2]| sides[0].norm() + sides[1].norm();
    let first_is_x = (first[0] - first[1]).x.abs() >= (first[0] - first[1]).y.abs();
    let x_is_longer = (length(first) >= length(second)) == first_is_x;
    if x_is_longer == (a >= b) { [a, b] } else { [b, a] }
}

/// The table with its scale, the discs in it, and the source of the scale.
fn scaled(
    (table, focal_sd): (Table, f64),
    discs: Vec<DetectedDisc>,
    setting: &LocateSetup,
) -> Result<(Table, Vec<DetectedDisc>, PictureScale), String> {
    let sizes = Sizes { table: &table, discs: &discs, kinds: &setting.known, focal_sd };
    let side_m = table.side_m;
    let same = ScaleFit::of(1.0);
    let sure = |source| PictureScale { source, doubt: None };
    let (fit, scale) = match &setting.scale {
        Scale::Size(_) if setting.rig.is_some() => (same, sure(ScaleSource::Rig)),
        Scale::Size(_) => {
            (sizes.fitted(same, &discs.iter().collect::<Vec<_>>(), [false, true, false]), sure(ScaleSource::Given))
        }
        Scale::PxPerM(px_per_m) => {
            (ScaleFit::of(table.px_per_m_at(Vec2::zeros()) / px_per_m), sure(ScaleSource::Given))
        }
        Scale::Part(kind, at_px) => {
            let (fit, doubt) = sizes.part_scale(*kind, *at_px)?;
            (fit, PictureScale { source: ScaleSource::Part, doubt })
        }
        Scale::Unknown => {
            let fits = sizes.scales(None);
            match fits.as_slice() {
                [fit] if fit.kinds.len() >= 2 => {
                    let source = if fit.kinds.len() > 2 { ScaleSource::Parts } else { ScaleSource::TwoKinds };
                    (fit.clone(), PictureScale { source, doubt: sizes.doubt(fit) })
                }
                _ => {
                    let doubt = Some("no two kinds of parts determine it".to_owned());
                    (same, PictureScale { source: ScaleSource::Assumed, doubt })
                }
            }
        }
    };
    let lens = Lens { focal_px: table.lens.focal_px * fit.focal, ..table.lens };
    let size_m = [1.0, table.aspect].map(|share| share * side_m * fit.factor);
    let corners = table.corners_px.map(|corner| lens.ideal_from_image(corner));
    let table = Table::of_rectangle(corners, size_m, &lens, GIVEN_OFF).map_err(|fault| fault.to_string())?;
    let of_scale = |disc: DetectedDisc| {
        let (at_m, radius_m) = (disc.at_m * fit.factor, disc.radius_m * fit.factor);
        DetectedDisc { at_m, radius_m, ..disc }
    };
    Ok((table, discs.into_iter().map(of_scale).collect(), scale))
}

/// Fault of the table search, with what a person can do.
fn about_table(fault: &TableError, plane: &Plane) -> String {
    let remedy = match fault {
        _ if matches!(plane, Plane::Corners(_)) => return "--corners: expected a rectangle seen from above".to_owned(),
        TableError::Skewed { .. } => "--rectangle WxH gives its sides, --corners its corners",
        TableError::MoreThanOne => "crop the picture to one",
        TableError::TooSmall { .. } => return fault.to_string(),
        _ => "--corners gives its corners, --plate whole takes the picture as the plane",
    };
    format!("{fault}; {remedy}")
}
