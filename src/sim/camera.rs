//! Synthetic camera: the image of plate and parts through a pinhole and a real lens.
//!
//! ```text
//!              ◇ camera at position_m
//!             ╱│╲
//!            ╱ │ ╲  lines of sight
//!     z     ╱  │  ╲ top
//!     │    ╱   │   ┌╲──┐  thickness
//!     └─x ╱────┴───┴─╲─┴────── plate ──┐
//!   ─────────────────────────────── ground ───
//!                  foot ╲ the top's shadow on the plate's plane
//! ```
//!
//! Without tilt the image's x runs along the table's x and its y against the table's y. `tilt_rad` turns the camera
//! about the image's own x and y axes and the optical axis, in that order, each right-handed (x right, y down, axis
//! away from the camera). A part's outline is the hull of its foot and of its top as projected from the camera on the
//! plate's plane.
//!
//! Before noise a pixel's gray level is `light · (bg + (part - bg)·c)`, `bg = ground + (plate - ground)·b`, with b and
//! c the shares of the pixel's blurred footprint on plate and parts; parts that touch add up. `light` falls off evenly
//! along `shading_direction_rad`, from 1 at the near corner to `1 - shading` at the far one. The footprint is the
//! lens's Gaussian and the pixel's square, approximated together by one Gaussian of variance `blur² + 1/12` (fourth
//! moments differ: edges are exact at their half level and within 0.2 % of their step elsewhere for a blur of 0.5 px or
//! more, 4 % without blur). Shares are computed analytically from signed distances on the plate's plane, each divided
//! by the footprint's standard deviation there along the edge's normal, which includes tilt and distortion. Where a rim
//! crosses the plate's edge the two shares multiply as if independent, which is wrong in the few pixels within the blur
//! of both. An exposure is cut into sub-exposures (`exposure.rs`) that differ from the mean of the snapshots by less
//! than 0.2 % of an edge's step, by 0.6 % in the plate's corners. Each side of the plate has separate sub-exposures
//! (`edge_outline.rs`), chosen by its motion across itself; where two sides are near, as in corners, those of the whole
//! plate are used.
//!
//! Parts whose centre is off the plate at the middle of the exposure have fallen: dark on dark ground, they are not
//! drawn.
//!
//! The clean picture is kept from frame to frame in 16 × 16 tiles. It depends on the exposure alone. A frame repaints
//! the tiles in which something moved, now or since the previous frame, and only those of their 4 × 4 blocks that an
//! edge reaches, now or then, or whose even cover changed. Noise is then added to the whole frame in one pass.
//!
//! Code that runs over pixels is compiled for AVX2 as well and chosen at run time: wider vectors of the same operations
//! in the same order, no fused ones, so that pictures are bit-identical with and without.

mod coverage;
mod disc;
mod edge;
mod edge_outline;
mod exposure;
mod noise;
mod plate;
mod positions;
#[cfg(test)]
mod reference;
#[cfg(test)]
mod scenes;
#[cfg(test)]
mod tests;
mod tiles;
mod view;

use super::{CameraParams, PartParams};
use coverage::PixelCoverage;
use disc::DiscOutline;
use edge::Blur;
use exposure::SubExposureParams;
use noise::Noise;
use plate::PlateOutline;
use tiles::{AREA, BLOCK_SIDE, F32Lanes, LANE_X, LANE_Y, LANES, SIDE, TileGrid};
use upm_core::geometry::{Pose, Vec2};
use upm_core::random::Rng;
use upm_core::signal::Frame;
use view::CameraProjection;

/// Scene at one instant of an exposure.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Snapshot {
    /// Pose of the plate relative to its rest position.
    pub plate_in_table: Pose,
    /// Pose of every part, in the order of the camera's parts; `None` for one that fell off the plate.
    pub parts_in_table: Vec<Option<Pose>>,
}

impl Snapshot {
    /// Pose of part number `index`; `None` where there is none.
    fn pose(&self, index: usize) -> Option<Pose> {
        self.parts_in_table.get(index).copied().flatten()
    }

    /// The pose of a part on a plate of `plate_side_m`.
    fn pose_on_plate(&self, index: usize, plate_side_m: f64) -> Option<Pose> {
        let is_on = |pose: &Pose| self.plate_in_table.apply_inverse(pose.position_m).amax() <= plate_side_m / 2.0;
        self.pose(index).filter(is_on)
    }
}

/// Synthetic camera above a square plate and its parts; its position must be above them. Frames depend only on its
/// parameters, its generator and the sequence of calls.
#[derive(Clone, Debug)]
pub(crate) struct Camera {
    pub params: CameraParams,
    pub plate_side_m: f64,
    pub parts: Vec<PartParams>,
    view: CameraProjection,
    noise: Rng,
    /// Made for the first picture: runs without pixels have none.
    renderer: Option<Box<Renderer>>,
}

impl Camera {
    /// All noise of its pictures comes from `noise`.
    pub fn new(params: CameraParams, plate_side_m: f64, parts: Vec<PartParams>, noise: Rng) -> Self {
        Self { params, plate_side_m, parts, view: CameraProjection::new(&params), noise, renderer: None }
    }

    /// True projection of a table point `height_m` above the plate, px; includes lens distortion.
    pub fn image_from_table(&self, p_m: Vec2, height_m: f64) -> Vec2 {
        self.view.image_from_table(p_m, height_m)
    }

    /// Renders the mean over `exposure`, snapshots evenly spread over the open shutter, into `frame.pixels`. The frame
    /// is resized to fit; its index and time are left to the caller. An empty exposure keeps the plate and draws no
    /// parts.
    pub fn render(&mut self, exposure: &[Snapshot], frame: &mut Frame) {
        let Self { params, plate_side_m, parts, noise, .. } = self;
        let make = || Box::new(Renderer::new(*params, *plate_side_m, parts, noise.clone()));
        self.renderer.get_or_insert_with(make).render(exposure, frame);
    }
}

/// Renders pictures; repaints only what changed.
#[derive(Clone, Debug)]
struct Renderer {
    params: CameraParams,
    plate_side_m: f64,
    view: CameraProjection,
    grid: TileGrid,
    blur: Blur,
    sub_exposure_params: SubExposureParams,
    light: Illumination,
    plate: PlateOutline,
    parts: Vec<DiscOutline>,
    /// Tiles to be painted again.
    stale: Vec<bool>,
    /// Coverage by plate and parts with which each block of each tile was last painted; NaN where its pixels differ.
    painted: Vec<[[f32; 2]; LANES]>,
    /// Coverage by plate and parts in the tile being painted.
    coverage: [PixelCoverage; 2],
    /// The clean picture, row by row, `grid.stride()` pixels a row, units of 1/128 level, half a level added.
    clean: Vec<i16>,
    /// Standard deviation of each pixel's noise, laid out as `clean`.
    sd: Vec<u8>,
    noise: Noise,
}

impl Renderer {
    fn new(params: CameraParams, plate_side_m: f64, parts: &[PartParams], noise: Rng) -> Self {
        let view = CameraProjection::new(&params);
        let grid = TileGrid::new(&view, params.size_px);
        let blur = Blur::new(&params);
        let sub_exposure_params = SubExposureParams { blur_m: blur.sd_px() * view.m_per_px(), arm_m: plate_side_m };
        let tiles = grid.tiles.len();
        Self {
            light: Illumination::new(&params),
            plate: PlateOutline::new(plate_side_m, &grid.tiles, &blur),
            parts: parts.iter().copied().map(DiscOutline::new).collect(),
            noise: Noise::new(&params, noise, params.size_px[0]),
            clean: vec![0; tiles * AREA],
            sd: vec![0; tiles * AREA],
            params,
            plate_side_m,
            view,
            grid,
            blur,
            sub_exposure_params,
            stale: vec![true; tiles],
            painted: vec![[[f32::NAN; 2]; LANES]; tiles],
            coverage: [PixelCoverage::none(), PixelCoverage::none()],
        }
    }

    fn render(&mut self, exposure: &[Snapshot], frame: &mut Frame) {
        self.mark_changes(exposure);
        self.redraw_dirty();
        self.expose(frame);
    }

    fn mark_changes(&mut self, exposure: &[Snapshot]) {
        let Self { plate_side_m, view, grid, blur, sub_exposure_params, plate, parts, stale, .. } = self;
        let poses: Vec<Pose> = exposure.iter().map(|snapshot| snapshot.plate_in_table).collect();
        plate.show(&poses, sub_exposure_params, |index| stale[index] = true);
        let middle = exposure.get(exposure.len() / 2);
        for (index, part) in parts.iter_mut().enumerate() {
            let in_middle = middle.and_then(|snapshot| snapshot.pose_on_plate(index, *plate_side_m));
            let seen = if in_middle.is_some() { exposure } else { &[] };
            let positions_m =
                seen.iter().map(|snapshot| snapshot.pose(index).or(in_middle).unwrap_or_default().position_m);
            part.show(positions_m, sub_exposure_params, (view, grid, blur), |index| stale[index] = true);
        }
    }

    fn redraw_dirty(&mut self) {
        for index in 0..self.stale.len() {
            if std::mem::take(&mut self.stale[index]) {
                self.paint(index);
            }
        }
    }

    /// Repaints the blocks of a tile whose coverage changed.
    fn paint(&mut self, index: usize) {
        let (column, row) = (index % self.grid.columns, index / self.grid.columns);
        let (Some(tile), Some(painted)) = (self.grid.tiles.get(index), self.painted.get_mut(index)) else { return };
        self.coverage.iter_mut().for_each(PixelCoverage::clear);
        let [on_plate, on_parts] = &mut self.coverage;
        let lens = (&self.view, &self.blur);
        self.plate.cover(tile, lens, on_plate);
        for part in self.parts.iter().filter(|part| part.touches(column, row)) {
            part.cover(tile, lens, on_parts);
        }
        let levels = self.params.levels.map(|level| level as f32);
        let stride = self.grid.stride();
        for (block, painted) in painted.iter_mut().enumerate() {
            let before = std::mem::replace(painted, [on_plate.even(block), on_parts.even(block)]);
            // NaN equals nothing, so blocks with an edge are always repainted.
            if *painted == before {
                continue;
            }
            let x = column * SIDE + block % BLOCK_SIDE * BLOCK_SIDE;
            let y = row * SIDE + block / BLOCK_SIDE * BLOCK_SIDE;
            let coverage = (&on_plate.of_block(block), &on_parts.of_block(block));
            let clean = compose_block(levels, self.light.at(x, y), coverage);
            let sd = self.noise.deviations(&clean);
            let rows = clean.as_chunks::<BLOCK_SIDE>().0.iter().zip(sd.as_chunks::<BLOCK_SIDE>().0);
            for (y, (clean, sd)) in (y..).zip(rows) {
                self.clean[y * stride + x..][..BLOCK_SIDE].copy_from_slice(clean);
                self.sd[y * stride + x..][..BLOCK_SIDE].copy_from_slice(sd);
            }
        }
    }

    fn expose(&mut self, frame: &mut Frame) {
        let [width, height] = self.params.size_px;
        (frame.width, frame.height) = (width, height);
        frame.pixels.resize(width * height, 0);
        let stride = self.grid.stride();
        if stride == 0 {
            return;
        }
        let rows = self.clean.chunks_exact(stride).zip(self.sd.chunks_exact(stride));
        for (out, (clean, sd)) in frame.pixels.chunks_exact_mut(width).zip(rows) {
            self.noise.apply_to_row(&clean[..width], &sd[..width], out);
        }
    }
}

/// Gray levels of one block, in the units of the clean picture, from the coverage by plate and parts. A separate
/// function, because inlined into the code that reads single pixels it is not vectorised.
#[inline(never)]
fn compose_block(
    [ground, plate, part]: [f32; 3],
    [light, light_x, light_y]: [f32; 3],
    (on_plate, on_parts): (&F32Lanes, &F32Lanes),
) -> [i16; LANES] {
    // Adding 1.5·2²³ leaves the nearest whole number in the low bits.
    const ROUND: f32 = 12_582_912.0;
    const WHITE: f32 = 255.0 * noise::UNITS;
    let mut lit = [0.0; LANES];
    for (i, lit) in lit.iter_mut().enumerate() {
        let background = ground + (plate - ground) * on_plate[i];
        let reflected = background + (part - background) * on_parts[i].min(1.0);
        *lit = noise::UNITS * (light + light_x * LANE_X[i] + light_y * LANE_Y[i]) * reflected;
    }
    let mut clean = [0; LANES];
    for (clean, lit) in clean.iter_mut().zip(&lit) {
        let units = (lit.clamp(0.0, WHITE) + ROUND).to_bits().wrapping_sub(ROUND.to_bits()).cast_signed();
        // The clamp changes no value, but lets the compiler pack with a single instruction.
        *clean = (units.clamp(i16::MIN.into(), i16::MAX.into()) as i16).wrapping_add(noise::HALF);
    }
    clean
}

/// Light that falls off evenly across the image: `at_origin + slope · (x, y)`.
#[derive(Clone, Copy, Debug)]
struct Illumination {
    at_origin: f64,
    slope: Vec2,
}

impl Illumination {
    fn new(params: &CameraParams) -> Self {
        let (sin, cos) = libm::sincos(params.shading_direction_rad);
        let last = params.size_px.map(|count| count.saturating_sub(1) as f64);
        let (x, y) = (cos * last[0], sin * last[1]);
        let (near, far) = (x.min(0.0) + y.min(0.0), x.max(0.0) + y.max(0.0));
        let fall_per_px = params.shading / (far - near).max(1.0);
        Self { at_origin: 1.0 + fall_per_px * near, slope: -fall_per_px * Vec2::new(cos, sin) }
    }

    /// At a pixel, and its change from there to the next on the right and below.
    fn at(&self, x: usize, y: usize) -> [f32; 3] {
        [self.at_origin + self.slope.dot(&Vec2::new(x as f64, y as f64)), self.slope.x, self.slope.y].map(|l| l as f32)
    }
}
