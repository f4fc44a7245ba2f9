//! Detection of round objects of any size and tone on the plate, including those that [`CoinFinder`](super::CoinFinder)
//! does not search for.
//!
//! Edges of the averaged picture vote for centres along their gradient, to both sides; for a likely centre and radius
//! the outline is then measured in the frame by its sharpest edges. A soft shadow has no sharp edge, and a rim counts
//! whether the disc is darker than its surroundings or lighter. Intended for pictures supplied by users; the control
//! loop does not use it.

mod circle;
mod relative;
mod seeds;

use self::circle::OutlineGauge;
use self::relative::Relative;
use self::seeds::{Seed, Votes};
use super::binned::BinnedImage;
use super::outline::PlateCells;
use super::rim::map::outline;
use super::sampling::Sampler;
use super::{DetectedDisc, Detection, Survey, Table};
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_core::signal::Frame;

/// The picture is averaged until the plate has no more cells along a side than this.
const CELLS: f64 = 300.0;
/// Share of its outline that a disc must show: a new one, and one already found by other means.
const LEAST_SHARE: f64 = 0.5;
const LEAST_SHARE_OF_KNOWN: f64 = 0.3;
/// Share of its outline above which a disc claims its edges; those of other discs stay available to better candidates.
const SURE_SHARE: f64 = 0.65;
/// A disc whose outline shows less is accepted all the same where its face differs from the plate by this.
const FAINT_CONTRAST: f64 = 0.15;
/// Two discs nearer than this share of their radii's sum are the same disc.
const APART: f64 = 0.85;
/// Of two detections of the same disc the larger is taken where it shows this much of the other's share: coins have
/// rings in them.
const AS_WELL: f64 = 0.75;
/// Largest deviation of a radius from a seed's and from a known part's, as a fraction of it.
const SEED_WINDOW: f64 = 0.2;
const KNOWN_WINDOW: f64 = 0.1;
/// Most places examined, and most discs.
const MOST_SEEDS: usize = 150;
const MOST_DISCS: usize = 256;

/// Finds discs of any size on the plate of `frame`; parts already `known` are measured at their positions.
pub fn survey(frame: &Frame, table: &Table, known: &[Detection]) -> Survey {
    let Some(sampler) = Sampler::new(frame) else { return Survey::default() };
    let bin = (table.side_px / CELLS).ceil().clamp(1.0, 256.0) as usize;
    let plate = PlateCells::new(table, [frame.width, frame.height], bin, 2.0 + 0.75 * bin as f64);
    let picture = BinnedImage::part_of(frame, bin, plate.corner, plate.size);
    if picture.width == 0 || picture.height == 0 {
        return Survey::default();
    }
    let levels = Relative::of(&picture, &plate);
    let surveyor = Surveyor { table, gauge: OutlineGauge::new(&sampler, table), picture: &picture, levels: &levels };
    let found = surveyor.search(known);
    let mut discs = surveyor.gauge.with_mutual_occlusion(apart(found));
    for disc in &mut discs {
        let (cell, radius_cells) = surveyor.in_cells(disc);
        disc.level = levels.under(cell, 0.8 * radius_cells);
    }
    discs.retain(|disc| disc.outline_share >= LEAST_SHARE_OF_KNOWN);
    discs.sort_by(|a, b| a.center_px.y.total_cmp(&b.center_px.y).then(a.center_px.x.total_cmp(&b.center_px.x)));
    let [darkest, lightest] = levels.extremes();
    Survey { discs, darkest, lightest }
}

/// Search for discs in one picture.
struct Surveyor<'a> {
    table: &'a Table,
    gauge: OutlineGauge<'a>,
    picture: &'a BinnedImage,
    levels: &'a Relative,
}

impl Surveyor<'_> {
    /// Discs at known parts and where edges vote for them; may contain the same disc more than once.
    fn search(&self, known: &[Detection]) -> Vec<DetectedDisc> {
        let mut votes = Votes::of(self.levels);
        let mut found: Vec<DetectedDisc> = known.iter().filter_map(|part| self.known(part)).collect();
        for (cell, radius_cells) in found.iter().map(|disc| self.in_cells(disc)) {
            votes.remove_votes(cell, radius_cells);
        }
        let mut faint: Vec<DetectedDisc> = Vec::new();
        for _ in 0..MOST_SEEDS {
            let Some(seed) = votes.next_seed() else { break };
            match self.at_seed(&seed) {
                Some(disc) if disc.outline_share >= LEAST_SHARE && found.len() < MOST_DISCS => {
                    if disc.outline_share >= SURE_SHARE {
                        let (cell, radius_cells) = self.in_cells(&disc);
                        votes.remove_votes(cell, radius_cells);
                    }
                    found.push(disc);
                }
                Some(disc) if self.has_other_tone(&seed) => faint.push(disc),
                _ => {}
            }
        }
        // of the discs without a clear outline, but of another tone than the plate, the best at each place
        found.extend(apart(faint));
        found
    }

    fn known(&self, part: &Detection) -> Option<DetectedDisc> {
        let at_m = self.table.table_from_image(part.center_px);
        let disc = self.gauge.measure(at_m, part.radius_px / self.table.px_per_m_at(at_m), KNOWN_WINDOW)?;
        (disc.outline_share >= LEAST_SHARE_OF_KNOWN).then_some(disc)
    }

    fn at_seed(&self, &Seed { cell, radius_cells }: &Seed) -> Option<DetectedDisc> {
        let at_m = self.table.table_from_image(self.picture.frame_from_cell(cell));
        let radius_m = radius_cells * self.picture.bin as f64 / self.table.px_per_m_at(at_m);
        self.gauge.measure(at_m, radius_m, SEED_WINDOW)
    }

    fn has_other_tone(&self, seed: &Seed) -> bool {
        (self.levels.under(seed.cell, 0.7 * seed.radius_cells) - 1.0).abs() > FAINT_CONTRAST
    }

    /// Middle and radius of a disc, cells of the averaged picture.
    fn in_cells(&self, disc: &DetectedDisc) -> (Vec2, f64) {
        let bin = self.picture.bin as f64;
        ((disc.center_px - self.picture.frame_from_cell(Vec2::zeros())) / bin, disc.radius_px / bin)
    }
}

/// Radius, m, of the outline of a part of `kind` at `at_m`: that of foot and top together.
pub fn seen_radius_m(table: &Table, at_m: Vec2, kind: &PartKind) -> f64 {
    let (shift, growth) = table.parallax(at_m, kind.thickness_m);
    kind.radius_m * (1.0 + outline(shift / kind.radius_m, growth).1)
}

/// The best of all detections of the same disc.
fn apart(mut found: Vec<DetectedDisc>) -> Vec<DetectedDisc> {
    let worth = |disc: &DetectedDisc| (disc.outline_share / AS_WELL).min(1.0) * disc.radius_m;
    found.sort_by(|a, b| worth(b).total_cmp(&worth(a)).then(a.center_px.y.total_cmp(&b.center_px.y)));
    let mut kept: Vec<DetectedDisc> = Vec::with_capacity(found.len());
    for disc in found {
        let same = |other: &DetectedDisc| (other.at_m - disc.at_m).norm() < APART * (other.radius_m + disc.radius_m);
        if !kept.iter().any(same) {
            kept.push(disc);
        }
    }
    kept
}
