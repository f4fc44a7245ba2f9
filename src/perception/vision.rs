//! Camera vision: locates the table once, finds every coin, then tracks the coins from frame to frame. Input: frames;
//! output: measurements.

mod binned;
mod classifier;
mod coins;
#[cfg(test)]
mod coins_tests;
mod disk;
mod edges;
mod hough;
mod lines;
mod locate;
mod outline;
mod plate_watch;
#[cfg(test)]
mod plate_watch_tests;
mod quad;
mod rim;
mod run_length_sums;
mod sampling;
mod shading;
mod survey;
#[cfg(test)]
mod survey_tests;
mod table;
#[cfg(test)]
mod table_tests;
mod table_watch;
#[cfg(test)]
mod table_watch_tests;
mod tracking;
#[cfg(test)]
mod tracking_tests;
mod types;

pub use coins::CoinFinder;
pub use locate::{TableError, locate_corners, locate_table};
pub use plate_watch::{PlateOccupancy, PlateWatch};
pub use survey::{seen_outline_m, survey};
pub use table::focal_from_corners;
pub use table_watch::{TableMotion, TableWatch};
pub use tracking::Tracker;
pub use types::{DetectedDisc, Detection, Table, Track};
