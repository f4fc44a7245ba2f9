use upm_core::geometry::Vec2;
use upm_core::signal::Frame;
use upm_perception::vision::Table;
use upm_recording::outline_px;

/// Longer side of a movie, px. The nearest whole number of frame pixels in a movie pixel gives the actual one.
const SIDE_PX: f64 = 400.0;

/// Margin round the plate, as a share of its longer side in the picture.
const MARGIN: f64 = 0.03;

/// The section of the frames that a movie shows, reduced in size.
pub(super) struct View {
    left: usize,
    top: usize,
    /// Columns and rows of a frame in a pixel of the movie.
    pub bin: usize,
    pub width: usize,
    pub height: usize,
}

impl View {
    /// A view of the plate in `frame`.
    pub(super) fn of(table: &Table, frame: &Frame) -> Self {
        let low = outline_px(table).fold(Vec2::repeat(f64::INFINITY), |low, p_px| low.inf(&p_px));
        let high = outline_px(table).fold(Vec2::zeros(), |high, p_px| high.sup(&p_px));
        let margin_px = Vec2::repeat(MARGIN * (high - low).max());
        let (low, high) = (low - margin_px, high + margin_px);
        let bin = ((high - low).max() / SIDE_PX).round().max(1.0) as usize;
        let [left, top] = [low.x as usize, low.y as usize];
        let count = |from: usize, to: f64, size: usize| (to as usize).min(size).saturating_sub(from) / bin;
        let (width, height) = (count(left, high.x, frame.width), count(top, high.y, frame.height));
        Self { left, top, bin, width, height }
    }

    /// A point of the frames in the movie, where pixel (0, 0) covers the square from 0 to 1.
    pub(super) fn place(&self, p_px: Vec2) -> Vec2 {
        (p_px - Vec2::new(self.left as f64 - 0.5, self.top as f64 - 0.5)) / self.bin as f64
    }

    /// Gray levels of the movie's pixels, each the mean of a square of the frame.
    pub(super) fn reduced(&self, frame: &Frame) -> Vec<f64> {
        let bin = self.bin;
        let mean = |at: usize| {
            let (x, y) = (self.left + at % self.width * bin, self.top + at / self.width * bin);
            let levels = (y..y + bin).flat_map(|row| &frame.row(row)[x..x + bin]);
            levels.map(|&level| f64::from(level)).sum::<f64>() / (bin * bin) as f64
        };
        (0..self.width * self.height).map(mean).collect()
    }
}
