use upm_core::geometry::Vec2;
use upm_core::signal::Frame;

/// Chords of a large disk on either side of its middle that are sampled when it is moved.
const CHORDS: usize = 12;

/// The solid disk kernel: all cells whose middle is within the radius of the disk's middle cell (UPM paper, section
/// 3.4; equation sheet, section 7).
#[derive(Clone, Debug)]
pub(super) struct DiskKernel {
    /// Half chord of row `dy`, at index `|dy|`; the chord runs over `2 half + 1` cells. By symmetry also that of
    /// columns.
    pub(super) half: Vec<usize>,
    /// Number of cells.
    pub(super) area: usize,
}

impl DiskKernel {
    /// A disk of `radius_px` cells; at least a single cell, at most 30 000 cells.
    pub(super) fn new(radius_px: f64) -> Self {
        let radius = radius_px.clamp(0.0, 30_000.0);
        let half: Vec<usize> =
            (0..=radius as usize).map(|dy| (radius * radius - (dy * dy) as f64).sqrt() as usize).collect();
        let area = half.iter().enumerate().map(|(dy, h)| (2 * h + 1) * if dy == 0 { 1 } else { 2 }).sum();
        Self { half, area }
    }

    /// Cells from the middle to the last row.
    pub(super) fn reach(&self) -> usize {
        self.half.len() - 1
    }

    /// The place nearest to `(x, y)` where the disk and one pixel around it fit the frame; `None` where there is no
    /// such place.
    pub(super) fn fitted(&self, frame: &Frame, x: i64, y: i64) -> Option<(usize, usize)> {
        let margin = self.reach() as i64 + 1;
        let (right, bottom) = (frame.width as i64 - 1 - margin, frame.height as i64 - 1 - margin);
        (right >= margin && bottom >= margin)
            .then(|| (x.clamp(margin, right) as usize, y.clamp(margin, bottom) as usize))
    }

    /// Mean gray level at a place where the disk fits; of large disks, over every few rows.
    pub(super) fn mean(&self, frame: &Frame, x: usize, y: usize) -> f64 {
        let (mut sum, mut cells) = (0, 0);
        self.each_chord(y, 2 * self.stride() - 1, |row, half| {
            let chord = &frame.row(row)[x - half..=x + half];
            sum += chord.iter().map(|&level| u32::from(level)).sum::<u32>();
            cells += chord.len();
        });
        f64::from(sum) / cells as f64
    }

    /// Rows between sampled chords: for a large disk a few chords determine its mean and its differences well enough.
    fn stride(&self) -> usize {
        (self.reach() / CHORDS).max(1)
    }

    /// Calls `each` with the row and the half length of every `stride`-th chord of a disk in the middle of row `at`; by
    /// symmetry also with columns.
    #[inline]
    fn each_chord(&self, at: usize, stride: usize, mut each: impl FnMut(usize, usize)) {
        each(at, self.half[0]);
        for (off, &half) in self.half.iter().enumerate().step_by(stride).skip(1) {
            each(at - off, half);
            each(at + off, half);
        }
    }

    /// Change of the sum over the sampled chords when the disk moves by a column, left and right: the pixels that enter
    /// less those that leave.
    fn step_columns(&self, frame: &Frame, x: usize, y: usize) -> [i32; 2] {
        let (mut left, mut right) = (0, 0);
        self.each_chord(y, self.stride(), |row, half| {
            let chord = &frame.row(row)[x - half - 1..=x + half + 1];
            let (first, last) = (i32::from(chord[1]), i32::from(chord[chord.len() - 2]));
            left += i32::from(chord[0]) - last;
            right += i32::from(chord[chord.len() - 1]) - first;
        });
        [left, right]
    }

    /// Change of the sum over sampled columns when the disk moves by a row, up and down.
    fn step_rows(&self, frame: &Frame, x: usize, y: usize) -> [i32; 2] {
        let (mut up, mut down) = (0, 0);
        self.each_chord(x, self.stride(), |column, half| {
            let at = |row: usize| i32::from(frame.pixels[row * frame.width + column]);
            up += at(y - half - 1) - at(y + half);
            down += at(y + half + 1) - at(y - half);
        });
        [up, down]
    }
}

#[cfg(test)]
impl DiskKernel {
    /// Sum of gray levels under the disk at a place where it fits.
    pub(super) fn sum(&self, frame: &Frame, x: usize, y: usize) -> i64 {
        let chord = |row: usize, half: usize| -> u32 {
            frame.row(row)[x - half..=x + half].iter().map(|&level| u32::from(level)).sum()
        };
        let pairs = self.half.iter().enumerate().skip(1);
        let rest: i64 = pairs.map(|(dy, &half)| i64::from(chord(y - dy, half)) + i64::from(chord(y + dy, half))).sum();
        i64::from(chord(y, self.half[0])) + rest
    }

    /// Mean of a picture's values under the disk at cell `(x, y)`, cells outside counting 0. The plain sum, the
    /// reference of all faster methods.
    #[cfg(test)]
    pub(super) fn mean_under(&self, values: &[f32], width: usize, height: usize, x: usize, y: usize) -> f32 {
        let reach = self.reach();
        let mut sum = 0.0f64;
        for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            let half = self.half[row.abs_diff(y)];
            let span = x.saturating_sub(half)..(x + half + 1).min(width);
            sum += values[row * width..][..width][span].iter().map(|&v| f64::from(v)).sum::<f64>();
        }
        (sum / self.area as f64) as f32
    }
}

/// Climbs from the place nearest `(x, y)` to neighbouring ones as long as the disk there is darker (lighter when not
/// `dark`), `most_steps` at most; the vertex of the parabolas through the last place and its neighbours, px. `None`
/// where the disk does not fit the frame.
pub(super) fn hill_climb(
    disk: &DiskKernel,
    frame: &Frame,
    x: i64,
    y: i64,
    dark: bool,
    most_steps: usize,
) -> Option<Vec2> {
    let sign = if dark { -1 } else { 1 };
    let (mut x, mut y) = disk.fitted(frame, x, y)?;
    for steps in 0.. {
        let allowed = |change: i32, dx: i64, dy: i64| {
            let to = (x as i64 + dx, y as i64 + dy);
            let fits = disk.fitted(frame, to.0, to.1).is_some_and(|at| (at.0 as i64, at.1 as i64) == to);
            if fits { sign * change } else { (sign * change).min(0) }
        };
        let [left, right] = disk.step_columns(frame, x, y);
        let [up, down] = disk.step_rows(frame, x, y);
        let columns = [allowed(left, -1, 0), allowed(right, 1, 0)];
        let rows = [allowed(up, 0, -1), allowed(down, 0, 1)];
        let both = disk.fitted(frame, x as i64 + uphill(columns), y as i64 + uphill(rows))?;
        let (along_x, along_y) = ((both.0, y), (x, both.1));
        // Steps along both axes at once may cycle: their number is limited.
        let next = match () {
            () if steps < disk.reach() => both,
            () if along_x != (x, y) && columns.iter().max() >= rows.iter().max() => along_x,
            () if along_y != (x, y) => along_y,
            () => along_x,
        };
        if next == (x, y) || steps >= most_steps {
            return Some(Vec2::new(x as f64 + vertex(columns), y as f64 + vertex(rows)));
        }
        (x, y) = next;
    }
    None
}

/// The better one of two directions: -1, 1, or 0 when neither gains.
fn uphill([back, ahead]: [i32; 2]) -> i64 {
    if back.max(ahead) <= 0 {
        0
    } else if ahead >= back {
        1
    } else {
        -1
    }
}

/// Vertex of the parabola through 0 and the gains of a step back and ahead, within half a step.
fn vertex([back, ahead]: [i32; 2]) -> f64 {
    let bend = f64::from(-back - ahead);
    if bend > 0.0 { (0.5 * f64::from(ahead - back) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(width: usize, height: usize, seed: usize) -> Frame {
        let mut frame = Frame::new(width, height);
        for (i, pixel) in frame.pixels.iter_mut().enumerate() {
            *pixel = ((i + seed).wrapping_mul(2_654_435_761) >> 11) as u8;
        }
        frame
    }

    proptest! {
        #[test]
        fn steps_and_sums_agree_with_the_plain_sum(radius in 0.5..9.0f64, x in 12usize..28, y in 12usize..20, seed in 0usize..999) {
            let (disk, frame) = (DiskKernel::new(radius), frame(41, 33, seed));
            let values: Vec<f32> = frame.pixels.iter().map(|&p| f32::from(p)).collect();
            let plain = |x, y| (f64::from(disk.mean_under(&values, 41, 33, x, y)) * disk.area as f64).round() as i64;
            let here = disk.sum(&frame, x, y);
            prop_assert_eq!(here, plain(x, y));
            prop_assert!((disk.mean(&frame, x, y) * disk.area as f64 - here as f64).abs() < 1e-6);
            let [left, right] = disk.step_columns(&frame, x, y).map(i64::from);
            let [up, down] = disk.step_rows(&frame, x, y).map(i64::from);
            prop_assert_eq!([here + left, here + right], [plain(x - 1, y), plain(x + 1, y)]);
            prop_assert_eq!([here + up, here + down], [plain(x, y - 1), plain(x, y + 1)]);
        }
    }
}
