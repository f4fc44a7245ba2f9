use super::binned::{BinnedImage, UNITS};
use super::classifier::{LEAST_SCORE, PartClassifier, kernel_radii_px, overlap};
use super::disk::DiskKernel;
use super::outline::PlateCells;
use super::rim::RimFit;
use super::run_length_sums::RunLengthSums;
use super::sampling::Sampler;
use super::shading::Shading;
use super::{Detection, Table};
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_core::signal::Frame;

/// Contrast threshold: parts are searched for only if the darkness against the plate, 0 to 1, reaches this somewhere.
const LEAST_CONTRAST: f32 = 0.2;
/// Height of a peak over that of the highest one below which it is not examined; a hand may be darker than parts.
const LEAST_PEAK: f32 = 0.5;
/// The picture is averaged over squares until the smallest kernel has this radius, cells.
const KERNEL_CELLS: f64 = 7.0;
/// Most cells convolved at once, and most candidates examined.
const MOST_CELLS: f64 = 4e6;
const MOST_CANDIDATES: usize = 2048;
/// Largest deviation of a final radius from its kind's, as a fraction of it.
const RADIUS_TOLERANCE: f64 = 0.05;
/// A rim with more adjacent rays than this that show nothing may be the end of a finger.
const WIDEST_GAP: usize = 14;
/// Share of such a gap that other parts have to fill, and how near they have to be for that, px.
const FILLED: f64 = 0.75;
const FILLED_WITHIN_PX: f64 = 6.0;
/// A detection whose variance exceeds this along any direction is rejected, px².
const LARGEST_VARIANCE_PX2: f64 = 0.12;
/// A rim measured from a centre that was off by more than this is measured once more, px.
const SETTLED_PX: f64 = 0.1;

/// Finds every part on the plate in a whole frame: the darkness of the averaged picture against the bare plate is
/// convolved with a solid disk of each kind's radius; its peaks are candidates, whose rims are measured in the full
/// frame (UPM paper, section 3.4; equation sheet, section 7).
pub struct CoinFinder {
    pub(super) classifier: PartClassifier,
    /// Disk of each kind, cells.
    binned: Vec<DiskKernel>,
    frame_size: [usize; 2],
    plate: PlateCells,
    sums: RunLengthSums,
    inverse: Vec<f32>,
    responses: Vec<Vec<f32>>,
    /// Highest of the last responses.
    strongest: f32,
}

struct DiskCandidate {
    value: f32,
    kind: usize,
    cell: [usize; 2],
}

/// A possible part.
struct CandidatePart {
    part: Detection,
    /// Rays that agree on its rim.
    agreeing: usize,
    /// Places just beyond the rim, m, along a wide stretch of it that does not show.
    gap: Vec<Vec2>,
}

impl CoinFinder {
    /// For frames of `frame_size` (columns, rows), these kinds of parts, `dark_parts` where parts are darker than the
    /// plate. Kernels take the plate's mean scale.
    pub fn new(table: &Table, frame_size: [usize; 2], kinds: &[PartKind], dark_parts: bool) -> Self {
        let radii = kernel_radii_px(table, kinds);
        let bin = bin_for(table, frame_size, &radii);
        // A cell across the edge contains some of the ground.
        let plate = PlateCells::new(table, frame_size, bin, 2.0 + 0.75 * bin as f64);
        let [width, height] = plate.size;
        let binned: Vec<DiskKernel> = radii.iter().map(|radius| DiskKernel::new(radius / bin as f64)).collect();
        Self {
            classifier: PartClassifier::new(table, kinds, dark_parts),
            frame_size,
            plate,
            sums: RunLengthSums::new(width, height, &binned),
            binned,
            inverse: vec![0.0; width],
            responses: vec![vec![0.0; width * height]; kinds.len()],
            strongest: 0.0,
        }
    }

    /// All parts in `frame`, sorted from the top of the picture to the bottom (by `center_px.y`, then x). Empty for a
    /// frame of another size than given to [`Self::new`].
    pub fn find(&mut self, frame: &Frame) -> Vec<Detection> {
        self.strongest = 0.0;
        if let Some(found) = self.classifier.measured(frame) {
            return found;
        }
        let Some(sampler) = Sampler::new(frame) else { return Vec::new() };
        if [frame.width, frame.height] != self.frame_size || self.plate.spans.is_empty() || self.binned.is_empty() {
            return Vec::new();
        }
        let picture = BinnedImage::part_of(frame, self.plate.bin, self.plate.corner, self.plate.size);
        self.load_darkness(&picture);
        for (disk, response) in self.binned.iter().zip(&mut self.responses) {
            self.sums.respond(disk, response);
            self.strongest =
                response.iter().fold(self.strongest, |best, &value| if value > best { value } else { best });
        }
        if self.strongest < LEAST_CONTRAST {
            return Vec::new();
        }
        let candidates = self.candidates();
        let found: Vec<CandidatePart> =
            candidates.iter().filter_map(|candidate| self.examine(frame, &sampler, &picture, candidate)).collect();
        self.agreed(found)
    }

    /// Loads the darkness against the bare plate, 0 to 1; 0 beyond the plate's outline.
    fn load_darkness(&mut self, picture: &BinnedImage) {
        let Self { plate, classifier, sums, inverse, .. } = self;
        let shading = Shading::fit(picture, plate, classifier.dark_parts);
        let sign = if classifier.dark_parts { 1.0f32 } else { -1.0 };
        let unit = 1.0 / f32::from(UNITS);
        sums.load(|row, darkness| {
            darkness.fill(0.0);
            let Some(&(from, to)) = plate.spans.get(row).filter(|_| row < picture.height) else { return };
            shading.inverse_row(row, inverse);
            let levels = picture.row(row)[from..to].iter().zip(&inverse[from..to]);
            for (dark, (&level, inverse)) in darkness[from..to].iter_mut().zip(levels) {
                *dark = (sign * (1.0 - f32::from(level) * unit * inverse)).clamp(0.0, 1.0);
            }
        });
    }

    /// Peaks of all responses, kind by kind, highest first.
    fn candidates(&self) -> Vec<DiskCandidate> {
        let mut peaks = Vec::new();
        for (kind, response) in self.responses.iter().enumerate() {
            let near = (0.4 * self.binned[kind].reach() as f64).max(1.0);
            let mut own = self.peaks(kind, response);
            own.sort_by(|a, b| b.value.total_cmp(&a.value).then(a.cell.cmp(&b.cell)));
            let mut kept: Vec<DiskCandidate> = Vec::new();
            for candidate in own {
                let distance = |other: &DiskCandidate| {
                    let [dx, dy] = [0, 1].map(|i| candidate.cell[i] as f64 - other.cell[i] as f64);
                    libm::hypot(dx, dy)
                };
                if kept.len() < MOST_CANDIDATES && kept.iter().all(|other| distance(other) > near) {
                    kept.push(candidate);
                }
            }
            peaks.extend(kept);
        }
        peaks
    }

    /// Cells no lower than their neighbours, and a lattice over the area that a larger part covers without a peak.
    fn peaks(&self, kind: usize, response: &[f32]) -> Vec<DiskCandidate> {
        let [width, height] = self.plate.size;
        let (least, full) = (LEAST_PEAK * self.strongest, 0.999 * self.strongest);
        let mut found = Vec::new();
        for y in 1..height.saturating_sub(1) {
            let [above, here, below] = [y - 1, y, y + 1].map(|row| &response[row * width..][..width]);
            for x in 1..width.saturating_sub(1) {
                let value = here[x];
                if value > least {
                    let later = || value > here[x + 1] && below[x - 1..=x + 1].iter().all(|&b| value > b);
                    let peak = || value >= here[x - 1] && above[x - 1..=x + 1].iter().all(|&a| value >= a);
                    let flat = || value >= full && x % 2 == 0 && y % 2 == 0;
                    if (later() && peak()) || flat() {
                        found.push(DiskCandidate { value, kind, cell: [x, y] });
                    }
                }
            }
        }
        found
    }

    /// A candidate's position to a fraction of a cell, by a parabola along each axis.
    fn place(&self, candidate: &DiskCandidate) -> Vec2 {
        let ([x, y], width) = (candidate.cell, self.plate.size[0]);
        let response = &self.responses[candidate.kind];
        let off = |step: usize| {
            let i = y * width + x;
            let [before, here, after] = [i - step, i, i + step].map(|i| f64::from(response[i]));
            let bend = 2.0 * here - before - after;
            if bend > 1e-6 { (0.5 * (after - before) / bend).clamp(-0.5, 0.5) } else { 0.0 }
        };
        Vec2::new(x as f64 + off(1), y as f64 + off(width))
    }

    /// Measures the rim of a candidate, within a short or else a long reach; then once more as the kind that matches
    /// its radius.
    fn examine(
        &self,
        frame: &Frame,
        sampler: &Sampler,
        picture: &BinnedImage,
        candidate: &DiskCandidate,
    ) -> Option<CandidatePart> {
        let Self { classifier, .. } = self;
        let center_px = picture.frame_from_cell(self.place(candidate));
        let kind = candidate.kind;
        let foot_m = classifier.foot_below(kind, center_px);
        let close = |kind: usize, foot_m| classifier.close_rim(sampler, kind, foot_m);
        let first = close(kind, foot_m).or_else(|| classifier.wide_rim(sampler, kind, foot_m))?;
        let (kind, fit) = self.settled(first, close)?;
        let radius_m = classifier.kinds.get(kind)?.radius_m;
        let variance_px2 = fit.covariance_px2.symmetric_eigenvalues().max();
        if variance_px2 > LARGEST_VARIANCE_PX2 || (fit.radius_m / radius_m - 1.0).abs() > RADIUS_TOLERANCE {
            return None;
        }
        let part = classifier.detection(frame, &fit, kind)?;
        let on_plate = classifier.table.holds(part.position_m, 0.75 * radius_m);
        let beyond = fit.radius_m + FILLED_WITHIN_PX / classifier.table.px_per_m_at(fit.foot_m);
        let gap: Vec<Vec2> = fit.gap().map(|ray| fit.foot_m + ray * beyond).collect();
        let gap = if gap.len() > WIDEST_GAP { gap } else { Vec::new() };
        (on_plate && part.score >= LEAST_SCORE).then_some(CandidatePart { part, agreeing: fit.agreeing, gap })
    }

    /// Of parts that cannot both exist, those whose rims are seen best; in the picture's order. A wide gap in a rim has
    /// to be filled by other parts or by the plate's edge.
    fn agreed(&self, mut found: Vec<CandidatePart>) -> Vec<Detection> {
        found.sort_by(|a, b| {
            let open = |found: &CandidatePart| !found.gap.is_empty();
            let place = |found: &CandidatePart| found.part.center_px.y;
            let score = b.part.score.total_cmp(&a.part.score);
            open(a).cmp(&open(b)).then(b.agreeing.cmp(&a.agreeing)).then(score).then(place(a).total_cmp(&place(b)))
        });
        let mut kept: Vec<Detection> = Vec::with_capacity(found.len());
        for CandidatePart { part, gap, .. } in found {
            let filled = gap.iter().filter(|&&place| self.is_filled(place, &kept)).count() as f64;
            if filled >= FILLED * gap.len() as f64 && kept.iter().all(|other| !overlap(other, &part)) {
                kept.push(part);
            }
        }
        kept.sort_by(|a, b| a.center_px.y.total_cmp(&b.center_px.y).then(a.center_px.x.total_cmp(&b.center_px.x)));
        kept
    }

    /// True at a place within or nearly within a part, or beyond the plate's edge.
    fn is_filled(&self, place_m: Vec2, parts: &[Detection]) -> bool {
        let PartClassifier { table, kinds, .. } = &self.classifier;
        let margin_m = FILLED_WITHIN_PX / table.mean_px_per_m();
        let covers = |part: &Detection| {
            let radius_m = kinds.get(part.kind).map_or(0.0, |kind| kind.radius_m);
            (part.position_m - place_m).norm() < radius_m + margin_m
        };
        !table.holds(place_m, 0.5 * margin_m) || parts.iter().any(covers)
    }

    /// Measures a rim again as the kind and from the centre that the last fit gave, until neither changes: with a
    /// centre that is off, or rays that end too near the rim, the plate on one side and the part on the other are too
    /// near the end of the window.
    fn settled(&self, first: RimFit, close: impl Fn(usize, Vec2) -> Option<RimFit>) -> Option<(usize, RimFit)> {
        let (mut fit, mut kind) = (first, self.classifier.nearest_kind(first.radius_m)?);
        for _ in 0..5 {
            let again = close(kind, fit.foot_m)?;
            let moved_px = (again.center_px - fit.center_px).norm();
            let seen_as = self.classifier.nearest_kind(again.radius_m)?;
            if seen_as == kind && moved_px < SETTLED_PX {
                return Some((kind, again));
            }
            (fit, kind) = (again, seen_as);
        }
        close(kind, fit.foot_m).map(|fit| (kind, fit))
    }
}

/// Averages over squares of this many pixels a side.
fn bin_for(table: &Table, frame_size: [usize; 2], radii_px: &[f64]) -> usize {
    let smallest = radii_px.iter().fold(f64::INFINITY, |a, &b| a.min(b));
    let fine = (smallest / KERNEL_CELLS).max(1.0);
    let [width, height] = frame_size.map(|n| n as f64);
    let area = (1.5 * table.side_px * table.side_px).min(width * height);
    let least = (area / MOST_CELLS).sqrt();
    let bin = fine.floor().max(least.ceil());
    if bin.is_finite() { bin.clamp(1.0, 256.0) as usize } else { 1 }
}
