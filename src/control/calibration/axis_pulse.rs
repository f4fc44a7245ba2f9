use super::{CalibrationFault, CalibrationSession};
use upm_core::signal::{CHANNELS, Drive};
use upm_perception::estimation::{Coefficients, FitFault, TwistFit};

/// Names of the axes in faults.
pub(super) const NAMES: [&str; 3] = ["axis x", "axis y", "axis spin"];

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
    ) -> Result<(Self, [TwistFit; 2]), CalibrationFault> {
        let read = |session: &mut CalibrationSession<'_>, drive: &Drive| {
            session.read_twist(NAMES[axis], drive).map_err(|fault| match fault {
                CalibrationFault::Trace { fault: FitFault::TooWeak { found_mps2, needed_mps2 }, .. } => {
                    CalibrationFault::Still { axis: NAMES[axis], found_mps2, needed_mps2 }
                }
                other => other,
            })
        };
        let there = read(session, &drive)?;
        let back = read(session, &drive.clone().reversed())?;
        let shown = half_difference(&there, &back, &session.sensors.gain);
        Ok((Self { drive, shown }, [there, back]))
    }
}

/// Half the difference of the readings, with the channels' gains put back in: leaves out everything that does not
/// change sign with the drive.
fn half_difference(there: &TwistFit, back: &TwistFit, gain: &[f64; CHANNELS]) -> [Coefficients; CHANNELS] {
    let (there, back) = (&there.accel_mps2, &back.accel_mps2);
    std::array::from_fn(|c| std::array::from_fn(|k| 0.5 * (there[c][k] - back[c][k]) * gain[c]))
}
