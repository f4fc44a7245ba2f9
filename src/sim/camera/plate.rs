use nalgebra::{Matrix3, Rotation2, Vector3};

use super::coverage::PixelCoverage;
use super::edge::{Blur, REACH};
use super::edge_outline::{EdgeOutline, PlateEdge, cover_between};
use super::exposure::{SubExposure, SubExposureParams};
use super::tiles::Tile;
use super::view::CameraProjection;
use upm_core::geometry::{Pose, Vec2, perp};

/// The plate's square outline during an exposure.
///
/// A side is a straight line on the table. Along its normal n the blur of the image has the table variance nᵀ C n, C
/// the tile's covariance of the blur; the plate's motion within a sub-exposure adds its own. Where only one side is
/// near, that side's sub-exposures are used. Corners are products of two sides, in sub-exposures in which the whole
/// plate hardly moves.
#[derive(Clone, Debug)]
pub(super) struct PlateOutline {
    half_side_m: f64,
    shown: Vec<SubExposure>,
    sides: [EdgeOutline; 4],
    tiles: Vec<TileAtRest>,
}

/// Position of a tile relative to the resting plate; most tiles need nothing else.
#[derive(Clone, Copy, Debug)]
struct TileAtRest {
    /// Distance from the tile to the plate's outline, beyond the reach of its blur, m; negative when the outline is
    /// visible in it.
    clear_m: f64,
    /// Distance from the plate's centre, m.
    arm_m: f64,
}

impl TileAtRest {
    fn new(tile: &Tile, blur: &Blur, half_side_m: f64) -> Self {
        let to_edge_m = (half_side_m - tile.center_m.amax()).abs();
        let reach_m = tile.radius_bound_m + REACH * blur.bound_m(tile);
        Self { clear_m: to_edge_m - reach_m, arm_m: tile.center_m.norm() }
    }
}

/// Upper bound by which a sub-exposure extends the reach of a side's blur: a constant, m, and a slope by the distance
/// from the resting plate's centre.
fn max_sub_exposure_motion(&SubExposure { pose, spread, .. }: &SubExposure) -> [f64; 2] {
    // The sum of standard deviations is at least the root of the sum of their squares, which is the blur's.
    let [shift_m, turn_rad] = [(spread[(0, 0)] + spread[(1, 1)]).sqrt(), spread[(2, 2)].sqrt()];
    let turn_rad = pose.heading_rad.abs() + REACH * turn_rad;
    [pose.position_m.amax() + REACH * shift_m + turn_rad * pose.position_m.norm(), turn_rad]
}

impl PlateOutline {
    /// A plate at rest.
    pub(super) fn new(side_m: f64, tiles: &[Tile], blur: &Blur) -> Self {
        let rest = SubExposure { pose: Pose::IDENTITY, spread: Matrix3::zeros(), weight: 1.0 };
        let half_side_m = side_m / 2.0;
        Self {
            half_side_m,
            shown: vec![rest],
            sides: [Vec2::x(), -Vec2::x(), Vec2::y(), -Vec2::y()]
                .map(|outwards| EdgeOutline::new(outwards, half_side_m)),
            tiles: tiles.iter().map(|tile| TileAtRest::new(tile, blur, half_side_m)).collect(),
        }
    }

    /// Sets the plate's poses for a new exposure (none: unchanged) and calls `stale` with every tile whose picture may
    /// change.
    pub(super) fn show(
        &mut self,
        poses: &[Pose],
        sub_exposure_params: &SubExposureParams,
        mut stale: impl FnMut(usize),
    ) {
        if poses.is_empty() {
            return;
        }
        let next = sub_exposure_params.sub_exposures(poses.iter().copied());
        let next_lines = self.sides.each_ref().map(|side| side.lines(poses, sub_exposure_params));
        if next == self.shown && self.sides.iter().zip(&next_lines).all(|(side, lines)| side.shown == *lines) {
            return;
        }
        let (mut shift_m, mut turn_rad) = (0.0_f64, 0.0_f64);
        let sub_exposures = self.shown.iter().chain(&next).map(max_sub_exposure_motion);
        let sides = self.sides.iter().zip(&next_lines).map(|(side, lines)| side.reach(lines));
        for [shifted_m, turned_rad] in sub_exposures.chain(sides) {
            (shift_m, turn_rad) = (shift_m.max(shifted_m), turn_rad.max(turned_rad));
        }
        for (index, tile) in self.tiles.iter().enumerate() {
            if tile.clear_m <= shift_m + turn_rad * tile.arm_m {
                stale(index);
            }
        }
        self.sides.iter_mut().zip(next_lines).for_each(|(side, lines)| side.shown = lines);
        self.shown = next;
    }

    /// Adds the plate's coverage of every pixel, averaged over the exposure.
    pub(super) fn cover(&self, tile: &Tile, (view, blur): (&CameraProjection, &Blur), coverage: &mut PixelCoverage) {
        let reach_m = REACH * blur.bound_m(tile);
        let depths_m = self.sides.each_ref().map(|side| side.depths_m(tile.center_m));
        let inside_m = depths_m.iter().fold(f64::INFINITY, |inside_m, [least_m, _]| inside_m.min(*least_m));
        let outside_m = depths_m.iter().fold(f64::NEG_INFINITY, |outside_m, [_, most_m]| outside_m.max(-most_m));
        let clear_m = reach_m + tile.radius_m(view, inside_m.max(outside_m) - reach_m);
        if outside_m > clear_m {
            return;
        }
        let mut near = self.sides.iter().zip(&depths_m).filter(|(_, [least_m, _])| *least_m <= clear_m);
        match (near.next(), near.next()) {
            (None, _) => coverage.add_everywhere(1.0),
            (Some((side, _)), None) => side.cover((tile, view), blur, coverage),
            _ => self.cover_at_corner((tile, view), blur, coverage),
        }
    }

    fn cover_at_corner(&self, (tile, view): (&Tile, &CameraProjection), blur: &Blur, coverage: &mut PixelCoverage) {
        let (blur_m2, pixels) = (blur.covariance_m2(tile), tile.pixels(view));
        // Added up in f64, so that a tile inside for the whole exposure is covered by 1 exactly.
        let mut whole = 0.0;
        'squares: for square in &self.shown {
            let from_center = tile.center_m - square.pose.position_m;
            let right = Rotation2::new(square.pose.heading_rad) * Vec2::x();
            // those that cross the tile
            let mut sides = Vec::new();
            for normal in [right, perp(right)] {
                let along_m = normal.dot(&from_center);
                let motion = Vector3::new(normal.x, normal.y, normal.dot(&perp(from_center)));
                let variance = normal.dot(&(blur_m2 * normal)) + motion.dot(&(square.spread * motion));
                let sd_m = variance.sqrt();
                let clear_m = pixels.radius_m + REACH * sd_m;
                let insides_m = [(normal, self.half_side_m - along_m), (-normal, self.half_side_m + along_m)];
                for (outwards, inside_m) in insides_m {
                    if inside_m < -clear_m {
                        continue 'squares;
                    }
                    if inside_m < clear_m {
                        let offset_m = self.half_side_m + outwards.dot(&square.pose.position_m);
                        sides.push(PlateEdge::new(&Vector3::new(offset_m, -outwards.x, -outwards.y), sd_m));
                    }
                }
            }
            if sides.is_empty() {
                whole += square.weight;
            } else {
                cover_between(&sides, square.weight as f32, pixels, blur, coverage);
            }
        }
        coverage.add_everywhere(whole as f32);
    }
}
