use super::convolution::DiskConvolver;
use super::disk::{Disk, Rest};
use super::edges::frame_from_binned;
use super::rim::{RimFinder, RimFit, RimGuess};
use super::sampling::Sampler;
use super::shading::{Shading, ShadingGrid};
use super::{Detection, Plane, Table};
use crate::geometry::Vec2;
use crate::rig::PartKind;
use crate::signal::Frame;

/// A part's score below this is no part.
pub(super) const LEAST_SCORE: f64 = 0.75;
/// A part's darkness against the plate, 0 to 1, must reach this anywhere for parts to be looked for.
const LEAST_CONTRAST: f32 = 0.2;
/// How far a measured radius may be from its kind's, as a part of it.
const RADIUS_TOLERANCE: f64 = 0.08;
/// Two parts are nearer than this share of their radii's sum only when they are one.
pub(super) const APART: f64 = 0.8;
/// Kernels larger than this, px, are made smaller by averaging the picture over squares.
const LARGEST_KERNEL_PX: f64 = 96.0;
/// Most cells convolved at once, and most places looked at closely.
const MOST_CELLS: f64 = 16e6;
const MOST_CANDIDATES: usize = 2048;

/// Looks at a rim and says which part it is, if it is one. Shared by the full search and the tracker.
pub(super) struct PartJudge {
    pub(super) kinds: Vec<PartKind>,
    pub(super) dark_parts: bool,
    rim: RimFinder,
}

impl PartJudge {
    pub(super) fn new(kinds: &[PartKind], dark_parts: bool) -> Self {
        Self { kinds: kinds.to_vec(), dark_parts, rim: RimFinder::new(dark_parts) }
    }

    /// The rim of a part of `kind` whose foot is near `foot_m`: rays of `N` samples over `reach_px` to both sides of it.
    pub(super) fn rim<const N: usize>(
        &self,
        sampler: &Sampler,
        table: &Table,
        kind: usize,
        foot_m: Vec2,
        reach_px: f64,
    ) -> Option<RimFit> {
        let PartKind { radius_m, thickness_m, .. } = *self.kinds.get(kind)?;
        self.rim.fit::<N>(sampler, table, &RimGuess { foot_m, radius_m, thickness_m, reach_px })
    }

    /// Where the foot of a part of `kind` is whose outline's middle is seen at `center_px`.
    pub(super) fn foot_below(&self, table: &Table, kind: usize, center_px: Vec2) -> Vec2 {
        let seen = table.table_from_image(center_px);
        let thickness_m = self.kinds.get(kind).map_or(0.0, |k| k.thickness_m);
        seen - table.parallax(seen, thickness_m).0 / 2.0
    }

    /// The kind whose radius comes nearest, `None` when none comes near.
    fn nearest_kind(&self, radius_m: f64) -> Option<usize> {
        let off = |kind: &PartKind| (radius_m / kind.radius_m - 1.0).abs();
        let best = (0..self.kinds.len()).min_by(|&a, &b| off(&self.kinds[a]).total_cmp(&off(&self.kinds[b])))?;
        (off(&self.kinds[best]) < RADIUS_TOLERANCE).then_some(best)
    }

    /// Turns a rim into a detection. `rest` is the kind's disk lying where the rim is, or next to it.
    pub(super) fn detection(&self, fit: &RimFit, rest: Rest, disk: &Disk) -> Option<Detection> {
        let kind = self.nearest_kind(fit.radius_m)?;
        let mean = rest.sum as f64 / disk.area() as f64;
        let contrast = f64::from(fit.plate_level - fit.part_level);
        let score = ((f64::from(fit.plate_level) - mean) / contrast).clamp(0.0, 1.0);
        (score >= LEAST_SCORE).then_some(Detection {
            kind,
            center_px: fit.center_px,
            radius_px: fit.radius_px,
            position_m: fit.foot_m,
            score,
            covariance_px2: fit.covariance_px2,
        })
    }
}

/// Finds every part on the plate in a whole frame: the darkness of the picture against the bare plate,
/// convolved with a solid disk of each kind's radius; peaks; rims.
pub struct CoinFinder {
    table: Table,
    judge: PartJudge,
    disks: Vec<Disk>,
    frame_size: [usize; 2],
    bin: usize,
    /// First column and row of the rectangle searched, cells.
    corner: [usize; 2],
    /// Its columns and rows.
    size: [usize; 2],
    /// The plate's columns in each row of the rectangle, first and one past the last.
    spans: Vec<(usize, usize)>,
    grid: ShadingGrid,
    convolver: DiskConvolver,
    darkness: Vec<f32>,
    inverse: Vec<f32>,
    responses: Vec<Vec<f32>>,
    response: Plane,
}

struct Candidate {
    value: f32,
    kind: usize,
    cell: [usize; 2],
}

impl CoinFinder {
    /// For frames of `frame_size` (columns, rows), kinds of parts and whether parts are darker than the plate.
    /// Kernels take the plate's mean scale.
    pub fn new(table: &Table, frame_size: [usize; 2], kinds: &[PartKind], dark_parts: bool) -> Self {
        let scale = table.mean_px_per_m();
        let radii: Vec<f64> = kinds.iter().map(|kind| kernel_radius_px(table, kind, scale)).collect();
        let smallest = radii.iter().fold(f64::INFINITY, |a, &b| a.min(b));
        let outline = outline(table);
        let (first, last) = bounds(&outline, frame_size);
        let area = ((last.x - first.x + 1.0) * (last.y - first.y + 1.0)).max(1.0);
        let bin = (smallest / LARGEST_KERNEL_PX).max((area / MOST_CELLS).sqrt());
        let bin = if bin.is_finite() { bin.ceil().clamp(1.0, 1e4) as usize } else { 1 };
        let cells = frame_size.map(|n| n / bin);
        let span = |from: f64, to: f64, n: usize| {
            let from = ((from / bin as f64) as usize).min(n);
            (from, ((to / bin as f64) as usize + 1).clamp(from, n.max(from)) - from)
        };
        let (x, width) = span(first.x, last.x, cells[0]);
        let (y, height) = span(first.y, last.y, cells[1]);
        let (width, height) = if width == 0 || height == 0 { (0, 0) } else { (width, height) };
        let binned: Vec<Disk> = radii.iter().map(|radius| Disk::new(radius / bin as f64)).collect();
        let convolver = DiskConvolver::new(width.max(1), height.max(1), &binned);
        let spans = (0..height).map(|row| span_of(&outline, (y + row) as f64, bin, x, width)).collect();
        Self {
            table: table.clone(),
            judge: PartJudge::new(kinds, dark_parts),
            disks: radii.iter().map(|&radius| Disk::new(radius)).collect(),
            frame_size,
            bin,
            corner: [x, y],
            size: [width, height],
            spans,
            grid: ShadingGrid::new(table, frame_size),
            convolver,
            darkness: vec![0.0; width * height],
            inverse: vec![0.0; width],
            responses: vec![vec![0.0; width * height]; kinds.len()],
            response: Plane { width: cells[0], height: cells[1], values: vec![0.0; cells[0] * cells[1]] },
        }
    }

    /// All parts in `frame`, sorted from the top of the picture to the bottom (by `center_px.y`, then x).
    /// None in a frame of another size than told.
    pub fn find(&mut self, frame: &Frame) -> Vec<Detection> {
        let Some(sampler) = Sampler::new(frame) else { return Vec::new() };
        if [frame.width, frame.height] != self.frame_size || self.darkness.is_empty() || self.disks.is_empty() {
            return Vec::new();
        }
        self.darken(frame, &self.grid.fit(frame, self.judge.dark_parts));
        self.convolver.load(&self.darkness);
        for (kind, response) in self.responses.iter_mut().enumerate() {
            self.convolver.respond(kind, response);
        }
        let strongest = self.responses.iter().flatten().fold(0.0f32, |a, &b| a.max(b));
        self.normalise(strongest.max(LEAST_CONTRAST));
        if strongest < LEAST_CONTRAST {
            return Vec::new();
        }
        let mut found: Vec<(usize, Detection)> =
            self.candidates().iter().filter_map(|candidate| self.examine(frame, &sampler, candidate)).collect();
        found.sort_by(|(a_rays, a), (b_rays, b)| {
            b_rays.cmp(a_rays).then(b.score.total_cmp(&a.score)).then(a.center_px.y.total_cmp(&b.center_px.y))
        });
        let mut kept: Vec<Detection> = Vec::with_capacity(found.len());
        for (_, part) in found {
            if kept.iter().all(|other| !overlap(other, &part)) {
                kept.push(part);
            }
        }
        kept.sort_by(|a, b| a.center_px.y.total_cmp(&b.center_px.y).then(a.center_px.x.total_cmp(&b.center_px.x)));
        kept
    }

    /// The last response of kind 0: 1 where a part covers the whole kernel, 0 off the plate. Over the whole frame;
    /// where kernels would exceed 96 px, one value for each square of pixels the picture was averaged over.
    pub fn response(&self) -> &Plane {
        &self.response
    }

    /// Darkness against the bare plate, 0 to 1, inside the plate's outline.
    fn darken(&mut self, frame: &Frame, shading: &Shading) {
        let sign = if self.judge.dark_parts { 1.0f32 } else { -1.0 };
        let (width, bin) = (self.size[0], self.bin);
        let share = 1.0 / (bin * bin) as f32;
        for (row, target) in self.darkness.chunks_exact_mut(width).enumerate() {
            let first = frame_from_binned(Vec2::new(self.corner[0] as f64, (self.corner[1] + row) as f64), bin);
            shading.inverse_row(first.y, first.x, bin as f64, &mut self.inverse);
            target.fill(0.0);
            let (from, to) = self.spans[row];
            let columns = (self.corner[0] + from) * bin..(self.corner[0] + to) * bin;
            let lines = (self.corner[1] + row) * bin..(self.corner[1] + row + 1) * bin;
            for line in lines {
                let pixels = &frame.row(line)[columns.clone()];
                if bin == 1 {
                    target[from..to].iter_mut().zip(pixels).for_each(|(t, &level)| *t = f32::from(level));
                } else {
                    for (t, square) in target[from..to].iter_mut().zip(pixels.chunks_exact(bin)) {
                        *t += square.iter().map(|&level| f32::from(level)).sum::<f32>() * share;
                    }
                }
            }
            for (t, inverse) in target[from..to].iter_mut().zip(&self.inverse[from..to]) {
                *t = (sign * (1.0 - *t * inverse)).clamp(0.0, 1.0);
            }
        }
    }

    /// Scales responses so that the darkest full disk is 1, and lays kind 0's over the frame.
    fn normalise(&mut self, strongest: f32) {
        let scale = 1.0 / strongest;
        for value in self.responses.iter_mut().flatten() {
            *value = (*value * scale).clamp(0.0, 1.0);
        }
        let width = self.size[0];
        for (row, values) in self.responses[0].chunks_exact(width).enumerate() {
            let start = (self.corner[1] + row) * self.response.width + self.corner[0];
            self.response.values[start..start + width].copy_from_slice(values);
        }
    }

    /// Peaks of all responses, those of the widest kernels first where they are as high.
    fn candidates(&self) -> Vec<Candidate> {
        let [width, height] = self.size;
        let least = 0.92 * LEAST_SCORE as f32;
        let mut peaks = Vec::new();
        for (kind, response) in self.responses.iter().enumerate() {
            let near = (0.4 * self.disks[kind].reach() as f64 / self.bin as f64).max(1.0);
            let mut own: Vec<Candidate> = Vec::new();
            for y in 1..height.saturating_sub(1) {
                let [above, here, below] = [y - 1, y, y + 1].map(|row| &response[row * width..][..width]);
                for x in 1..width.saturating_sub(1) {
                    let value = here[x];
                    let later = value > here[x + 1] && below[x - 1..=x + 1].iter().all(|&b| value > b);
                    let peak = || value >= here[x - 1] && above[x - 1..=x + 1].iter().all(|&a| value >= a);
                    let flat = || value >= 0.999 && x % 4 == 0 && y % 4 == 0;
                    if value > least && ((later && peak()) || flat()) {
                        own.push(Candidate { value, kind, cell: [x, y] });
                    }
                }
            }
            own.sort_by(|a, b| b.value.total_cmp(&a.value).then(a.cell.cmp(&b.cell)));
            let mut kept: Vec<Candidate> = Vec::new();
            for candidate in own {
                let distance = |other: &Candidate| {
                    let [dx, dy] = [0, 1].map(|i| candidate.cell[i] as f64 - other.cell[i] as f64);
                    dx.hypot(dy)
                };
                if kept.len() < MOST_CANDIDATES && kept.iter().all(|other| distance(other) > near) {
                    kept.push(candidate);
                }
            }
            peaks.extend(kept);
        }
        peaks
    }

    /// Rim of a candidate, close by or else with wide reach; then once more as the kind its radius tells.
    fn examine(&self, frame: &Frame, sampler: &Sampler, candidate: &Candidate) -> Option<(usize, Detection)> {
        let [x, y] = [0, 1].map(|i| (candidate.cell[i] + self.corner[i]) as f64);
        let center_px = frame_from_binned(Vec2::new(x, y), self.bin);
        let kind = candidate.kind;
        let foot_m = self.judge.foot_below(&self.table, kind, center_px);
        let radius_px = self.disks[kind].reach() as f64;
        let close = |kind, foot_m| self.judge.rim::<9>(sampler, &self.table, kind, foot_m, reach_px(radius_px));
        let wide = || self.judge.rim::<25>(sampler, &self.table, kind, foot_m, (0.2 * radius_px).max(5.0));
        let first = close(kind, foot_m).or_else(wide)?;
        let kind = self.judge.nearest_kind(first.radius_m)?;
        let mut fit = close(kind, first.foot_m)?;
        for _ in 0..3 {
            // Rays from a centre that is off see one side's plate and the other's part too near the window's end.
            let again = close(kind, fit.foot_m)?;
            let moved_px = (again.center_px - fit.center_px).norm();
            fit = again;
            if moved_px < 0.1 {
                break;
            }
        }
        let disk = &self.disks[kind];
        let (x, y) = disk.fitted(frame, fit.center_px.x.round() as i64, fit.center_px.y.round() as i64)?;
        let part = self.judge.detection(&fit, Rest { x, y, sum: disk.sum(frame, x, y) }, disk)?;
        let on_plate = self.table.holds(part.position_m, 0.75 * self.judge.kinds[part.kind].radius_m);
        on_plate.then_some((fit.agreeing, part))
    }
}

/// Half the length of the close look across a rim of that radius, px.
pub(super) fn reach_px(radius_px: f64) -> f64 {
    4.0f64.min(0.4 * radius_px)
}

/// Radius of the disk that a part of `kind` shows, px; no larger than the plate.
pub(super) fn kernel_radius_px(table: &Table, kind: &PartKind, px_per_m: f64) -> f64 {
    let shown = kind.radius_m * px_per_m * (1.0 + table.parallax(Vec2::zeros(), kind.thickness_m).1);
    shown.clamp(0.0, table.side_px.max(0.0))
}

/// True when two detections cannot be two parts.
pub(super) fn overlap(a: &Detection, b: &Detection) -> bool {
    (a.center_px - b.center_px).norm() < APART * (a.radius_px + b.radius_px)
}

/// The plate's outline, 2 px within its edge, px; sides bent by the lens are followed.
fn outline(table: &Table) -> Vec<Vec2> {
    let half = table.side_m / 2.0 * (1.0 - 4.0 / table.side_px.max(8.0));
    let corners = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(|(x, y)| Vec2::new(x, y) * half);
    let along = |i: usize, k: usize| corners[i] + (corners[(i + 1) % 4] - corners[i]) * (k as f64 / 32.0);
    (0..4 * 32).map(|k| table.image_from_table(along(k / 32, k % 32))).collect()
}

fn bounds(outline: &[Vec2], frame_size: [usize; 2]) -> (Vec2, Vec2) {
    let most = Vec2::new(frame_size[0] as f64 - 1.0, frame_size[1] as f64 - 1.0).sup(&Vec2::zeros());
    let first = outline.iter().fold(most, |a, b| a.inf(b)).sup(&Vec2::zeros());
    let last = outline.iter().fold(first, |a, b| a.sup(b)).inf(&most);
    (first, last)
}

/// Columns of the rectangle inside the outline on row `row` of cells, first and one past the last.
fn span_of(outline: &[Vec2], row: f64, bin: usize, first_column: usize, width: usize) -> (usize, usize) {
    let y = frame_from_binned(Vec2::new(0.0, row), bin).y;
    let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
    for (i, a) in outline.iter().enumerate() {
        let b = outline[(i + 1) % outline.len()];
        if (a.y <= y) != (b.y <= y) {
            let x = a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x);
            (left, right) = (left.min(x), right.max(x));
        }
    }
    if left > right {
        return (0, 0);
    }
    let middle = (bin as f64 - 1.0) / 2.0;
    let cell = |x: f64| (x - middle) / bin as f64 - first_column as f64;
    let (from, to) = (cell(left).ceil().max(0.0) as usize, (cell(right).floor() + 1.0).max(0.0) as usize);
    (from.min(width), to.clamp(from.min(width), width))
}
