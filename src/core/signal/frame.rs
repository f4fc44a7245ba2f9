use crate::time::PlateTime;

/// One picture of the camera, 8-bit gray, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` gray levels, row by row.
    pub pixels: Vec<u8>,
    /// Number of the frame since the rig was switched on.
    pub index: u64,
    /// Middle of the exposure.
    pub exposed_at: PlateTime,
}

impl Frame {
    /// A black frame.
    #[inline]
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![0; width * height], index: 0, exposed_at: PlateTime::ZERO }
    }

    /// Row `y` from the top.
    #[inline]
    pub fn row(&self, y: usize) -> &[u8] {
        &self.pixels[y * self.width..][..self.width]
    }
}
