//! Detection of round objects of any size and tone on a plane, including those that [`CoinFinder`](super::CoinFinder)
//! does not search for.
//!
//! Edges of the averaged picture vote for centres along their gradient, to both sides; for a likely centre and radius
//! the outline is then measured in the frame by its sharpest edges. An edge counts only where it runs along the circle,
//! so that squares and stripes show no discs; a soft shadow has no sharp edge, and a rim counts whether the disc is
//! darker than its surroundings or lighter. Intended for pictures supplied by users; the control loop does not use it.

mod circle;
mod seeds;

use self::circle::OutlineGauge;
use self::seeds::Votes;
use super::binned::BinnedImage;
use super::outline::PlateCells;
use super::rim::map::outline;
use super::sampling::Sampler;
use super::{DetectedDisc, Table};
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_core::signal::Frame;

/// The picture is averaged until the plate has no more cells along a side than this.
const CELLS: f64 = 300.0;
/// Share of its outline that a disc must show.
const LEAST_SHARE: f64 = 0.42;
/// Share of its outline above which a disc claims its edges; those of other discs stay available to better candidates.
const SURE_SHARE: f64 = 0.65;
/// Two discs nearer than this share of their radii's sum are the same disc.
const APART: f64 = 0.85;
/// Of two detections of the same disc the larger is taken where it shows this much of the other's share: coins have
/// rings in them.
const AS_WELL: f64 = 0.75;
/// Largest deviation of a radius from a seed's, as a fraction of it.
const SEED_WINDOW: f64 = 0.2;

/// Finds discs of any size on the plate of `frame`, sorted from the top of the picture to the bottom.
///
/// They are searched once more without dark lines, such as those of ruled paper: a disc is taken from there that shows
/// much less of its outline, or nothing, between the lines.
pub fn survey(frame: &Frame, table: &Table) -> Vec<DetectedDisc> {
    let bin = (table.side_px / CELLS).ceil().clamp(1.0, 256.0) as usize;
    let closed = extreme(&extreme(frame, bin, u8::max), bin, u8::min);
    let mut discs = discs_in(frame, table, bin);
    let mut more = discs_in(&closed, table, bin);
    let stays = |old: &DetectedDisc, new: &DetectedDisc| old.outline_share >= SURE_SHARE * new.outline_share;
    more.retain(|new| !discs.iter().any(|old| is_same(old, new) && stays(old, new)));
    discs.retain(|old| !more.iter().any(|new| is_same(old, new)));
    discs.extend(more);
    discs.sort_by(|a, b| a.center_px.y.total_cmp(&b.center_px.y).then(a.center_px.x.total_cmp(&b.center_px.x)));
    discs
}

/// The frame with that level of each square that reaches `reach` from a pixel which `pick` prefers.
fn extreme(frame: &Frame, reach: usize, pick: impl Fn(u8, u8) -> u8) -> Frame {
    let mut out = frame.clone();
    for step in [1, frame.width] {
        let from = out.pixels.clone();
        for off in (1..=reach).map(|k| (k * step).min(from.len())) {
            out.pixels.iter_mut().skip(off).zip(&from).for_each(|(out, &level)| *out = pick(*out, level));
            out.pixels.iter_mut().zip(from.iter().skip(off)).for_each(|(out, &level)| *out = pick(*out, level));
        }
    }
    out
}

/// Discs in an average over squares of `bin` pixels, measured in the frame.
fn discs_in(frame: &Frame, table: &Table, bin: usize) -> Vec<DetectedDisc> {
    let Some(sampler) = Sampler::new(frame) else { return Vec::new() };
    let plate = PlateCells::new(table, [frame.width, frame.height], bin, 0.0);
    let picture = BinnedImage::part_of(frame, bin, plate.corner, plate.size);
    let gauge = OutlineGauge::new(&sampler, table);
    let mut votes = Votes::of(&picture, table);
    let mut found: Vec<DetectedDisc> = Vec::new();
    while let Some(cell) = votes.next_middle() {
        let at_m = table.table_from_image(picture.frame_from_cell(cell));
        for radius_cells in votes.radii_about(cell) {
            let disc = gauge.measure(at_m, radius_cells * bin as f64 / table.px_per_m_at(at_m), SEED_WINDOW);
            let Some(disc) = disc.filter(|disc| disc.outline_share >= LEAST_SHARE) else { continue };
            let middle = (disc.center_px - picture.frame_from_cell(Vec2::zeros())) / bin as f64;
            let (own_cells, is_sure) = (disc.radius_px / bin as f64, disc.outline_share >= SURE_SHARE);
            found.push(disc);
            if is_sure {
                votes.remove_votes(middle, own_cells);
                break;
            }
        }
    }
    apart(found)
}

/// Middle and radius, m, of the outline of a part of `kind` with its foot at `foot_m`: that of foot and top together.
pub fn seen_outline_m(table: &Table, foot_m: Vec2, kind: &PartKind) -> (Vec2, f64) {
    let (shift, growth) = table.parallax(foot_m, kind.thickness_m);
    let (shift, growth) = outline(shift / kind.radius_m, growth);
    (foot_m + shift * kind.radius_m, kind.radius_m * (1.0 + growth))
}

fn is_same(a: &DetectedDisc, b: &DetectedDisc) -> bool {
    (a.at_m - b.at_m).norm() < APART * (a.radius_m + b.radius_m)
}

/// The best of all detections of the same disc.
fn apart(mut found: Vec<DetectedDisc>) -> Vec<DetectedDisc> {
    let worth = |disc: &DetectedDisc| (disc.outline_share / AS_WELL).min(1.0).powi(3) * disc.radius_m;
    found.sort_by(|a, b| worth(b).total_cmp(&worth(a)).then(a.center_px.y.total_cmp(&b.center_px.y)));
    let mut kept: Vec<DetectedDisc> = Vec::with_capacity(found.len());
    for disc in found {
        if !kept.iter().any(|other| is_same(other, &disc)) {
            kept.push(disc);
        }
    }
    kept
}
