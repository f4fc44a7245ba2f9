//! Eyes: the table once, every coin, then each coin again and again. Frames in, measurements out.

mod types;

pub use types::{Detection, HoughArray, Plane, Stages, Table, Track};
