use super::tiles::{F32Lanes, LANES, Patch};

/// Covered share of every pixel of a tile. Most blocks are covered evenly and need a single number.
#[derive(Clone, Debug)]
pub(super) struct PixelCoverage {
    /// Share of each evenly covered block, NaN for the others.
    even: F32Lanes,
    /// Coverage of the pixels of the other blocks.
    each: Patch,
}

impl PixelCoverage {
    /// Nothing covered.
    pub(super) fn none() -> Self {
        Self { even: [0.0; LANES], each: [[0.0; LANES]; LANES] }
    }

    /// Resets all coverage to zero.
    pub(super) fn clear(&mut self) {
        self.even = [0.0; LANES];
    }

    /// Adds `share` in every pixel of the tile.
    pub(super) fn add_everywhere(&mut self, share: f32) {
        (0..LANES).for_each(|block| self.add(block, share));
    }

    /// Adds `share` in every pixel of a block.
    pub(super) fn add(&mut self, block: usize, share: f32) {
        if self.even[block].is_nan() {
            self.each[block].iter_mut().for_each(|c| *c += share);
        }
        self.even[block] += share;
    }

    /// The pixels of a block, to be added to individually.
    pub(super) fn uneven(&mut self, block: usize) -> &mut F32Lanes {
        let even = std::mem::replace(&mut self.even[block], f32::NAN);
        if !even.is_nan() {
            self.each[block] = [even; LANES];
        }
        &mut self.each[block]
    }

    /// Share of an evenly covered block; NaN if its pixels differ.
    pub(super) fn even(&self, block: usize) -> f32 {
        self.even[block]
    }

    /// Coverage of a block's pixels.
    pub(super) fn of_block(&self, block: usize) -> F32Lanes {
        if self.even[block].is_nan() { self.each[block] } else { [self.even[block]; LANES] }
    }
}
