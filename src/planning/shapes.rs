//! Shapes by name: lines, grids, circles, letters of a stroke font, SVG paths, Lissajous figures. [`Pattern`] spreads
//! places over a shape; closed curves are paths for a part. Shapes are independent of plates and parts.
//!
//! ```
//! use upm_core::geometry::Vec2;
//! use upm_planning::shapes::Drawing;
//! let word = Drawing::of_text("HI", 0.08, Vec2::zeros()).unwrap();
//! assert_eq!(word.fewest(), 8, "six ends and junctions of the H, two ends of the I");
//! assert_eq!(word.places(16).unwrap().len(), 16);
//! ```

mod curves;
mod document;
mod drawing;
mod font;
mod pattern;
mod survey;
mod svg;

pub use curves::{circle_path, closed_from, lissajous_path};
pub use document::path_data_of;
pub use drawing::Drawing;
pub use font::known_letters;
pub use pattern::Pattern;

/// Greatest distance between a curve and its polyline, m.
pub const TOLERANCE_M: f64 = 5e-5;
