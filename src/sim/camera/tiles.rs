use std::sync::OnceLock;

use nalgebra::Matrix2;

use super::view::CameraProjection;
use upm_core::geometry::Vec2;

/// Rows and columns of a tile, px.
pub(super) const SIDE: usize = 16;
/// Pixels of a tile.
pub(super) const AREA: usize = SIDE * SIDE;
/// Rows and columns of a block, px; a tile is 4 × 4 blocks.
pub(super) const BLOCK_SIDE: usize = 4;
/// Blocks of a tile, and pixels of a block.
pub(super) const LANES: usize = BLOCK_SIDE * BLOCK_SIDE;

/// One number for every pixel of a block, or for every block of a tile, row by row: the unit of vector code.
pub(super) type F32Lanes = [f32; LANES];
/// One number for every pixel of a tile, block by block.
pub(super) type Patch = [F32Lanes; LANES];

/// Column of every lane.
pub(super) const LANE_X: F32Lanes = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
/// Row of every lane.
pub(super) const LANE_Y: F32Lanes = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];

/// Table coordinates of a pixel above the horizon, m: far beyond every edge.
const NOWHERE_M: f64 = 1e3;

/// A square of pixels and the area of the plate's plane that it images.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    first_px: Vec2,
    /// Table coordinates of the tile's centre, m.
    pub(super) center_m: Vec2,
    /// Upper bound of the distance of its pixels from the centre, m; infinite where none is known.
    pub(super) radius_bound_m: f64,
    /// Covariance on the table of a point that has unit variance in the image, m²/px²: J Jᵀ with
    /// J the Jacobian of table by image coordinates.
    pub(super) px_covariance_m2: Matrix2<f64>,
    /// Computed when an edge first comes near, which for most tiles never happens.
    pixels: OnceLock<Box<Pixels>>,
}

impl Tile {
    fn new(view: &CameraProjection, first_px: Vec2) -> Self {
        let middle_px = first_px + Vec2::repeat((SIDE as f64 - 1.0) / 2.0);
        let center_m = looks_at(view, middle_px);
        let around_m = [Vec2::new(0.5, 0.0), Vec2::new(0.0, 0.5)]
            .map(|step| [looks_at(view, middle_px - step), looks_at(view, middle_px + step)]);
        let jacobian = Matrix2::from_columns(&around_m.map(|[before, behind]| behind - before));
        Self {
            first_px,
            center_m,
            radius_bound_m: radius_bound_m(center_m, &around_m),
            px_covariance_m2: jacobian * jacobian.transpose(),
            pixels: OnceLock::new(),
        }
    }

    /// Table coordinates of its pixels; `view` must be the same every time.
    pub(super) fn pixels(&self, view: &CameraProjection) -> &Pixels {
        self.pixels.get_or_init(|| Box::new(Pixels::new(view, self.first_px, self.center_m)))
    }

    /// Discards the bound, so that every decision uses the pixels themselves.
    #[cfg(test)]
    pub(super) fn unbind(&mut self) {
        self.radius_bound_m = f64::INFINITY;
    }

    /// True once its pixels were computed.
    #[cfg(test)]
    pub(super) fn is_known(&self) -> bool {
        self.pixels.get().is_some()
    }

    /// The distance of the farthest pixel from the centre, m, or an upper bound of it that is also below `enough_m`.
    pub(super) fn radius_m(&self, view: &CameraProjection, enough_m: f64) -> f64 {
        if self.radius_bound_m < enough_m { self.radius_bound_m } else { self.pixels(view).radius_m }
    }
}

fn looks_at(view: &CameraProjection, px: Vec2) -> Vec2 {
    view.table_from_image(px).unwrap_or(Vec2::repeat(NOWHERE_M))
}

/// Upper bound of the distance of a tile's pixels from its centre, from the table points half a pixel before and behind
/// it along both axes. The map to the table is nearly linear in a tile; where it is curved, near the horizon, there is
/// no bound.
fn radius_bound_m(center_m: Vec2, around_m: &[[Vec2; 2]; 2]) -> f64 {
    /// Largest relative change of slope per pixel: a tenth over half a tile.
    const MOST_BENT: f64 = 0.1 / (SIDE as f64 / 2.0);
    /// A tenth for the curvature, and a tenth as a margin.
    const MARGIN: f64 = 1.2;
    let slopes = around_m.map(|[before, behind]| behind - before);
    let bent = |[before, behind]: &[Vec2; 2]| 4.0 * (before + behind - 2.0 * center_m).norm();
    let least_slope = slopes[0].norm().min(slopes[1].norm());
    if !around_m.iter().all(|pair| bent(pair) < MOST_BENT * least_slope) {
        return f64::INFINITY;
    }
    let to_corner_px = (SIDE as f64 - 1.0) / 2.0;
    MARGIN * to_corner_px * (slopes[0] + slopes[1]).norm().max((slopes[0] - slopes[1]).norm())
}

/// Points of the plate's plane that the pixels of a tile see.
#[derive(Clone, Debug)]
pub(super) struct Pixels {
    /// Table coordinates of the pixels' centres, m.
    pub(super) x_m: Patch,
    /// As `x_m`.
    pub(super) y_m: Patch,
    /// Table coordinates of the blocks' centres, m.
    pub(super) block_x_m: F32Lanes,
    /// As `block_x_m`.
    pub(super) block_y_m: F32Lanes,
    /// Distance of the farthest pixel from the tile's centre, m.
    pub(super) radius_m: f64,
}

impl Pixels {
    fn new(view: &CameraProjection, first_px: Vec2, center_m: Vec2) -> Self {
        let (mut x_m, mut y_m, mut radius_m) = ([[0.0; LANES]; LANES], [[0.0; LANES]; LANES], 0.0_f64);
        let mut ideal = [Vec2::zeros(); SIDE];
        for row in 0..SIDE {
            view.ideal_from_row(first_px + Vec2::new(0.0, row as f64), &mut ideal);
            for (column, ideal) in ideal.iter().enumerate() {
                let p_m = view.table_from_ideal(*ideal).unwrap_or(Vec2::repeat(NOWHERE_M));
                let block = row / BLOCK_SIDE * BLOCK_SIDE + column / BLOCK_SIDE;
                let lane = row % BLOCK_SIDE * BLOCK_SIDE + column % BLOCK_SIDE;
                radius_m = radius_m.max((p_m - center_m).norm());
                (x_m[block][lane], y_m[block][lane]) = (p_m.x as f32, p_m.y as f32);
            }
        }
        let mean = |block: &F32Lanes| block.iter().sum::<f32>() / LANES as f32;
        let (block_x_m, block_y_m) = (x_m.each_ref().map(mean), y_m.each_ref().map(mean));
        Self { x_m, y_m, block_x_m, block_y_m, radius_m }
    }
}

/// The whole image cut into tiles, which may extend beyond its right and lower sides.
#[derive(Clone, Debug)]
pub(super) struct TileGrid {
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Row by row.
    pub(super) tiles: Vec<Tile>,
}

impl TileGrid {
    pub(super) fn new(view: &CameraProjection, [width, height]: [usize; 2]) -> Self {
        let (columns, rows) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
        let tiles = (0..columns * rows)
            .map(|k| Tile::new(view, Vec2::new((k % columns * SIDE) as f64, (k / columns * SIDE) as f64)))
            .collect();
        Self { columns, rows, tiles }
    }

    /// Pixels from one row to the next in planes that hold every tile.
    pub(super) fn stride(&self) -> usize {
        self.columns * SIDE
    }

    /// The tiles that touch the box between two image points.
    pub(super) fn between(&self, low_px: Vec2, high_px: Vec2) -> TileBox {
        let first = |px: f64| (px / SIDE as f64) as usize;
        let end = |px: f64, count: usize| {
            if px < 0.0 { 0 } else { ((px / SIDE as f64) as usize).saturating_add(1).min(count) }
        };
        TileBox {
            columns: [first(low_px.x), end(high_px.x + 1.0, self.columns)],
            rows: [first(low_px.y), end(high_px.y + 1.0, self.rows)],
        }
    }
}

/// A box of tiles: first column and row, and the ones behind the last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct TileBox {
    columns: [usize; 2],
    rows: [usize; 2],
}

impl TileBox {
    pub(super) fn contains(&self, column: usize, row: usize) -> bool {
        (self.columns[0]..self.columns[1]).contains(&column) && (self.rows[0]..self.rows[1]).contains(&row)
    }

    /// Indices of its tiles in a grid of `columns`.
    pub(super) fn indices(self, columns: usize) -> impl Iterator<Item = usize> {
        (self.rows[0]..self.rows[1])
            .flat_map(move |row| (self.columns[0]..self.columns[1]).map(move |column| row * columns + column))
    }
}
