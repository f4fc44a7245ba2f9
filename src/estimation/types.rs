use crate::geometry::Twist;
use crate::signal::{CHANNELS, TwistWave};

/// The plate's motion at full height of a pulse, read from one trace.
#[derive(Clone, Debug, PartialEq)]
pub struct TwistFit {
    /// Least-squares acceleration coefficients of each channel, m/s²: c1, s1, c2, s2 (Eq. 12).
    pub accel_mps2: [[f64; 4]; CHANNELS],
    /// Root mean square of what the fit leaves over, m/s².
    pub residual_rms_mps2: f64,
    /// The plate's velocity as a two-harmonic twist (Eq. 13, App. B), times from the start of the pulse.
    pub wave: TwistWave,
    /// Amplitude T of the pump wave `T (cos wt' - ½ cos 2wt')` that comes nearest; parts flow along its field.
    /// Its sign is that of the mean force (Eq. 14), so its centre of rotation and spin are those of the flow.
    pub pump: Twist,
}

/// Why a trace gives no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitFault {
    /// Too short a time at full height.
    #[error("trace shows {found_s:.3} s at full height, {needed_s:.3} s are needed")]
    TooShort {
        /// What there is, s.
        found_s: f64,
        /// What is needed, s.
        needed_s: f64,
    },
    /// Samples at the converter's limit.
    #[error("channel {channel} is clipped in {samples} samples at {limit} counts")]
    Clipped {
        /// Index of the channel.
        channel: usize,
        /// How many samples.
        samples: usize,
        /// The converter's limit, counts.
        limit: i16,
    },
    /// Samples that never arrived.
    #[error("channel {channel} lacks {samples} samples")]
    Missing {
        /// Index of the channel.
        channel: usize,
        /// How many samples.
        samples: usize,
    },
    /// The plate hardly moved.
    #[error("motion of {found_mps2:.3} m/s² is too weak to read, {needed_mps2:.3} m/s² are needed")]
    TooWeak {
        /// Largest amplitude found, m/s².
        found_mps2: f64,
        /// What is needed, m/s².
        needed_mps2: f64,
    },
}
