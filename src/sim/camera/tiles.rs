use nalgebra::Matrix2;

use super::view::View;
use crate::geometry::Vec2;

/// Rows and columns of a tile, px.
pub(super) const SIDE: usize = 16;
/// Pixels of a tile.
pub(super) const AREA: usize = SIDE * SIDE;
/// Rows and columns of a block, px; a tile is 4 × 4 blocks.
pub(super) const BLOCK_SIDE: usize = 4;
/// Blocks of a tile, and pixels of a block.
pub(super) const LANES: usize = BLOCK_SIDE * BLOCK_SIDE;

/// One number for every pixel of a block, or for every block of a tile, row by row: what vector code works on.
pub(super) type Lanes = [f32; LANES];
/// One number for every pixel of a tile, block by block.
pub(super) type Patch = [Lanes; LANES];

/// Column of every lane.
pub(super) const LANE_X: Lanes = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
/// Row of every lane.
pub(super) const LANE_Y: Lanes = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];

/// Where a pixel looks that sees no table: far beyond every edge.
const NOWHERE_M: f64 = 1e3;

/// What a square of pixels sees of the plate's plane.
#[derive(Clone, Debug)]
pub(super) struct Tile {
    /// Table coordinates of the pixels' centres, m.
    pub(super) x_m: Patch,
    /// As `x_m`.
    pub(super) y_m: Patch,
    /// Table coordinates of the blocks' centres, m.
    pub(super) block_x_m: Lanes,
    /// As `block_x_m`.
    pub(super) block_y_m: Lanes,
    /// Table coordinates of the tile's centre, m.
    pub(super) center_m: Vec2,
    /// Distance of the farthest pixel from the centre, m.
    pub(super) radius_m: f64,
    /// Covariance on the table of a point that has unit variance in the image, m²/px²: J Jᵀ with
    /// J the Jacobian of table by image coordinates.
    pub(super) px_covariance_m2: Matrix2<f64>,
}

impl Tile {
    fn new(view: &View, first_px: Vec2) -> Self {
        let looks_at = |px| view.table_from_image(px).unwrap_or(Vec2::repeat(NOWHERE_M));
        let middle_px = first_px + Vec2::repeat((SIDE as f64 - 1.0) / 2.0);
        let center_m = looks_at(middle_px);
        let slope = |step: Vec2| looks_at(middle_px + step) - looks_at(middle_px - step);
        let jacobian = Matrix2::from_columns(&[slope(Vec2::new(0.5, 0.0)), slope(Vec2::new(0.0, 0.5))]);
        let mut tile = Self {
            x_m: [[0.0; LANES]; LANES],
            y_m: [[0.0; LANES]; LANES],
            block_x_m: [0.0; LANES],
            block_y_m: [0.0; LANES],
            center_m,
            radius_m: 0.0,
            px_covariance_m2: jacobian * jacobian.transpose(),
        };
        let mut ideal = [Vec2::zeros(); SIDE];
        for row in 0..SIDE {
            view.ideal_from_row(first_px + Vec2::new(0.0, row as f64), &mut ideal);
            for (column, ideal) in ideal.iter().enumerate() {
                let p_m = view.table_from_ideal(*ideal).unwrap_or(Vec2::repeat(NOWHERE_M));
                let block = row / BLOCK_SIDE * BLOCK_SIDE + column / BLOCK_SIDE;
                let lane = row % BLOCK_SIDE * BLOCK_SIDE + column % BLOCK_SIDE;
                tile.radius_m = tile.radius_m.max((p_m - center_m).norm());
                (tile.x_m[block][lane], tile.y_m[block][lane]) = (p_m.x as f32, p_m.y as f32);
            }
        }
        let mean = |block: &Lanes| block.iter().sum::<f32>() / LANES as f32;
        (tile.block_x_m, tile.block_y_m) = (tile.x_m.each_ref().map(mean), tile.y_m.each_ref().map(mean));
        tile
    }
}

/// The whole image cut into tiles, which may stand over its right and lower sides.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Row by row.
    pub(super) tiles: Vec<Tile>,
}

impl Grid {
    pub(super) fn new(view: &View, [width, height]: [usize; 2]) -> Self {
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
        let end = |px: f64, count: usize| if px < 0.0 { 0 } else { ((px / SIDE as f64) as usize + 1).min(count) };
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
