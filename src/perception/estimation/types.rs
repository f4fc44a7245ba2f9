use nalgebra::Complex;

use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{CHANNELS, TwistWave};

/// Acceleration coefficients c1, s1, c2, s2 of one channel (Eq. 12), m/s².
pub type Coefficients = [f64; 4];

/// Positions of the accelerometers, and their channels' readings for a true 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccelerometerPair {
    /// Position of accelerometer 1 on the plate, m; accelerometer 2 is opposite.
    pub position_m: Vec2,
    /// Reading over true acceleration, in the order of [`CHANNEL_NAMES`](upm_core::signal::CHANNEL_NAMES).
    pub gain: [f64; CHANNELS],
}

impl AccelerometerPair {
    /// Channels of gain 1.
    pub fn exact(position_m: Vec2) -> Self {
        Self { position_m, gain: [1.0; CHANNELS] }
    }
}

/// The plate's motion at full height of a pulse of either kind, from one trace.
#[derive(Clone, Debug, PartialEq)]
pub enum PlateFit {
    /// Motion of a rotation's pulse.
    Twist(Box<TwistFit>),
    /// Motion of a synthesised motion's pulse.
    Wave(WaveFit),
}

impl PlateFit {
    /// The fit of all harmonics, whatever the pulse.
    pub fn motion(&self) -> &WaveFit {
        match self {
            Self::Twist(fit) => &fit.motion,
            Self::Wave(fit) => fit,
        }
    }
}

/// The plate's motion at full height of a rotation's pulse, from one trace.
#[derive(Clone, Debug, PartialEq)]
pub struct TwistFit {
    /// The fit of both harmonics; its wave is the plate's velocity as a two-harmonic twist (Eq. 13, App. B).
    pub motion: WaveFit,
    /// Its acceleration coefficients of each channel, m/s²: c1, s1, c2, s2 (Eq. 12).
    pub accel_mps2: [Coefficients; CHANNELS],
    /// The velocity as phasors of x (m/s), y (m/s) and spin (rad/s), for calibration.
    pub axes: [AxisPhasors; 3],
    /// Amplitude T of the nearest pump wave `T (cos wt' - ½ cos 2wt')`; parts flow along its field. Its sign is that of
    /// the mean force (Eq. 14), so its centre of rotation and spin are those of the flow.
    pub pump: Twist,
    /// How well the pump wave describes the motion.
    pub quality: PumpWaveQuality,
}

/// The plate's motion at full height of a synthesised motion's pulse, from one trace.
#[derive(Clone, Debug, PartialEq)]
pub struct WaveFit {
    /// Least-squares acceleration coefficients of each channel, m/s², corrected for its gain: for harmonic k at index
    /// `k - 1` those of cos kwt and sin kwt.
    pub accel_mps2: [Vec<[f64; 2]>; CHANNELS],
    /// Standard deviation of each of them, m/s²: from the residuals of all channels together and the normal matrix.
    pub accel_sd_mps2: Vec<[f64; 2]>,
    /// Root mean square residual of the fit in each channel, m/s².
    pub channel_residual_mps2: [f64; CHANNELS],
    /// Root mean square residual of the fit, m/s².
    pub residual_rms_mps2: f64,
    /// The plate's velocity, times from the start of the pulse.
    pub wave: TwistWave,
}

/// The velocity of one axis: `v(t) = Re(first e^{jwt} + second e^{2jwt})`, times from the start of the pulse.
/// A harmonic `c cos + s sin` is the phasor `c - js`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisPhasors {
    /// Phasor at the base frequency.
    pub first: Complex<f64>,
    /// Phasor at twice the base frequency.
    pub second: Complex<f64>,
}

impl AxisPhasors {
    /// `second · conj(first)² / |first|³`, invariant to time shifts: -½ for a pump wave that pushes forwards, +½ for
    /// one that pushes backwards (Eq. 5); `None` for an axis at rest.
    pub fn harmonic_ratio(&self) -> Option<Complex<f64>> {
        let size = upm_core::phasor::magnitude(self.first);
        let ratio = self.second * (self.first.conj() / size).powi(2) / size;
        ratio.is_finite().then_some(ratio)
    }
}

/// Deviation of a motion from the nearest pump wave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PumpWaveQuality {
    /// Second over first harmonic of the velocity along the pump's direction; ideally ½.
    pub harmonic_ratio: f64,
    /// Lead of the second harmonic over that of a pump wave, rad, from -π/2 to π/2; ideally 0, and at the ends the mean
    /// force vanishes.
    pub harmonic_phase_rad: f64,
}

/// Reasons why a trace cannot be evaluated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// The time at full height is too short.
    #[error("sustain: expected {needed_s:.3} s or more (one period of the drive), found {found_s:.3} s at full height")]
    TooShort {
        /// Time at full height in the trace, s.
        found_s: f64,
        /// Required time, s.
        needed_s: f64,
    },
    /// The trace ends before the pulse's sustain does.
    #[error("trace: expected an end at {needed_s:.3} s or later (that of the sustain), found {found_s:.3} s")]
    CutShort {
        /// Time of the last sample after the start of the pulse, s.
        found_s: f64,
        /// End of the sustain, s.
        needed_s: f64,
    },
    /// Samples at the converter's limit.
    #[error("counts.{channel}: expected no clipped sample among those read, found {samples} at {limit}")]
    Clipped {
        /// Name of the channel.
        channel: &'static str,
        /// Number of clipped samples.
        samples: usize,
        /// The converter's limit, counts.
        limit: i16,
    },
    /// Samples that never arrived.
    #[error("counts.{channel}: expected no missing sample among those read, found {samples}")]
    Missing {
        /// Name of the channel.
        channel: &'static str,
        /// Number of missing samples.
        samples: usize,
    },
    /// The motion is below the smallest amplitude that can be evaluated.
    #[error("motion: expected {needed_mps2:.3} m/s² or more to be read, found {found_mps2:.3} m/s²")]
    TooWeak {
        /// Largest amplitude found, m/s².
        found_mps2: f64,
        /// Required amplitude, m/s².
        needed_mps2: f64,
    },
    /// The lines of a spectrum do not determine an axis's resonance.
    #[error("resonance: expected a standard deviation of {needed_sd} or less, found {found_sd:.3}")]
    Undetermined {
        /// The larger of the standard deviations of the natural frequency, as a fraction of it, and of the damping
        /// ratio.
        found_sd: f64,
        /// Largest accepted standard deviation.
        needed_sd: f64,
    },
    /// The trace, or a parameter of its evaluation, is invalid.
    #[error("trace cannot be read: {0}")]
    Unreadable(&'static str),
}
