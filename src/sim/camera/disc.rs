use multiversion::multiversion;
use nalgebra::Matrix2;

use super::coverage::PixelCoverage;
use super::edge::{Blur, REACH, edge_spread, inverse_sqrt};
use super::exposure::{SubExposure, SubExposureParams};
use super::tiles::{F32Lanes, LANES, Pixels, Tile, TileBox, TileGrid};
use super::view::CameraProjection;
use crate::PartParams;
use upm_core::geometry::{Pose, Vec2, cross};

/// One part's outline during an exposure.
#[derive(Clone, Debug)]
pub(super) struct DiscOutline {
    shape: PartParams,
    shown: Vec<SubExposure>,
    silhouettes: Vec<Silhouette>,
    tiles: TileBox,
}

/// The hull of two circles on the plate's plane: the part's foot, and its top as the camera projects it there.
///
/// ```text
///        .-----.            The hull is the union of the circles about c(t) = foot + t·lean of radius
///      .'       `.___       R(t) = foot_radius + t·growth, 0 ≤ t ≤ 1. With b the lean's length, y along
///     /    lean  |   `.     it and x ≥ 0 across it, the circle nearest to (x, y) has
///    |   foot───────top     t = y/b + x·growth/(b·sqrt(b² - growth²)), clamped to [0, 1].
///     \          |   .'
///      `._     _.'``        The distance to the hull is then |p - c(t)| - R(t).
/// ```
#[derive(Clone, Copy, Debug)]
struct Silhouette {
    foot_m: Vec2,
    foot_radius_m: f64,
    lean_m: Vec2,
    growth_m: f64,
    /// `t = t0 + t_along·y + t_across·|x|` before clamping.
    t0: f64,
    t_along: Vec2,
    t_across: Vec2,
    /// Covariance of the motion, m².
    spread_m2: Matrix2<f64>,
    weight: f64,
}

impl DiscOutline {
    /// Outline of a part that has no position yet.
    pub(super) fn new(shape: PartParams) -> Self {
        Self { shape, shown: Vec::new(), silhouettes: Vec::new(), tiles: TileBox::default() }
    }

    /// Sets the part's positions for a new exposure, none when it is hidden. Calls `stale` with every tile whose
    /// picture may change.
    pub(super) fn show(
        &mut self,
        positions_m: impl Iterator<Item = Vec2>,
        sub_exposure_params: &SubExposureParams,
        (view, grid, blur): (&CameraProjection, &TileGrid, &Blur),
        mut stale: impl FnMut(usize),
    ) {
        let poses = positions_m.map(|position_m| Pose { position_m, heading_rad: 0.0 });
        let next = sub_exposure_params.sub_exposures(poses);
        if next == self.shown {
            return;
        }
        self.tiles.indices(grid.columns).for_each(&mut stale);
        self.silhouettes = next.iter().map(|sub_exposure| Silhouette::new(&self.shape, sub_exposure, view)).collect();
        self.shown = next;
        self.tiles = self.tiles_touched(view, grid, blur);
        self.tiles.indices(grid.columns).for_each(&mut stale);
    }

    /// True when the part may be visible in the tile.
    pub(super) fn touches(&self, column: usize, row: usize) -> bool {
        self.tiles.contains(column, row)
    }

    /// Adds the part's coverage of every pixel, averaged over the exposure.
    pub(super) fn cover(&self, tile: &Tile, (view, blur): (&CameraProjection, &Blur), coverage: &mut PixelCoverage) {
        self.silhouettes.iter().for_each(|silhouette| silhouette.cover(tile, (view, blur), coverage));
    }

    /// The tiles within reach of the projections of polygons around foot and top.
    fn tiles_touched(&self, view: &CameraProjection, grid: &TileGrid, blur: &Blur) -> TileBox {
        const CORNERS: u32 = 16;
        let circumradius_m = self.shape.radius_m / libm::cos(std::f64::consts::PI / f64::from(CORNERS));
        let (mut low, mut high) = (Vec2::repeat(f64::INFINITY), Vec2::repeat(f64::NEG_INFINITY));
        for sub_exposure in &self.shown {
            for k in 0..CORNERS {
                let (sin, cos) = libm::sincos(f64::from(k) * std::f64::consts::TAU / f64::from(CORNERS));
                let p_m = sub_exposure.pose.position_m + circumradius_m * Vec2::new(cos, sin);
                for height_m in [0.0, self.shape.thickness_m] {
                    let p_px = view.image_from_table(p_m, height_m);
                    (low, high) = (low.inf(&p_px), high.sup(&p_px));
                }
            }
        }
        if self.shown.is_empty() {
            return TileBox::default();
        }
        // Within a sub-exposure a part moves by less than the blur's standard deviation.
        let margin = Vec2::repeat(1.5 * REACH * blur.sd_px());
        grid.between(low - margin, high + margin)
    }
}

impl Silhouette {
    fn new(shape: &PartParams, sub_exposure: &SubExposure, view: &CameraProjection) -> Self {
        let foot_m = sub_exposure.pose.position_m;
        let (top_m, magnification) = view.shadow(foot_m, shape.thickness_m);
        let (lean_m, growth_m) = (top_m - foot_m, (magnification - 1.0) * shape.radius_m);
        let (b2, flank2) = (lean_m.norm_squared(), lean_m.norm_squared() - growth_m * growth_m);
        let (t0, t_along, t_across) = if flank2 > 0.0 {
            (0.0, lean_m / b2, lean_m * (growth_m / (b2 * flank2.sqrt())))
        } else {
            (1.0, Vec2::zeros(), Vec2::zeros())
        };
        let spread_m2 = sub_exposure.spread.fixed_view::<2, 2>(0, 0).into_owned();
        let (foot_radius_m, weight) = (shape.radius_m, sub_exposure.weight);
        Self { foot_m, foot_radius_m, lean_m, growth_m, t0, t_along, t_across, spread_m2, weight }
    }

    /// Signed distance on the table, negative inside, m.
    fn distance_m(&self, p_m: Vec2) -> f64 {
        let q = p_m - self.foot_m;
        let t = (self.t0 + self.t_along.dot(&q) + cross(self.t_across, q).abs()).clamp(0.0, 1.0);
        (q - t * self.lean_m).norm() - (self.foot_radius_m + t * self.growth_m)
    }

    fn cover(&self, tile: &Tile, (view, blur): (&CameraProjection, &Blur), coverage: &mut PixelCoverage) {
        let covariance = blur.covariance_m2(tile) + self.spread_m2;
        let reach_m = REACH * covariance.trace().sqrt();
        let distance_m = self.distance_m(tile.center_m);
        let clear_m = tile.radius_m(view, distance_m.abs() - reach_m) + reach_m;
        let weight = self.weight as f32;
        if distance_m < -clear_m {
            coverage.add_everywhere(weight);
        } else if distance_m < clear_m {
            cover_within(&Rim::new(self, &covariance), weight, tile.pixels(view), blur, coverage);
        }
    }
}

#[multiversion(targets("x86_64+avx2"))]
fn cover_within(rim: &Rim, weight: f32, pixels: &Pixels, blur: &Blur, coverage: &mut PixelCoverage) {
    let depths = rim.depths(&pixels.block_x_m, &pixels.block_y_m);
    for (block, depth) in depths.into_iter().enumerate() {
        if depth > blur.block_reach {
            coverage.add(block, weight);
        } else if depth > -blur.block_reach {
            let depths = rim.depths(&pixels.x_m[block], &pixels.y_m[block]);
            coverage.uneven(block).iter_mut().zip(depths).for_each(|(c, z)| *c += weight * edge_spread(z));
        }
    }
}

/// A silhouette prepared for vector code, with the blur of one tile.
struct Rim {
    foot: [f32; 2],
    lean: [f32; 2],
    t0: f32,
    along: [f32; 2],
    across: [f32; 2],
    radius: f32,
    growth: f32,
    /// Inward shift of the half level by blur, on the arcs and on the straight flanks.
    inwards: [f32; 2],
    /// xx, twice xy, yy.
    covariance: [f32; 3],
}

impl Rim {
    fn new(silhouette: &Silhouette, covariance: &Matrix2<f64>) -> Self {
        let pair = |v: Vec2| [v.x as f32, v.y as f32];
        // Blur moves the half level of a curved edge inwards by its variance over twice the radius,
        // and that of a straight piece the less the longer it is.
        let variance = covariance.trace() / 2.0;
        let bent = variance / (2.0 * silhouette.foot_radius_m);
        let flank_m = (silhouette.lean_m.norm_squared() - silhouette.growth_m.powi(2)).max(0.0).sqrt();
        let straight = bent * (1.0 - 0.4 * flank_m / variance.sqrt()).max(0.0);
        Self {
            foot: pair(silhouette.foot_m),
            lean: pair(silhouette.lean_m),
            t0: silhouette.t0 as f32,
            along: pair(silhouette.t_along),
            across: pair(silhouette.t_across),
            radius: silhouette.foot_radius_m as f32,
            growth: silhouette.growth_m as f32,
            inwards: [bent, straight].map(|m| m as f32),
            covariance: [covariance.m11, 2.0 * covariance.m12, covariance.m22].map(|c| c as f32),
        }
    }

    /// Depths of table points inside the outline, in standard deviations of the blur. With w = p - c(t), the edge's
    /// normal is w/|w| and the blur along it has the variance wᵀCw/|w|².
    #[inline(always)]
    fn depths(&self, x_m: &F32Lanes, y_m: &F32Lanes) -> F32Lanes {
        // Avoids 0/0 at the circle's centre; far below the visible range.
        const TINY_M2: f32 = 1e-14;
        let mut depths = [0.0; LANES];
        for ((depth, x), y) in depths.iter_mut().zip(x_m).zip(y_m) {
            let [qx, qy] = [x - self.foot[0], y - self.foot[1]];
            let aside = (self.across[0] * qy - self.across[1] * qx).abs();
            let free = self.t0 + self.along[0] * qx + self.along[1] * qy + aside;
            let t = free.clamp(0.0, 1.0);
            let inwards = self.inwards[usize::from(free == t)];
            let [wx, wy] = [qx - t * self.lean[0], qy - t * self.lean[1]];
            let w2 = wx * wx + wy * wy + TINY_M2;
            let [cxx, cxy, cyy] = self.covariance;
            let variance_w2 = cxx * (wx * wx + TINY_M2) + cxy * wx * wy + cyy * wy * wy;
            let radius = self.radius + t * self.growth - inwards;
            *depth = w2 * (radius * inverse_sqrt(w2) - 1.0) * inverse_sqrt(variance_w2);
        }
        depths
    }
}
