//! Reference vision: locates table and parts by the standard algorithms of `imageproc`, slow and simple. It shares no
//! search code with `upm_perception::vision`, only the types of the results and the pinhole geometry in them; the fast
//! path is tested and benchmarked against it.
//!
//! ```text
//! frame ─► warp (lens removed) ─► Canny ─► Hough, 1° × 1 px ─► lines fitted to edges ─► four sides ─► table
//!              └────► darkness against the plate ─► match_template with disks ─► peaks, parabola ─► parts
//! ```
//!
//! It expects one square table, whole, sharply lit and without clutter of its size, and parts of known kinds. Pictures
//! with occlusions, reliefs or strong glints are not supported.

mod lines;
mod parts;
mod quad;
#[cfg(test)]
mod tests;

use image::{GrayImage, Luma};
use imageproc::geometric_transformations::{Border, Interpolation, warp_with};

use upm_core::geometry::{Lens, Vec2};
use upm_core::signal::Frame;
use upm_perception::vision::Table;

pub use parts::find_parts;

/// Shortest side of a picture, px.
const LEAST_SIZE: usize = 32;
/// Most pixels of a picture: template matching takes about a second for each million.
const MOST_PIXELS: usize = 16_000_000;

/// Reasons why the reference finds no table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReferenceError {
    /// The picture is too small, too large, or its size disagrees with its pixels.
    #[error(
        "picture: expected {LEAST_SIZE} px or more a side and {MOST_PIXELS} px in all, found {width} x {height} px"
    )]
    BadSize {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// No four lines of the Hough transform make a square with edges along its sides.
    #[error("no four lines make a square (reference method)")]
    NoTable,
}

/// The picture without lens distortion, and the table found in it.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceView {
    /// Gray levels in ideal image coordinates, of the frame's size.
    pub ideal: GrayImage,
    /// Plate with its pose, from the four corners found in `ideal`.
    pub table: Table,
}

/// Finds the table in `frame`, taken through `lens`; `side_m` is the plate's side, m.
///
/// # Errors
///
/// [`ReferenceError`] for pictures of a bad size or without a table.
pub fn locate_table(frame: &Frame, lens: &Lens, side_m: f64) -> Result<ReferenceView, ReferenceError> {
    let (width, height) = (frame.width, frame.height);
    let bad_size = ReferenceError::BadSize { width, height };
    let pixels = width.checked_mul(height).filter(|&pixels| pixels <= MOST_PIXELS && pixels == frame.pixels.len());
    if pixels.is_none() || width.min(height) < LEAST_SIZE {
        return Err(bad_size);
    }
    let picture = GrayImage::from_raw(width as u32, height as u32, frame.pixels.clone()).ok_or(bad_size)?;
    let ideal = undistorted(picture, lens);
    let corners = quad::corners(&ideal).ok_or(ReferenceError::NoTable)?;
    let table = Table::from_ideal_corners(corners, side_m, lens).map_err(|_| ReferenceError::NoTable)?;
    Ok(ReferenceView { ideal, table })
}

fn undistorted(picture: GrayImage, lens: &Lens) -> GrayImage {
    if lens.is_ideal() {
        return picture;
    }
    let in_picture = |x: f32, y: f32| {
        let seen = lens.image_from_ideal(Vec2::new(f64::from(x), f64::from(y)));
        (seen.x as f32, seen.y as f32)
    };
    warp_with(&picture, in_picture, Interpolation::Bilinear, Border::Constant(Luma([0])))
}
