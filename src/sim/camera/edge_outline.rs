use multiversion::multiversion;
use nalgebra::{Matrix2, Matrix3, Rotation2, Vector3};

use super::coverage::PixelCoverage;
use super::edge::{Blur, REACH, edge_spread};
use super::exposure::SubExposureParams;
use super::tiles::{F32Lanes, LANES, Pixels, Tile};
use super::view::CameraProjection;
use upm_core::geometry::{Pose, Vec2, perp};

/// One side of the plate during an exposure.
///
/// Motion of a side along itself does not change the picture, so a side has separate sub-exposures, chosen by its
/// motion across itself. The line's equation is averaged over a sub-exposure: a point's depth inside the side is linear
/// in it, so that the depth's mean and variance follow exactly at any point.
#[derive(Clone, Debug)]
pub(super) struct EdgeOutline {
    half_side_m: f64,
    /// Outward normal when the plate rests.
    outwards: Vec2,
    /// The line when the plate rests.
    rest: Vector3<f64>,
    pub(super) shown: Vec<EdgeLine>,
}

/// A sub-exposure of a side. A table point (x, y) has the depth `mean · (1, x, y)` inside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EdgeLine {
    mean: Vector3<f64>,
    /// Covariance of the line's coordinates about their mean.
    spread: Matrix3<f64>,
    /// Their standard deviations.
    sd: Vector3<f64>,
    /// Its share of the exposure.
    weight: f64,
}

impl EdgeOutline {
    /// A side of a plate at rest.
    pub(super) fn new(outwards: Vec2, half_side_m: f64) -> Self {
        let rest = Vector3::new(half_side_m, -outwards.x, -outwards.y);
        let line = EdgeLine { mean: rest, spread: Matrix3::zeros(), sd: Vector3::zeros(), weight: 1.0 };
        Self { half_side_m, outwards, rest, shown: vec![line] }
    }

    /// The side's lines in an exposure with the plate at `poses`.
    pub(super) fn lines(&self, poses: &[Pose], sub_exposure_params: &SubExposureParams) -> Vec<EdgeLine> {
        let along = perp(self.outwards);
        let ends = [along, -along].map(|along| at(self.half_side_m * (self.outwards + along)));
        let lines: Vec<_> = poses.iter().map(|pose| moved(self.outwards, pose)).collect();
        let across_m = |off: Vector3<f64>| ends.iter().fold(0.0_f64, |most, end| most.max(off.dot(end).abs()));
        let variance_m2 =
            |spread: &Matrix3<f64>| ends.iter().fold(0.0_f64, |most, end| most.max(end.dot(&(spread * end))));
        let sections = sub_exposure_params.sections(&lines, across_m, variance_m2);
        let line = |(off, spread, weight): (Vector3<f64>, Matrix3<f64>, f64)| {
            let off = Vector3::new(
                sub_exposure_params.rounded_m(off.x),
                sub_exposure_params.rounded_turn(off.y),
                sub_exposure_params.rounded_turn(off.z),
            );
            EdgeLine { mean: self.rest + off, spread, sd: spread.diagonal().map(f64::sqrt), weight }
        };
        sections.map(line).collect()
    }

    /// Upper bound by which the reach of the side's blur is extended, in the exposure shown and in the `next` one: a
    /// constant, m, and a slope by the distance from the resting plate's centre.
    pub(super) fn reach(&self, next: &[EdgeLine]) -> [f64; 2] {
        self.shown.iter().chain(next).fold([0.0, 0.0], |[shift_m, turn_rad], line| {
            let off = (line.mean - self.rest).abs() + REACH * line.sd;
            [shift_m.max(off.x), turn_rad.max(off.y + off.z)]
        })
    }

    /// Bounds of a point's depth inside the side during the exposure, motion within sub-exposures with its reach
    /// included, m.
    pub(super) fn depths_m(&self, p_m: Vec2) -> [f64; 2] {
        let point = at(p_m);
        self.shown.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], line| {
            let (depth_m, reach_m) = (line.mean.dot(&point), REACH * line.sd.dot(&point.abs()));
            [least.min(depth_m - reach_m), most.max(depth_m + reach_m)]
        })
    }

    /// Adds the share inside this side of a tile that no other side is near.
    pub(super) fn cover(&self, (tile, view): (&Tile, &CameraProjection), blur: &Blur, coverage: &mut PixelCoverage) {
        let (blur_m2, center, pixels) = (blur.covariance_m2(tile), at(tile.center_m), tile.pixels(view));
        let mut whole = 0.0;
        for line in &self.shown {
            let (depth_m, sd_m) = (line.mean.dot(&center), line.sd_m(&center, &blur_m2));
            let clear_m = pixels.radius_m + REACH * sd_m;
            if depth_m >= clear_m {
                whole += line.weight;
            } else if depth_m >= -clear_m {
                cover_between(&[PlateEdge::new(&line.mean, sd_m)], line.weight as f32, pixels, blur, coverage);
            }
        }
        coverage.add_everywhere(whole as f32);
    }
}

/// Difference of the line's coordinates from those at rest.
fn moved(outwards: Vec2, pose: &Pose) -> Vector3<f64> {
    let turned = Rotation2::new(pose.heading_rad) * outwards;
    Vector3::new(turned.dot(&pose.position_m), outwards.x - turned.x, outwards.y - turned.y)
}

/// Homogeneous coordinates of a table point, to be multiplied by a line.
fn at(p_m: Vec2) -> Vector3<f64> {
    Vector3::new(1.0, p_m.x, p_m.y)
}

impl EdgeLine {
    /// Standard deviation, across the line, of the blur and of the motion at a point, m.
    fn sd_m(&self, point: &Vector3<f64>, blur_m2: &Matrix2<f64>) -> f64 {
        let normal = self.mean.yz();
        (normal.dot(&(blur_m2 * normal)) + point.dot(&(self.spread * point))).sqrt()
    }
}

/// A side in the blur of one tile: points are `z = zx·x + zy·y + z0` standard deviations inside it.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlateEdge {
    z0: f32,
    zx: f32,
    zy: f32,
}

impl PlateEdge {
    /// From a line with depth `line · (1, x, y)` at (x, y), and its standard deviation there.
    pub(super) fn new(line: &Vector3<f64>, sd_m: f64) -> Self {
        let [z0, zx, zy] = [line.x, line.y, line.z].map(|coordinate| (coordinate / sd_m) as f32);
        Self { z0, zx, zy }
    }

    #[inline(always)]
    pub(super) fn depths(&self, x_m: &F32Lanes, y_m: &F32Lanes) -> F32Lanes {
        let mut depths = [0.0; LANES];
        for ((depth, x), y) in depths.iter_mut().zip(x_m).zip(y_m) {
            *depth = self.zx * x + self.zy * y + self.z0;
        }
        depths
    }
}

/// Adds `weight` times the share inside all `sides`, at most four, of the pixels of a tile.
#[multiversion(targets("x86_64+avx2"))]
pub(super) fn cover_between(
    sides: &[PlateEdge],
    weight: f32,
    pixels: &Pixels,
    blur: &Blur,
    coverage: &mut PixelCoverage,
) {
    let mut depths = [[f32::INFINITY; LANES]; 4];
    let mut least = [f32::INFINITY; LANES];
    for (depths, side) in depths.iter_mut().zip(sides) {
        *depths = side.depths(&pixels.block_x_m, &pixels.block_y_m);
        least.iter_mut().zip(&*depths).for_each(|(least, depth)| *least = least.min(*depth));
    }
    for (block, least) in least.into_iter().enumerate() {
        if least >= blur.block_reach {
            coverage.add(block, weight);
        } else if least >= -blur.block_reach {
            let mut product = [weight; LANES];
            for (side, depths) in sides.iter().zip(&depths) {
                if depths[block] < blur.block_reach {
                    let depths = side.depths(&pixels.x_m[block], &pixels.y_m[block]);
                    product.iter_mut().zip(&depths).for_each(|(p, z)| *p *= edge_spread(*z));
                }
            }
            coverage.uneven(block).iter_mut().zip(&product).for_each(|(c, p)| *c += p);
        }
    }
}
