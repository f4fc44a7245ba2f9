//! Plain data that crosses the hardware boundary: frames and traces one way, drives the other.

mod drive;
mod envelope;
mod frame;
mod trace;
mod twist_wave;

pub use drive::{Drive, Harmonic, MOTORS, Motor, Shaping};
pub use envelope::Envelope;
pub use frame::Frame;
pub use trace::{AccelTrace, CHANNEL_NAMES, CHANNELS, MISSING_SAMPLE, RecordedPulse};
pub use twist_wave::{TwistHarmonic, TwistWave};
