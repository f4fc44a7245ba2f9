//! Plain data that crosses the hardware boundary: frames and traces in, drives out.

mod drive;
mod envelope;
mod motors;
mod sensors;
mod twist_wave;

pub use drive::{Drive, Follows, Harmonic, Shaping};
pub use envelope::Envelope;
pub use motors::{MOTORS, Motor, MotorArrangement};
pub use sensors::{
    AccelTrace, CHANNEL_NAMES, CHANNELS, Frame, MISSING_SAMPLE, MeasuredDisc, MeasuredPositions, RecordedPulse,
};
pub use twist_wave::{TwistHarmonic, TwistWave};
