//! What the accelerometers say: a trace becomes harmonics, a plate twist, a centre of rotation.

mod types;

pub use types::{FitFault, TwistFit};
