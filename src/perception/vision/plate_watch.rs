mod blobs;
mod grid;

use nalgebra::{Rotation2, Vector3};

use self::blobs::{BARE, BORDER, Blob, Blobs, DIFFERS, SEEN, UNSEEN};
use self::grid::CellGrid;
use super::binned::BinnedImage;
use super::outline::PlateCells;
use super::sampling::quantile;
use super::shading::Shading;
use super::{Table, Track};
use upm_core::geometry::{Vec2, perp};
use upm_core::rig::PartKind;
use upm_core::signal::Frame;

/// Most foreign parts reported per frame.
const MOST_FOREIGN: usize = 8;
/// Margin ignored around a tracked part beyond its outline, as a fraction of its radius and px.
const MARGIN_RADII: f64 = 0.15;
const MARGIN_PX: f64 = 4.0;
/// Difference from the bare plate from which a sample counts as covered, darker or lighter, as a fraction of the
/// plate's level. Glints and shadows of parts are below it.
const DARKER: f32 = 0.2;
const LIGHTER: f32 = 0.1;
/// The same in standard deviations of the frame's noise, and its upper bound as a fraction of the plate's level.
const NOISE_SDS: f64 = 6.0;
const MOST_NOISE: f64 = 0.35;
/// Added to both thresholds, levels.
const FLOOR: f32 = 3.0;
/// Samples from which the light is measured, at most and at least. A prime number spreads them over all columns of the
/// grid.
const PROBES: usize = 251;
const LEAST_PROBES: usize = 16;
/// A plate no brighter than this, levels, or with more scatter than this about its reference counts as not seen.
const DARKEST: f64 = 8.0;
const MOST_SCATTER: f64 = 0.1;
/// Standard deviation of a normal distribution over the lower quartile of absolute deviations, which a hand over nearly
/// half of the plate hardly widens.
const SD_OF_QUARTILE: f64 = 3.138;
/// From this level on a sample may be saturated.
const SATURATED: f32 = 250.0;
/// Share of such samples above which the plate counts as saturated; glints stay below it.
const SATURATED_SHARE: f64 = 0.03;
/// Side of the squares to which the plate's brightness is fitted, px.
const BIN: usize = 4;

/// Occupancy of the plate in one frame, apart from the tracked parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateOccupancy<'a> {
    /// Middles of objects of a part's size in plain view that are no tracked parts, m; the first 8 of them.
    pub foreign_m: &'a [Vec2],
    /// Share of the plate hidden by an object too large for a part or one that reaches over the plate's border, or
    /// beside the last place of a part that is not seen: 0 to 1.
    pub hidden_share: f64,
    /// True when the frame shows no plate: black, unreadable, or more than half of it covered.
    pub dark: bool,
}

/// Detects objects on the plate other than the tracked parts.
///
/// A grid of samples covers the plate, half a radius of the smallest kind apart. Each has a reference level: that of
/// the first frame where it showed bare plate, until then the level of a quadratic surface through the plate's
/// brightness. The light of a frame is the median ratio of samples and references. Samples that are lighter or darker
/// than the lit reference and belong to no part are connected into blobs; a blob is judged by its size and by its
/// neighbours. A mark on the plate as large as a part, and a fifth darker than the plate, is reported as foreign, too.
pub struct PlateWatch {
    table: Table,
    kinds: Vec<PartKind>,
    dark_parts: bool,
    frame_size: [usize; 2],
    cells: PlateCells,
    grid: CellGrid,
    /// Indices of the samples from which the light is measured.
    probes: Vec<usize>,
    reference: Reference,
    /// Gray level of each sample in the newest frame.
    levels: Vec<f32>,
    /// State of every place if no sample differed: places ignored because of tracked parts, and bare plate.
    excused: Vec<u8>,
    blobs: Blobs,
    foreign_m: Vec<Vec2>,
}

/// Gray levels of the bare plate.
#[derive(Default)]
struct Reference {
    /// Level of each sample, in the light of the first frame.
    levels: Vec<f32>,
    /// Median of the levels.
    median: f64,
    /// Samples whose level is still that of the surface.
    pending: Vec<usize>,
    /// True after the first frame that shows a plate.
    is_known: bool,
    /// True while the reference is that of a saturated plate, to be learned again in less light.
    is_saturated: bool,
}

/// Brightness of a frame relative to the first one, and robust standard deviation of the samples about it.
#[derive(Clone, Copy)]
struct LightLevel {
    ratio: f64,
    scatter: f64,
}

impl PlateWatch {
    /// For frames of `frame_size` (columns, rows), all kinds of tracked parts and `dark_parts` where they are darker
    /// than the plate.
    pub fn new(table: &Table, frame_size: [usize; 2], kinds: &[PartKind], dark_parts: bool) -> Self {
        let radii_m = || kinds.iter().map(|kind| kind.radius_m);
        let smallest_m = radii_m().fold(f64::INFINITY, f64::min).min(table.side_m / 4.0);
        let largest_m = radii_m().fold(smallest_m, f64::max);
        let grid = CellGrid::new(table, frame_size, smallest_m / 2.0);
        let usable: Vec<usize> = grid.usable().collect();
        let excused_m = largest_m * (1.0 + MARGIN_RADII) + MARGIN_PX / table.mean_px_per_m();
        let probes = PROBES.min(usable.len());
        Self {
            table: table.clone(),
            kinds: kinds.to_vec(),
            dark_parts,
            frame_size,
            cells: PlateCells::new(table, frame_size, BIN, MARGIN_PX),
            probes: (0..probes).map(|i| usable[i * usable.len() / probes]).collect(),
            reference: Reference::default(),
            levels: vec![0.0; grid.len()],
            excused: vec![BARE; grid.len()],
            blobs: Blobs::new(&grid, [smallest_m, largest_m], excused_m),
            foreign_m: Vec::with_capacity(MOST_FOREIGN),
            grid,
        }
    }

    /// Checks the plate in `frame`; `tracks` hold the last seen places of the parts. The first frame that shows a plate
    /// takes longer: the plate's brightness is learned from it.
    pub fn check(&mut self, frame: &Frame, tracks: &[Track]) -> PlateOccupancy<'_> {
        self.check_swung(frame, tracks, Vector3::zeros())
    }

    /// As [`Self::check`], for a plate that has swung by this shift along the table's axes and turn at the corners, px:
    /// nothing is learned from it.
    pub fn check_swung(&mut self, frame: &Frame, tracks: &[Track], swing_px: Vector3<f64>) -> PlateOccupancy<'_> {
        self.foreign_m.clear();
        if let Some(positions) = &frame.positions {
            let dark = positions.corners_px.is_none() && positions.discs.is_empty();
            let hidden_share = if dark || positions.corners_px.is_some() { 0.0 } else { 1.0 };
            return PlateOccupancy { foreign_m: &[], hidden_share, dark };
        }
        match self.hidden_share(frame, tracks, swing_px) {
            Some(hidden_share) => PlateOccupancy { foreign_m: &self.foreign_m, hidden_share, dark: false },
            None => PlateOccupancy { foreign_m: &[], hidden_share: 0.0, dark: true },
        }
    }

    /// Fills `foreign_m` and returns the hidden share; `None` for a frame that shows no plate.
    fn hidden_share(&mut self, frame: &Frame, tracks: &[Track], swing_px: Vector3<f64>) -> Option<f64> {
        let whole = frame.width.checked_mul(frame.height) == Some(frame.pixels.len());
        if !whole || [frame.width, frame.height] != self.frame_size {
            return None;
        }
        let is_swung = swing_px != Vector3::zeros();
        if is_swung {
            let moved = moved_pixels(&self.table, swing_px, self.frame_size);
            self.grid.read(&frame.pixels, &mut self.levels, moved);
        } else {
            self.grid.read(&frame.pixels, &mut self.levels, Some);
        }
        self.excuse(tracks, swing_px);
        let is_saturated = self.saturated_share() > SATURATED_SHARE;
        if is_swung && !self.reference.is_known {
            return Some(0.0);
        }
        if !self.reference.is_known || self.reference.is_saturated && !is_saturated && !is_swung {
            self.load_surface(frame);
            self.reference.is_saturated = is_saturated;
        }
        let light = self.light()?;
        let [differing, compared] = self.compare(light);
        if 2 * differing > compared {
            return None;
        }
        if !is_swung {
            self.learn(light);
        }
        let hidden = if differing > 0 { self.gather() } else { 0 };
        Some(hidden as f64 / f64::from(compared.max(1)))
    }

    /// Marks the samples that tracked parts cover or may cover.
    fn excuse(&mut self, tracks: &[Track], swing_px: Vector3<f64>) {
        self.excused.fill(BARE);
        let per_px = 0.5 * std::f64::consts::SQRT_2 * self.table.side_m / self.table.extent().1;
        let (back, shift_m) = (Rotation2::new(-swing_px.z / self.table.extent().1), swing_px.xy() * per_px);
        for Track { seen, frames_unseen } in tracks {
            let Some(PartKind { radius_m, thickness_m, .. }) = self.kinds.get(seen.kind) else { continue };
            let (parallax_m, growth) = self.table.parallax(seen.position_m, *thickness_m);
            let center_m = back * (seen.position_m + parallax_m / 2.0 - shift_m);
            let reach_m = radius_m * (1.0 + growth + MARGIN_RADII)
                + parallax_m.norm() / 2.0
                + MARGIN_PX / self.table.px_per_m_at(seen.position_m);
            let excuse = if *frames_unseen == 0 { SEEN } else { UNSEEN };
            self.grid.within(center_m, reach_m, |sample| self.excused[sample] = excuse);
        }
    }

    /// Sets the references of all samples from the plate's brightness in `frame`.
    fn load_surface(&mut self, frame: &Frame) {
        let picture = BinnedImage::part_of(frame, self.cells.bin, self.cells.corner, self.cells.size);
        let shading = Shading::fit(&picture, &self.cells, self.dark_parts);
        let mut inverse = vec![1.0; picture.width.max(1)];
        let mut last_row = None;
        let Self { reference, grid, cells, .. } = self;
        reference.levels.clear();
        reference.levels.resize(grid.len(), f32::NAN);
        reference.pending.clear();
        for sample in grid.usable() {
            let pixel = grid.pixel(sample);
            let at = [pixel % self.frame_size[0], pixel / self.frame_size[0]];
            let cell = [0, 1].map(|i| (at[i] / cells.bin).saturating_sub(cells.corner[i]).min(cells.size[i]));
            if last_row.replace(cell[1]) != Some(cell[1]) {
                shading.inverse_row(cell[1], &mut inverse);
            }
            reference.levels[sample] = 1.0 / inverse[cell[0].min(inverse.len() - 1)];
            reference.pending.push(sample);
        }
        let mut levels: Vec<f64> = self.probes.iter().map(|&probe| f64::from(reference.levels[probe])).collect();
        reference.median = quantile(&mut levels, 0.5);
    }

    /// Share of the plate that is saturated in the newest frame.
    fn saturated_share(&self) -> f64 {
        let open = || self.probes.iter().filter(|&&probe| self.excused[probe] == BARE);
        let saturated = open().filter(|&&probe| self.levels[probe] >= SATURATED).count();
        saturated as f64 / open().count().max(1) as f64
    }

    /// The light of the newest frame, if it shows a plate. Where most of the plate is saturated the light is that of
    /// its dimmest places: the others only bound it from below.
    fn light(&self) -> Option<LightLevel> {
        let (mut ratios, mut count) = ([0.0; PROBES], 0);
        for &probe in self.probes.iter().filter(|&&probe| self.excused[probe] == BARE).take(PROBES) {
            ratios[count] = f64::from(self.levels[probe] / self.reference.levels[probe]);
            count += 1;
        }
        if count < LEAST_PROBES {
            return None;
        }
        let ratios = &mut ratios[..count];
        let is_saturated = self.saturated_share() > 0.5;
        let ratio = quantile(ratios, if is_saturated { 0.9 } else { 0.5 });
        ratios.iter_mut().for_each(|value| *value = (*value / ratio - 1.0).abs());
        let scatter = if is_saturated { 0.0 } else { SD_OF_QUARTILE * quantile(ratios, 0.25) };
        let shows_plate = ratio * self.reference.median > DARKEST && scatter < MOST_SCATTER;
        shows_plate.then_some(LightLevel { ratio, scatter })
    }

    /// Marks the samples that differ from the lit reference and belong to no tracked part. Returns their number and
    /// that of all samples compared.
    fn compare(&mut self, light: LightLevel) -> [u32; 2] {
        let noise = (NOISE_SDS * light.scatter).min(MOST_NOISE) as f32;
        let (least, most) = (1.0 - noise.max(DARKER), 1.0 + noise.max(LIGHTER));
        let ratio = light.ratio as f32;
        let (mut differing, mut compared) = (0, 0);
        let samples = self.levels.iter().zip(&self.reference.levels).zip(&self.excused);
        for (state, ((level, reference), excuse)) in self.blobs.states().iter_mut().zip(samples) {
            let expected = (ratio * reference).min(255.0);
            let differs = (*level < least * expected - FLOOR) | (*level > most * expected + FLOOR);
            // Without a sample the level is NaN.
            let bare = if level.is_nan() { BORDER } else { *excuse };
            *state = if bare == BARE { u8::from(differs) * DIFFERS } else { bare };
            differing += u32::from(differs & (bare == BARE));
            compared += u32::from(bare == BARE);
        }
        [differing, compared]
    }

    /// Sets references from bare plate for samples that have only the surface's level so far.
    fn learn(&mut self, light: LightLevel) {
        let Self { reference, levels, blobs, .. } = self;
        let Reference { levels: references, pending, .. } = reference;
        let states = blobs.states();
        pending.retain(|&sample| {
            let bare = states[sample] == BARE && levels[sample] < SATURATED;
            if bare {
                references[sample] = levels[sample] / light.ratio as f32;
            }
            !bare
        });
        reference.is_known = true;
    }

    /// Connects differing samples to blobs: collects foreign parts, returns the number of hidden samples.
    fn gather(&mut self) -> usize {
        let Self { blobs, foreign_m, grid, .. } = self;
        let mut hidden = 0;
        blobs.gather(|blob| match blob {
            Blob::Hiding { samples } => hidden += samples,
            Blob::Foreign { middle } if foreign_m.len() < MOST_FOREIGN => foreign_m.push(grid.place_m(middle)),
            Blob::Foreign { .. } => {}
        });
        hidden
    }
}

/// Where the pixels of a plate are that has swung; `None` outside of the frame.
fn moved_pixels(
    table: &Table,
    swing_px: Vector3<f64>,
    [width, height]: [usize; 2],
) -> impl Fn(usize) -> Option<usize> + use<> {
    let (middle_px, radius_px) = table.extent();
    let motion_px = table.in_picture(swing_px);
    move |pixel| {
        let at_px = Vec2::new((pixel % width) as f64, (pixel / width) as f64);
        let to_px = at_px + motion_px.xy() + perp(at_px - middle_px) * (motion_px.z / radius_px);
        let [x, y] = [to_px.x.round(), to_px.y.round()];
        let is_within = x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64;
        is_within.then(|| y as usize * width + x as usize)
    }
}
