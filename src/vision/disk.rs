use crate::signal::Frame;

/// The solid disk kernel: all cells whose middle lies within the radius of the disk's middle cell.
#[derive(Clone, Debug)]
pub(super) struct Disk {
    /// Half chord of row `dy`, at index `|dy|`; the chord runs over `2 half + 1` cells. By symmetry that of columns too.
    half: Vec<usize>,
    area: usize,
}

impl Disk {
    /// A disk of `radius_px` cells; a single cell at least, 30 000 cells at most.
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

    /// Number of cells.
    pub(super) fn area(&self) -> usize {
        self.area
    }

    /// Half chord `dy` rows off the middle, `None` beyond the disk.
    pub(super) fn half_chord(&self, dy: i64) -> Option<usize> {
        self.half.get(dy.unsigned_abs() as usize).copied()
    }

    /// The place nearest to `(x, y)` where the disk and one pixel around it fit the frame; `None` when nowhere.
    pub(super) fn fitted(&self, frame: &Frame, x: i64, y: i64) -> Option<(usize, usize)> {
        let margin = self.reach() as i64 + 1;
        let (right, bottom) = (frame.width as i64 - 1 - margin, frame.height as i64 - 1 - margin);
        (right >= margin && bottom >= margin)
            .then(|| (x.clamp(margin, right) as usize, y.clamp(margin, bottom) as usize))
    }

    /// Sum of gray levels under the disk at a place it fits.
    pub(super) fn sum(&self, frame: &Frame, x: usize, y: usize) -> i64 {
        let chord = |row: usize, half: usize| -> u32 {
            frame.row(row)[x - half..=x + half].iter().map(|&level| u32::from(level)).sum()
        };
        let pairs = self.half.iter().enumerate().skip(1);
        let rest: i64 = pairs.map(|(dy, &half)| i64::from(chord(y - dy, half)) + i64::from(chord(y + dy, half))).sum();
        i64::from(chord(y, self.half[0])) + rest
    }

    /// How the sum changes when the disk moves by one column: the pixels that enter less those that leave.
    pub(super) fn step_columns(&self, frame: &Frame, x: usize, y: usize, right: bool) -> i64 {
        let mut change = 0i32;
        let mut add = |row: usize, half: usize| {
            let row = frame.row(row);
            let (ahead, behind) = if right { (x + half + 1, x - half) } else { (x - half - 1, x + half) };
            change += i32::from(row[ahead]) - i32::from(row[behind]);
        };
        for (dy, &half) in self.half.iter().enumerate() {
            add(y + dy, half);
            if dy > 0 {
                add(y - dy, half);
            }
        }
        i64::from(change)
    }

    /// How the sum changes when the disk moves by one row.
    pub(super) fn step_rows(&self, frame: &Frame, x: usize, y: usize, down: bool) -> i64 {
        let mut change = 0i32;
        let mut add = |column: usize, half: usize| {
            let (ahead, behind) = if down { (y + half + 1, y - half) } else { (y - half - 1, y + half) };
            change += i32::from(frame.pixels[ahead * frame.width + column]);
            change -= i32::from(frame.pixels[behind * frame.width + column]);
        };
        for (dx, &half) in self.half.iter().enumerate() {
            add(x + dx, half);
            if dx > 0 {
                add(x - dx, half);
            }
        }
        i64::from(change)
    }
}

#[cfg(test)]
impl Disk {
    /// Mean of a picture's values under the disk at cell `(x, y)`, cells outside counting 0. The plain sum,
    /// the reference of every faster path.
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

/// A disk resting on a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rest {
    pub(super) x: usize,
    pub(super) y: usize,
    /// Sum of gray levels under it.
    pub(super) sum: i64,
}

/// Climbs from `(x, y)`, pixel by pixel over the four neighbours, to where the disk covers most dark
/// (or most light, when `dark` is false); gives up climbing after `most_steps`. `None` when the disk fits nowhere.
pub(super) fn climb(disk: &Disk, frame: &Frame, x: i64, y: i64, dark: bool, most_steps: usize) -> Option<Rest> {
    let (mut x, mut y) = disk.fitted(frame, x, y)?;
    let mut sum = disk.sum(frame, x, y);
    for _ in 0..most_steps {
        let mut best = (0, x, y);
        for (dx, dy) in [(1i64, 0i64), (-1, 0), (0, 1), (0, -1)] {
            let to = disk.fitted(frame, x as i64 + dx, y as i64 + dy)?;
            let change = match (dx, dy) {
                _ if to == (x, y) => 0,
                (0, _) => disk.step_rows(frame, x, y, dy > 0),
                _ => disk.step_columns(frame, x, y, dx > 0),
            };
            let gain = if dark { -change } else { change };
            if gain > best.0 {
                best = (gain, to.0, to.1);
            }
        }
        if best.0 == 0 {
            break;
        }
        (x, y, sum) = (best.1, best.2, if dark { sum - best.0 } else { sum + best.0 });
    }
    Some(Rest { x, y, sum })
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
            let (disk, frame) = (Disk::new(radius), frame(41, 33, seed));
            let values: Vec<f32> = frame.pixels.iter().map(|&p| f32::from(p)).collect();
            let plain = |x, y| (f64::from(disk.mean_under(&values, 41, 33, x, y)) * disk.area() as f64).round() as i64;
            let here = disk.sum(&frame, x, y);
            prop_assert_eq!(here, plain(x, y));
            prop_assert_eq!(here + disk.step_columns(&frame, x, y, true), plain(x + 1, y));
            prop_assert_eq!(here + disk.step_columns(&frame, x, y, false), plain(x - 1, y));
            prop_assert_eq!(here + disk.step_rows(&frame, x, y, true), plain(x, y + 1));
            prop_assert_eq!(here + disk.step_rows(&frame, x, y, false), plain(x, y - 1));
        }

        #[test]
        fn climbing_ends_where_no_neighbour_is_darker(radius in 1.0..6.0f64, x in -5i64..50, y in -5i64..40, seed in 0usize..99) {
            let (disk, frame) = (Disk::new(radius), frame(41, 33, seed));
            let rest = climb(&disk, &frame, x, y, true, 1000).unwrap();
            prop_assert_eq!(rest.sum, disk.sum(&frame, rest.x, rest.y));
            for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                let (nx, ny) = (rest.x as i64 + dx, rest.y as i64 + dy);
                if disk.fitted(&frame, nx, ny) == Some((nx as usize, ny as usize)) {
                    prop_assert!(disk.sum(&frame, nx as usize, ny as usize) >= rest.sum);
                }
            }
        }
    }

    #[test]
    fn area_is_that_of_a_disk() {
        assert_eq!(Disk::new(0.0).area(), 1);
        assert_eq!(Disk::new(1.0).area(), 5);
        let area = Disk::new(40.0).area() as f64;
        assert!((area / (std::f64::consts::PI * 1600.0) - 1.0).abs() < 2e-3);
        assert!(climb(&Disk::new(30.0), &Frame::new(50, 50), 0, 0, true, 9).is_none());
    }
}
