//! Parts by template matching: darkness against the plate, matched with solid disks.

use image::{GrayImage, Luma, imageops};
use imageproc::contrast::otsu_level;
use imageproc::template_matching::{MatchTemplateMethod, match_template_with_mask};
use nalgebra::{Matrix2, Matrix3, Vector3};

use super::ReferenceView;
use crate::numerics::suppress_neighbours;
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_perception::vision::{Detection, Table};

/// The picture is averaged over squares until the smallest disk has about this radius, px.
const COARSE_RADIUS_PX: f64 = 8.0;
/// Ring around a disk that has to be bare, px.
const RING_PX: f64 = 2.0;
/// Weakest match, 0 to 1, in the averaged and in the full picture.
const LEAST_COARSE: f32 = 0.8;
const LEAST_MATCH: f32 = 0.9;
/// Least mean darkness under a disk, 0 to 1: the matching score is independent of contrast.
const LEAST_DARKNESS: f64 = 0.25;
/// Least distance of two parts, as a fraction of their radii's sum.
const LEAST_DISTANCE: f64 = 0.75;
/// Width of the plate's edge that is left out, px.
const EDGE_PX: f64 = 3.0;

/// Finds parts of `kinds` on the table of `view`, sorted from the top of the picture down; `dark_parts` where they are
/// darker than the plate. Radii are the kinds' own in the picture, and covariances are NaN: this method estimates
/// neither.
pub fn find_parts(view: &ReferenceView, kinds: &[PartKind], dark_parts: bool) -> Vec<Detection> {
    let Some(darkness) = darkness(view, dark_parts) else { return Vec::new() };
    let scale = view.table.side_px / view.table.side_m;
    let smallest_px = kinds.iter().map(|kind| kind.radius_m * scale).fold(f64::INFINITY, f64::min);
    if !(smallest_px.is_finite() && smallest_px >= 1.0) {
        return Vec::new();
    }
    let shrink = ((smallest_px / COARSE_RADIUS_PX) as u32).max(1);
    let small = imageops::thumbnail(&darkness, darkness.width() / shrink, darkness.height() / shrink);
    let full_px = |cell: Vec2| cell * f64::from(shrink) + Vec2::repeat(0.5 * (f64::from(shrink) - 1.0));
    let radii_px = kinds.iter().map(|kind| kind.radius_m * scale / f64::from(shrink));
    let mut candidates: Vec<(f32, Vec2)> = radii_px.flat_map(|radius_px| peaks(&small, radius_px)).collect();
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
    // one part is a candidate of several kinds
    let places = candidates.into_iter().map(|(_, cell)| full_px(cell));
    let places = suppress_neighbours(places, |other, place| (other - place).norm() > 0.5 * smallest_px);
    let reach_px = f64::from(shrink) + 2.0;
    let best = |near: Vec2| {
        let matches = (0..kinds.len()).filter_map(|kind| refined(view, &darkness, kinds, kind, near, reach_px));
        matches.max_by(|a, b| a.score.total_cmp(&b.score))
    };
    let mut found: Vec<Detection> = places.into_iter().filter_map(best).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.center_px.y.total_cmp(&b.center_px.y)));
    let mut kept = suppress_neighbours(found, |other: &Detection, part| {
        (other.center_px - part.center_px).norm() > LEAST_DISTANCE * (other.radius_px + part.radius_px)
    });
    kept.sort_by(|a, b| a.center_px.y.total_cmp(&b.center_px.y).then(a.center_px.x.total_cmp(&b.center_px.x)));
    kept
}

/// `1 - level / plate` in 255ths on the plate, for light parts its negative; 0 off the plate. The bare plate's level is
/// a plane fitted to the brighter class of Otsu's two (for light parts the darker one), so light may fall off.
fn darkness(view: &ReferenceView, dark_parts: bool) -> Option<GrayImage> {
    let ReferenceView { ideal, table } = view;
    let on_plate = |x: u32, y: u32| {
        let p_m = table.table_from_ideal.apply(Vec2::new(f64::from(x), f64::from(y)));
        p_m.amax() < 0.5 * table.side_m - EDGE_PX * table.side_m / table.side_px
    };
    let plate: Vec<(u32, u32, u8)> =
        ideal.enumerate_pixels().filter(|&(x, y, _)| on_plate(x, y)).map(|(x, y, pixel)| (x, y, pixel.0[0])).collect();
    let levels: Vec<u8> = plate.iter().map(|&(_, _, level)| level).collect();
    let split = otsu_level(&GrayImage::from_raw(levels.len() as u32, 1, levels)?);
    let (mut normal, mut wanted) = (Matrix3::zeros(), Vector3::zeros());
    for &(x, y, level) in plate.iter().filter(|(_, _, level)| (*level > split) == dark_parts) {
        let row = Vector3::new(1.0, f64::from(x), f64::from(y));
        normal += row * row.transpose();
        wanted += row * f64::from(level);
    }
    let bare = normal.cholesky()?.solve(&wanted);
    let sign = if dark_parts { 1.0 } else { -1.0 };
    let mut out = GrayImage::new(ideal.width(), ideal.height());
    for (x, y, level) in plate {
        let plate_level = bare.dot(&Vector3::new(1.0, f64::from(x), f64::from(y))).max(1.0);
        let value = (sign * (1.0 - f64::from(level) / plate_level)).clamp(0.0, 1.0);
        out.put_pixel(x, y, Luma([(255.0 * value).round() as u8]));
    }
    Some(out)
}

/// A disk with its bare ring, and the mask of both.
fn disk(radius_px: f64) -> [GrayImage; 2] {
    let half = (radius_px + RING_PX).ceil();
    let size = 2 * half as u32 + 1;
    let covered = |reach_px: f64, x: u32, y: u32, full: f64| {
        let from_middle = (f64::from(x) - half).hypot(f64::from(y) - half);
        Luma([(full * (reach_px + 0.5 - from_middle).clamp(0.0, 1.0)).round() as u8])
    };
    [
        GrayImage::from_fn(size, size, |x, y| covered(radius_px, x, y, 255.0)),
        GrayImage::from_fn(size, size, |x, y| covered(radius_px + RING_PX, x, y, 1.0)),
    ]
}

/// Local maxima of the match of a disk of `radius_px` in `picture`, px, with the match.
fn peaks(picture: &GrayImage, radius_px: f64) -> Vec<(f32, Vec2)> {
    let [template, mask] = disk(radius_px);
    if picture.width() < template.width() + 2 || picture.height() < template.height() + 2 {
        return Vec::new();
    }
    let method = MatchTemplateMethod::CrossCorrelationNormalized;
    let matched = match_template_with_mask(picture, &template, method, &mask);
    let half = f64::from(template.width() / 2);
    let mut found = Vec::new();
    for y in 1..matched.height() - 1 {
        for x in 1..matched.width() - 1 {
            let value = matched.get_pixel(x, y).0[0];
            let around = (0..9).map(|i| matched.get_pixel(x + i % 3 - 1, y + i / 3 - 1).0[0]);
            if value >= LEAST_COARSE && around.fold(0.0, f32::max) <= value {
                found.push((value, Vec2::new(f64::from(x) + half, f64::from(y) + half)));
            }
        }
    }
    found
}

/// The best match of `kind` within `reach_px` of `near`, in the full picture, to a fraction of a pixel by a parabola
/// along each axis.
fn refined(
    view: &ReferenceView,
    darkness: &GrayImage,
    kinds: &[PartKind],
    kind: usize,
    near: Vec2,
    reach_px: f64,
) -> Option<Detection> {
    let ReferenceView { table, .. } = view;
    let near_m = table.table_from_ideal.apply(near);
    let growth = kinds[kind].thickness_m / table.camera_in_table_m.z;
    let scale = table.ideal_from_table.jacobian_at(near_m).determinant().abs().sqrt();
    // foot and top together: their mean radius, larger by half the growth
    let radius_px = kinds[kind].radius_m * scale * (1.0 + 0.5 * growth);
    let [template, mask] = disk(radius_px);
    let side = template.width() + 2 * reach_px.ceil() as u32;
    let corner = near - Vec2::repeat(0.5 * f64::from(side - 1));
    let [x0, y0] = [corner.x.round(), corner.y.round()];
    let fits = x0 >= 0.0 && y0 >= 0.0 && x0 + f64::from(side) <= f64::from(darkness.width());
    if !fits || y0 + f64::from(side) > f64::from(darkness.height()) {
        return None;
    }
    let window = imageops::crop_imm(darkness, x0 as u32, y0 as u32, side, side).to_image();
    let method = MatchTemplateMethod::CrossCorrelationNormalized;
    let matched = match_template_with_mask(&window, &template, method, &mask);
    let (x, y, pixel) = matched.enumerate_pixels().max_by(|a, b| a.2.0[0].total_cmp(&b.2.0[0]))?;
    let score = pixel.0[0];
    if score < LEAST_MATCH || x == 0 || y == 0 || x + 1 == matched.width() || y + 1 == matched.height() {
        return None;
    }
    let at = |x: u32, y: u32| f64::from(matched.get_pixel(x, y).0[0]);
    let off = |before: f64, here: f64, after: f64| {
        let bend = 2.0 * here - before - after;
        if bend > 1e-9 { (0.5 * (after - before) / bend).clamp(-0.5, 0.5) } else { 0.0 }
    };
    let below_pixel = Vec2::new(off(at(x - 1, y), at(x, y), at(x + 1, y)), off(at(x, y - 1), at(x, y), at(x, y + 1)));
    let half = f64::from(template.width() / 2);
    let ideal_px = Vec2::new(x0 + f64::from(x) + half, y0 + f64::from(y) + half) + below_pixel;
    if mean_within(darkness, ideal_px, radius_px) < LEAST_DARKNESS {
        return None;
    }
    Some(Detection {
        kind,
        center_px: table.lens.image_from_ideal(ideal_px),
        radius_px,
        position_m: foot_m(table, ideal_px, kinds[kind].thickness_m),
        score: f64::from(score),
        covariance_px2: Matrix2::repeat(f64::NAN),
    })
}

/// Mean of `picture` within `radius_px` of `center`, 0 to 1.
fn mean_within(picture: &GrayImage, center: Vec2, radius_px: f64) -> f64 {
    let span = |middle: f64| (middle - radius_px).ceil().max(0.0) as u32..=(middle + radius_px).floor().max(0.0) as u32;
    let pixels = span(center.y).flat_map(|y| span(center.x).map(move |x| (x, y)));
    let under = pixels.filter(|&(x, y)| (Vec2::new(f64::from(x), f64::from(y)) - center).norm() <= radius_px);
    let levels = under.filter_map(|(x, y)| picture.get_pixel_checked(x, y));
    let (sum, count) = levels.fold((0.0, 0u32), |(sum, count), pixel| (sum + f64::from(pixel.0[0]), count + 1));
    sum / (255.0 * f64::from(count.max(1)))
}

/// Foot of a part whose outline is centred at `ideal_px`: halfway between foot and top, where the top appears displaced
/// outwards from the foot by `h / (H - h)` of its distance for a camera at height H.
fn foot_m(table: &Table, ideal_px: Vec2, thickness_m: f64) -> Vec2 {
    let seen_m = table.table_from_ideal.apply(ideal_px);
    let camera = table.camera_in_table_m;
    let growth = thickness_m / (camera.z - thickness_m);
    camera.xy() + (seen_m - camera.xy()) / (1.0 + 0.5 * growth)
}
