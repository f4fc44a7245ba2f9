use nalgebra::{Matrix2, Matrix3, Rotation2, Vector3};

use super::Blur;
use super::edge::{REACH, edge_spread};
use super::exposure::{Glimpse, Grain};
use super::shares::Shares;
use super::tiles::{LANES, Tile};
use crate::geometry::{Pose, Vec2, perp};

/// The plate's square outline as the exposure saw it.
///
/// A side is a straight line on the table. Along its normal n the blur of the image has the table variance
/// nᵀ C n, C the tile's covariance of the blur; the plate's motion within a glimpse adds its own.
/// Corners are products of two sides.
#[derive(Clone, Debug)]
pub(super) struct PlateOutline {
    half_side_m: f64,
    shown: Vec<Glimpse>,
    next: Vec<Glimpse>,
    squares: Vec<Square>,
}

/// One glimpse of the outline: its centre and the outward normal of its right-hand side.
#[derive(Clone, Copy, Debug)]
struct Square {
    center_m: Vec2,
    right: Vec2,
    spread: Matrix3<f64>,
    weight: f64,
}

impl Square {
    fn new(&Glimpse { pose, spread, weight }: &Glimpse) -> Self {
        let right = Rotation2::new(pose.heading_rad) * Vec2::x();
        Self { center_m: pose.position_m, right, spread, weight }
    }
}

impl PlateOutline {
    /// A plate at rest.
    pub(super) fn new(side_m: f64) -> Self {
        let rest = Glimpse { pose: Pose::IDENTITY, spread: Matrix3::zeros(), weight: 1.0 };
        Self { half_side_m: side_m / 2.0, shown: vec![rest], next: Vec::new(), squares: vec![Square::new(&rest)] }
    }

    /// True when the point, given with the plate's pose, is on the plate.
    pub(super) fn carries(&self, plate_in_table: &Pose, p_m: Vec2) -> bool {
        let p = plate_in_table.apply_inverse(p_m);
        p.x.abs() <= self.half_side_m && p.y.abs() <= self.half_side_m
    }

    /// Takes the plate's poses of a new exposure (none: as before) and calls `stale` with every tile
    /// whose picture may change.
    pub(super) fn show(
        &mut self,
        poses: impl ExactSizeIterator<Item = Pose> + Clone,
        grain: &Grain,
        tiles: &[Tile],
        mut stale: impl FnMut(usize),
    ) {
        grain.glimpses(poses, &mut self.next);
        if self.next.is_empty() || self.next == self.shown {
            return;
        }
        let glimpses = || self.shown.iter().chain(&self.next);
        let shift_m = glimpses().map(|g| g.pose.position_m.norm()).fold(0.0, f64::max);
        let turn_rad = glimpses().map(|g| g.pose.heading_rad.abs()).fold(0.0, f64::max);
        for (index, tile) in tiles.iter().enumerate() {
            let p = tile.center_m;
            let to_edge_m = self.half_side_m - p.x.abs().max(p.y.abs());
            let moved_m = shift_m + turn_rad * p.norm();
            // The motion within a glimpse is less than the blur itself.
            if to_edge_m.abs() <= moved_m + tile.radius_m + 2.0 * REACH * grain.blur_m {
                stale(index);
            }
        }
        std::mem::swap(&mut self.shown, &mut self.next);
        self.squares.clear();
        self.squares.extend(self.shown.iter().map(Square::new));
    }

    /// Adds the plate's coverage of every pixel, averaged over the exposure.
    pub(super) fn cover(&self, tile: &Tile, blur: &Blur, shares: &mut Shares) {
        let blur_m2 = blur.covariance_m2(tile);
        // Added up in f64, so that a tile inside for the whole exposure is covered by 1 exactly.
        let mut whole = 0.0;
        for square in &self.squares {
            match self.near_sides(square, tile, &blur_m2) {
                Near::Outside => {}
                Near::Sides(sides) if sides.iter().all(Option::is_none) => whole += square.weight,
                Near::Sides(sides) => cover_between(&sides, square.weight as f32, tile, blur, shares),
            }
        }
        if whole > 0.0 {
            shares.add_everywhere(whole as f32);
        }
    }

    fn near_sides(&self, square: &Square, tile: &Tile, blur_m2: &Matrix2<f64>) -> Near {
        let from_center = tile.center_m - square.center_m;
        let mut sides = [None; 4];
        for (pair, normal) in sides.chunks_exact_mut(2).zip([square.right, perp(square.right)]) {
            let motion = Vector3::new(normal.x, normal.y, normal.dot(&perp(from_center)));
            let variance = normal.dot(&(blur_m2 * normal)) + motion.dot(&(square.spread * motion));
            let sd_m = variance.sqrt();
            let clear_m = tile.radius_m + REACH * sd_m;
            for (side, outwards) in pair.iter_mut().zip([normal, -normal]) {
                let inside_m = self.half_side_m - outwards.dot(&from_center);
                if inside_m < -clear_m {
                    return Near::Outside;
                }
                if inside_m < clear_m {
                    let slope = -outwards / sd_m;
                    let z0 = (self.half_side_m + outwards.dot(&square.center_m)) / sd_m;
                    *side = Some(Side { zx: slope.x as f32, zy: slope.y as f32, z0: z0 as f32 });
                }
            }
        }
        Near::Sides(sides)
    }
}

/// The sides that cross a tile, or none because the tile is beyond one.
enum Near {
    Outside,
    Sides([Option<Side>; 4]),
}

/// A side: `z = zx·x + zy·y + z0` standard deviations of the blur inside it.
#[derive(Clone, Copy, Debug)]
struct Side {
    zx: f32,
    zy: f32,
    z0: f32,
}

impl Side {
    #[inline(always)]
    fn depth(&self, x_m: f32, y_m: f32) -> f32 {
        self.zx * x_m + self.zy * y_m + self.z0
    }
}

fn cover_between(sides: &[Option<Side>; 4], weight: f32, tile: &Tile, blur: &Blur, shares: &mut Shares) {
    for (block, (x_m, y_m)) in tile.block_x_m.iter().zip(&tile.block_y_m).enumerate() {
        let depths = || sides.iter().flatten().map(|side| (side, side.depth(*x_m, *y_m)));
        if depths().any(|(_, depth)| depth < -blur.block_reach) {
            continue;
        }
        let mut reached = depths().filter(|(_, depth)| *depth < blur.block_reach).map(|(side, _)| side).peekable();
        if reached.peek().is_none() {
            shares.add(block, weight);
            continue;
        }
        let mut product = [weight; LANES];
        for side in reached {
            for ((p, x), y) in product.iter_mut().zip(&tile.x_m[block]).zip(&tile.y_m[block]) {
                *p *= edge_spread(side.depth(*x, *y));
            }
        }
        shares.uneven(block).iter_mut().zip(product).for_each(|(c, p)| *c += p);
    }
}
