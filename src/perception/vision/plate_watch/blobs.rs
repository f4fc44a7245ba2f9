use std::f64::consts::PI;

use super::grid::CellGrid;
use upm_core::geometry::Vec2;

/// State of a place: bare plate.
pub(super) const BARE: u8 = 0;
/// Something other than bare plate.
pub(super) const DIFFERS: u8 = 1;
/// Covered by a part that the frame shows, or within its margin.
pub(super) const SEEN: u8 = 2;
/// The last place of a part that the frame does not show.
pub(super) const UNSEEN: u8 = 4;
/// No sample: around the plate, or beyond the frame.
pub(super) const BORDER: u8 = 8;
/// Already assigned to a blob, and to a blob larger than a part.
const TAKEN: u8 = 16;
const LARGE: u8 = 32;
/// Least size of a blob: share of the samples under the smallest part, and number of samples.
const LEAST_SHARE: f64 = 0.4;
const LEAST_SAMPLES: usize = 3;
/// Largest size of a part's blob, in samples under the largest part; two parts that touch are still below it.
const MOST_PARTS: f64 = 2.5;
/// Most blobs of a part's size examined in one frame; further ones are left out.
const MOST_SMALL: usize = 32;

/// A connected region of differing samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Blob {
    /// Of a part's size, in plain view.
    Foreign {
        /// Its middle: column and row.
        middle: Vec2,
    },
    /// Any other: too large, over the plate's border, beside either of those or beside a part that is not seen.
    Hiding { samples: usize },
}

/// Connects differing samples. All memory is allocated by [`Blobs::new`].
pub(super) struct Blobs {
    stride: usize,
    states: Vec<u8>,
    queue: Vec<Pixel>,
    small: Vec<Extent>,
    /// Samples under the largest part.
    one_part: usize,
    /// Fewest and most samples of a part.
    part: [usize; 2],
    /// Distance, samples, within which a small blob belongs to a large one: parts that are seen may be between them.
    reach: usize,
}

/// Column and row.
type Pixel = [u32; 2];

/// Extent of a blob.
#[derive(Clone, Copy, Default)]
struct Extent {
    samples: usize,
    sum: [u32; 2],
    touches_border: bool,
    touches_unseen: bool,
}

impl Blobs {
    /// For parts of radii between the two given, each ignored within `excused_m` of its middle.
    pub(super) fn new(grid: &CellGrid, radii_m: [f64; 2], excused_m: f64) -> Self {
        let [fewest, one_part] = radii_m.map(|radius_m| PI * radius_m * radius_m / (grid.spacing_m * grid.spacing_m));
        Self {
            stride: grid.stride,
            states: vec![BORDER; grid.len()],
            queue: Vec::with_capacity(grid.len()),
            small: Vec::with_capacity(MOST_SMALL),
            one_part: one_part.ceil() as usize,
            part: [((LEAST_SHARE * fewest) as usize).max(LEAST_SAMPLES), (MOST_PARTS * one_part).ceil() as usize],
            reach: ((2.0 * excused_m + radii_m[0]) / grid.spacing_m).ceil() as usize + 1,
        }
    }

    /// The state of every place: [`BARE`] to [`BORDER`]. To be written before [`Blobs::gather`].
    pub(super) fn states(&mut self) -> &mut [u8] {
        &mut self.states
    }

    /// Calls `each` with every blob of the differing samples.
    pub(super) fn gather(&mut self, mut each: impl FnMut(Blob)) {
        self.small.clear();
        for start in 0..self.states.len() {
            if self.states[start] != DIFFERS {
                continue;
            }
            let extent = self.flood(start);
            let samples = extent.samples;
            if samples > self.one_part && (samples > self.part[1] || extent.touches_border) {
                let Self { queue, states, stride, .. } = self;
                queue.iter().for_each(|[column, row]| states[*row as usize * *stride + *column as usize] = LARGE);
            }
            if samples < self.part[0] {
                continue;
            }
            if samples > self.part[1] || extent.touches_border || extent.touches_unseen {
                each(Blob::Hiding { samples });
            } else if self.small.len() < MOST_SMALL {
                self.small.push(extent);
            }
        }
        for Extent { samples, sum, .. } in &self.small {
            let middle = Vec2::from(sum.map(f64::from)) / *samples as f64;
            each(match self.is_near_large(middle) {
                true => Blob::Hiding { samples: *samples },
                false => Blob::Foreign { middle },
            });
        }
    }

    /// Extent of the blob of the differing sample `start`; its samples are then in `queue`.
    fn flood(&mut self, start: usize) -> Extent {
        let Self { stride, states, queue, .. } = self;
        let stride = *stride;
        let mut extent = Extent::default();
        queue.clear();
        queue.push([start % stride, start / stride].map(|i| i as u32));
        states[start] = TAKEN;
        while let Some(&[column, row]) = queue.get(extent.samples) {
            extent.samples += 1;
            extent.sum = [extent.sum[0] + column, extent.sum[1] + row];
            let sample = row as usize * stride + column as usize;
            let beside = [sample - stride, sample - 1, sample + 1, sample + stride].map(|beside| states[beside]);
            extent.touches_unseen |= beside.contains(&UNSEEN);
            for row in row - 1..=row + 1 {
                let first = row as usize * stride + column as usize - 1;
                for (state, column) in states[first..first + 3].iter_mut().zip(column - 1..) {
                    extent.touches_border |= *state == BORDER;
                    if *state == DIFFERS {
                        *state = TAKEN;
                        queue.push([column, row]);
                    }
                }
            }
        }
        extent
    }

    fn is_near_large(&self, middle: Vec2) -> bool {
        let range = |middle: f64| {
            let middle = middle.round() as usize;
            middle.saturating_sub(self.reach)..(middle + self.reach + 1).min(self.stride)
        };
        range(middle.y).any(|row| range(middle.x).any(|column| self.states[row * self.stride + column] == LARGE))
    }
}
