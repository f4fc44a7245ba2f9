//! Plain data that crosses the hardware boundary: frames and traces in, drives out.

mod drive;
mod envelope;
mod sensors;
mod twist_wave;

pub use drive::{Drive, Harmonic, MOTORS, Motor, Shaping};
pub use envelope::Envelope;
pub use sensors::{AccelTrace, CHANNEL_NAMES, CHANNELS, Frame, MISSING_SAMPLE, RecordedPulse};
pub use twist_wave::{TwistHarmonic, TwistWave};
