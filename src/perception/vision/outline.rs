use super::Table;
use upm_core::geometry::Vec2;

/// Points along each side of the outline: enough to follow sides bent by the lens.
const POINTS_A_SIDE: usize = 24;

/// The plate in a picture of cells: a rectangle and, in each of its rows, the columns on the plate.
pub(super) struct PlateCells {
    /// Pixels along a cell's side.
    pub(super) bin: usize,
    /// First column and row of the rectangle, cells of the frame.
    pub(super) corner: [usize; 2],
    /// Its columns and rows.
    pub(super) size: [usize; 2],
    /// In each row the first column of the rectangle that is on the plate, and the one past the last.
    pub(super) spans: Vec<(usize, usize)>,
}

impl PlateCells {
    /// Cells of `bin` by `bin` px within the plate, `margin_px` off its edge, in frames of `frame_size`.
    pub(super) fn new(table: &Table, frame_size: [usize; 2], bin: usize, margin_px: f64) -> Self {
        let outline = outline(table, margin_px);
        let cells = frame_size.map(|n| n / bin);
        let (first, last) = bounds(&outline);
        let span = |from: f64, to: f64, n: usize| {
            let from = ((from / bin as f64).max(0.0) as usize).min(n);
            let to = ((to / bin as f64 + 1.0).max(0.0) as usize).clamp(from, n);
            (from, to - from)
        };
        let (x, width) = span(first.x, last.x, cells[0]);
        let (y, height) = span(first.y, last.y, cells[1]);
        let size = if width == 0 || height == 0 { [0, 0] } else { [width, height] };
        let mut plate = Self { bin, corner: [x, y], size, spans: vec![(usize::MAX, 0); size[1]] };
        for (i, &a) in outline.iter().enumerate() {
            plate.cross(a, outline[(i + 1) % outline.len()]);
        }
        for span in &mut plate.spans {
            *span = (span.0.min(span.1), span.1);
        }
        plate
    }

    /// Widens the spans of the rows whose middle the outline crosses between `a` and `b`.
    fn cross(&mut self, a: Vec2, b: Vec2) {
        let cell = |p: Vec2| (p - Vec2::repeat((self.bin as f64 - 1.0) / 2.0)) / self.bin as f64;
        let corner = Vec2::new(self.corner[0] as f64, self.corner[1] as f64);
        let (a, b) = (cell(a) - corner, cell(b) - corner);
        let (top, bottom) = (a.y.min(b.y), a.y.max(b.y));
        let rows = (top.ceil().max(0.0) as usize)..((bottom.floor() + 1.0).max(0.0) as usize).min(self.size[1]);
        for row in rows {
            let x = if b.y == a.y { a.x } else { a.x + (row as f64 - a.y) / (b.y - a.y) * (b.x - a.x) };
            let (from, to) = (x.ceil().max(0.0) as usize, ((x.floor() + 1.0).max(0.0) as usize).min(self.size[0]));
            let span = &mut self.spans[row];
            *span = (span.0.min(from), span.1.max(to));
        }
    }
}

/// The plate's outline, `margin_px` within its edge, px.
fn outline(table: &Table, margin_px: f64) -> Vec<Vec2> {
    let half = table.side_m / 2.0 * (1.0 - 2.0 * margin_px / table.side_px.max(4.0 * margin_px));
    let corners =
        [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(|(x, y)| Vec2::new(x, y * table.aspect) * half);
    let along =
        |i: usize, k: usize| corners[i] + (corners[(i + 1) % 4] - corners[i]) * (k as f64 / POINTS_A_SIDE as f64);
    (0..4 * POINTS_A_SIDE).map(|k| table.image_from_table(along(k / POINTS_A_SIDE, k % POINTS_A_SIDE))).collect()
}

fn bounds(outline: &[Vec2]) -> (Vec2, Vec2) {
    let first = outline.iter().fold(Vec2::repeat(f64::INFINITY), |a, b| a.inf(b));
    let last = outline.iter().fold(Vec2::repeat(f64::NEG_INFINITY), |a, b| a.sup(b));
    (first, last)
}
