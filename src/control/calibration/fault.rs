use std::fmt;

use super::super::run_end::RunEnd;
use upm_core::job::Outcome;
use upm_core::rig::RigError;
use upm_core::signal::{CHANNEL_NAMES, Motor};
use upm_core::units::GRAVITY_MPS2;
use upm_perception::estimation::FitError;

/// Least velocity lag, degrees. Velocity lags force by 90° on a free mass and by 0° at resonance.
pub(super) const LEAST_LAG_DEG: f64 = 45.0;

/// A part of the rig that calibration can tell apart from the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RigComponent {
    /// A voice coil, with its amplifier and cable.
    Coil(Motor),
    /// A channel of the accelerometers, index into [`CHANNEL_NAMES`].
    Channel(usize),
    /// An axis of the plate, where no single coil explains the fault.
    Axis(&'static str),
}

impl fmt::Display for RigComponent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Coil(coil) => write!(f, "coil {coil:?}"),
            Self::Channel(channel) => {
                write!(f, "accelerometer channel {}", CHANNEL_NAMES.get(*channel).unwrap_or(&"?"))
            }
            Self::Axis(name) => f.write_str(name),
        }
    }
}

/// Fault of a coil. Gains are multiples of the rig file's.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CoilError {
    /// The coil gives no force.
    #[error("expected 0.7 to 1.3 of its nominal force, found {gain:.2} (dead: check its cable, fuse and amplifier)")]
    Dead {
        /// Measured gain.
        gain: f64,
    },
    /// The force has the wrong sign.
    #[error("expected 0.7 to 1.3 of its nominal force, found {gain:.2} (reversed: exchange its two wires)")]
    Reversed {
        /// Measured gain, negative.
        gain: f64,
    },
    /// The coil plays another coil's signal, and the other plays its signal.
    #[error(
        "expected each coil on its own amplifier, found it exchanged with coil {other:?} (check the plugs of all four)"
    )]
    Swapped {
        /// The other coil.
        other: Motor,
    },
    /// Too weak or too strong compared with the data sheet.
    #[error(
        "expected 0.7 to 1.3 of its nominal force, found {gain:.2} (check its amplifier, and mass, inertia and \
         newtons_per_count in the rig file)"
    )]
    Gain {
        /// Measured gain.
        gain: f64,
    },
    /// Too weak or too strong compared with the other three coils.
    #[error(
        "expected 0.85 to 1.15 times the mean force of the four coils, found {ratio:.2} (check this coil and its \
         amplifier)"
    )]
    Unlike {
        /// Its gain, as a multiple of the mean.
        ratio: f64,
    },
}

/// Fault of an accelerometer channel. Gains are multiples of the channels' median.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MiswiredChannel {
    /// The channel gives no signal.
    #[error("expected 0.1 or more of what the strongest channel shows, found {share:.2} (dead: check its cable)")]
    Dead {
        /// Its root mean square as a share of the strongest channel's.
        share: f64,
    },
    /// The sign is reversed.
    #[error("expected a gain of 0.8 to 1.25 against the others, found {gain:.2} (reversed: check how it is mounted)")]
    Reversed {
        /// Measured gain, negative.
        gain: f64,
    },
    /// The gain differs from that of the others.
    #[error("expected a gain of 0.8 to 1.25 against the others, found {gain:.2} (check its sensor and its range)")]
    Gain {
        /// Measured gain.
        gain: f64,
    },
}

/// Reason for which a calibration yields no library.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The rig refused or failed.
    #[error("rig: {0}")]
    Rig(#[from] RigError),
    /// Table or coins were not found.
    #[error("{0}")]
    Unseen(String),
    /// A trace could not be read.
    #[error("{what}: {fault}")]
    Trace {
        /// Name of the measurement.
        what: String,
        /// The reason.
        fault: FitError,
    },
    /// A coil contradicts the rig file.
    #[error("{}: {fault}", RigComponent::Coil(*coil))]
    Coil {
        /// Motor that the coil belongs to.
        coil: Motor,
        /// Deviation of its force or wiring from the rig file.
        fault: CoilError,
    },
    /// An accelerometer channel contradicts the others.
    #[error("{}: {fault}", RigComponent::Channel(*channel))]
    Channel {
        /// Index into [`CHANNEL_NAMES`].
        channel: usize,
        /// Deviation of its readings from those of the other channels.
        fault: MiswiredChannel,
    },
    /// The readings of the four channels do not fit one rigid plate.
    #[error(
        "accelerometers: expected readings of a rigid plate (a residual of 0.05 or less), found {misfit:.2} (check \
         their mounting, their channels' order and `position_mm` in the rig file)"
    )]
    NotRigid {
        /// Share of the readings, root mean square, that no gains explain.
        misfit: f64,
    },
    /// The strongest drive of an axis does not move the plate.
    #[error(
        "{axis}: expected {needed_mps2:.2} m/s² or more in its strongest pulse, found {found_mps2:.2} m/s² (check \
         power, emergency stop and the cables of its coils)"
    )]
    Still {
        /// `axis x`, `axis y` or `axis spin`.
        axis: &'static str,
        /// Largest acceleration, m/s².
        found_mps2: f64,
        /// Least acceleration that can be read, m/s².
        needed_mps2: f64,
    },
    /// The plate's response does not fit four coils with any gains.
    #[error(
        "motors: expected the response of four coils (a residual of 0.25 or less), found {misfit:.2} (check the coils' \
         order and mounting, and mass, inertia and `lever_arm_mm` in the rig file)"
    )]
    Coupled {
        /// Share of the response, root mean square, that no gains of the coils explain.
        misfit: f64,
    },
    /// The closing pulse differs from the opening one: a coil or a channel changed during calibration.
    #[error(
        "{component}: expected the closing pulse within {:.1} % of the opening one, found {:.1} % (it changed while \
         the rig was calibrated: check it, and calibrate again)",
        100.0 * allowed,
        100.0 * change
    )]
    Changed {
        /// The coil, channel or axis that changed.
        component: RigComponent,
        /// Relative change since the opening pulse.
        change: f64,
        /// Largest change that is accepted, relative.
        allowed: f64,
    },
    /// The closing pulses carry parts differently than the opening pulses with the same drive.
    #[error(
        "camera: expected closing steps within {allowed_mm:.2} mm of the opening ones, {opening_mm:.2} mm, found \
         {closing_mm:.2} mm (check camera, plate and coins, and calibrate again)"
    )]
    StepChanged {
        /// Mean step of the coins at the start, mm.
        opening_mm: f64,
        /// Mean step at the end, mm.
        closing_mm: f64,
        /// Largest difference that is accepted, mm.
        allowed_mm: f64,
    },
    /// The three axes do not move the plate independently.
    #[error("motors do not move x, y and spin independently (gain matrix is singular)")]
    Singular,
    /// The drive is too weak to slide a coin.
    #[error(
        "expected a displacement of {needed_mm} mm or more in the strongest pulse, found {moved_mm:.3} mm, at \
         {peak_mps2:.2} m/s² of the plate (parts are carried from a peak of about 2.2 times their friction \
         coefficient times {GRAVITY_MPS2} m/s² on; below it they stick or creep backwards)"
    )]
    TooWeak {
        /// Largest displacement seen, mm.
        moved_mm: f64,
        /// Least distance that counts as a displacement, mm.
        needed_mm: f64,
        /// Largest acceleration of the plate in that pulse, m/s².
        peak_mps2: f64,
    },
    /// An axis leads the phase of a free mass: its resonance is not below the drive's frequency.
    #[error(
        "{axis}: expected a velocity {LEAST_LAG_DEG}° or more behind the force at {base_hz:.1} Hz, found {lag_deg:.0}° \
         (the resonance must lie below the drive's frequency, where velocity is the force's integral, 90° behind it)"
    )]
    Resonance {
        /// `axis x`, `axis y` or `axis spin`.
        axis: &'static str,
        /// Lag of velocity behind force at the base frequency, degrees.
        lag_deg: f64,
        /// The drive's base frequency, Hz.
        base_hz: f64,
    },
    /// Stopped from outside.
    #[error("stopped from outside, motors at zero")]
    Stopped,
}

impl From<RunEnd> for CalibrationError {
    fn from(ending: RunEnd) -> Self {
        match ending.outcome {
            Outcome::Cancelled => Self::Stopped,
            Outcome::Completed | Outcome::Failed => Self::Unseen(ending.reason),
        }
    }
}
