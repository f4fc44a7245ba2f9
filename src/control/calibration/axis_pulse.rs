use super::{CalibrationError, CalibrationSession};
use upm_core::signal::{CHANNELS, Drive, MOTORS};
use upm_perception::estimation::{Coefficients, FitError, TwistFit};

/// Names of the axes in faults.
pub(super) const NAMES: [&str; 3] = ["axis x", "axis y", "axis spin"];

/// Shares of the motors X1, X2, Y1, Y2 around the plate in a force on x, y or spin alone (Eq. 7).
pub(super) const AROUND: [[i32; MOTORS]; 3] = [[1, -1, 0, 0], [0, 0, 1, -1], [-1, -1, 1, 1]];

/// A pulse of one axis, played in both directions.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct AxisPulse {
    pub drive: Drive,
    /// Readings of the channels, m/s²: half the difference between the two directions, the channels' gains included.
    pub shown: [Coefficients; CHANNELS],
}

impl AxisPulse {
    /// Plays `drive` in both directions; the pulse and both readings.
    pub fn play(
        session: &mut CalibrationSession<'_>,
        axis: usize,
        drive: Drive,
    ) -> Result<(Self, [TwistFit; 2]), CalibrationError> {
        let read = |session: &mut CalibrationSession<'_>, drive: &Drive| {
            session.read_twist(NAMES[axis], drive).map_err(|fault| match fault {
                CalibrationError::Trace { fault: FitError::TooWeak { found_mps2, needed_mps2 }, .. } => {
                    CalibrationError::Still { axis: NAMES[axis], found_mps2, needed_mps2 }
                }
                other => other,
            })
        };
        let there = read(session, &drive)?;
        let back = read(session, &drive.clone().reversed())?;
        // leaves out everything that does not change sign with the drive
        let half = |c: usize, k: usize| 0.5 * (there.accel_mps2[c][k] - back.accel_mps2[c][k]);
        let gain = &session.sensors.gain;
        let shown = std::array::from_fn(|c| std::array::from_fn(|k| half(c, k) * gain[c]));
        Ok((Self { drive, shown }, [there, back]))
    }
}
