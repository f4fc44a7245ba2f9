//! Motions that take over from one another: accelerometer readings while one fades and the next one rises.
//!
//! Such a motion is never at full height, so its readings are no harmonics. The expected readings are subtracted from
//! the trace, and harmonics are fitted to the rest; with those of the expected readings they are judged as usual.

use nalgebra::{Complex, DMatrix, Vector3};

use super::accelerometer_phasors::Velocity;
use super::wave::{HarmonicBasis, wave_fit};
use super::{AccelerometerPair, FitError, SteadyWindow, WaveFit, accelerations_mps2, refuse_bad, sustain_window};
use upm_core::geometry::{Vec2, perp};
use upm_core::signal::{AccelTrace, CHANNELS, Drive, Envelope};

/// The stretch of a trace in which one motion takes over from another.
#[derive(Clone, Debug)]
pub struct TakeOver {
    /// The pulse that fades; `None` where the plate was at rest.
    pub last: Option<Drive>,
    window: SteadyWindow,
    basis: HarmonicBasis,
}

impl TakeOver {
    /// The take-over by `drive` in `trace`, which begins with it.
    ///
    /// # Errors
    /// [`FitError::TooShort`] for a trace that is shorter than a period, and as [`sustain_window`].
    pub fn new(trace: &AccelTrace, last: Option<Drive>, drive: &Drive) -> Result<Self, FitError> {
        let rising = Envelope { attack_s: 0.0, sustain_s: drive.envelope.attack_s, rest_s: 0.0 };
        let window = sustain_window(trace, &rising, drive.base_radps)?;
        let harmonics = drive.motors.iter().map(Vec::len).max().unwrap_or(0);
        let basis = HarmonicBasis::new(&window, drive.base_radps, harmonics)?;
        Ok(Self { last, window, basis })
    }

    /// Coefficients of cos and sin of each harmonic, in pairs of rows, that sensors at `place_m` and opposite should
    /// show: a column for each channel, m/s². `velocity` is the steady velocity that a drive gives the plate.
    pub(super) fn coefficients(
        &self,
        drive: &Drive,
        velocity: impl Fn(&Drive) -> Velocity,
        place_m: Vec2,
    ) -> DMatrix<f64> {
        self.basis.solve(&self.readings_mps2(drive, velocity, place_m))
    }

    /// Fits the plate's motion to its trace.
    ///
    /// # Errors
    /// As [`super::fit_wave`].
    pub(super) fn fit(
        &self,
        trace: &AccelTrace,
        drive: &Drive,
        velocity: impl Fn(&Drive) -> Velocity,
        sensors: &AccelerometerPair,
    ) -> Result<WaveFit, FitError> {
        refuse_bad(sensors)?;
        let mut rest = DMatrix::from_columns(&accelerations_mps2(trace, &self.window)?.map(Into::into));
        let mut planned = self.readings_mps2(drive, velocity, sensors.position_m);
        planned.column_iter_mut().zip(sensors.gain).for_each(|(mut column, gain)| column *= gain);
        rest -= &planned;
        wave_fit(&self.basis, &rest, Some(&planned), drive.base_radps, sensors)
    }

    /// Such readings at the samples of the window: a column for each channel, m/s².
    fn readings_mps2(&self, drive: &Drive, velocity: impl Fn(&Drive) -> Velocity, place_m: Vec2) -> DMatrix<f64> {
        let flank = |drive: &Drive| Flank { base_radps: drive.base_radps, velocity: velocity(drive) };
        let (rises, fades) = (flank(drive), self.last.as_ref().map(flank));
        let mut readings = DMatrix::zeros(self.window.samples.len(), CHANNELS);
        for (mut row, t_s) in readings.row_iter_mut().zip(self.window.times_s()) {
            let envelope = &drive.envelope;
            let (height, slope, curvature) = (envelope.at(t_s), envelope.slope(t_s), envelope.curvature(t_s));
            let mut state = rises.state(t_s, [height, slope, curvature]);
            if let Some(fades) = &fades {
                let faded = fades.state(t_s, [1.0 - height, -slope, -curvature]);
                state.iter_mut().zip(faded).for_each(|(sum, faded)| *sum += faded);
            }
            let [first, second] = [place_m, -place_m].map(|place_m| felt_mps2(&state, place_m));
            row.copy_from_slice(&[first.x, first.y, second.x, second.y]);
        }
        readings
    }
}

/// Reading of an accelerometer at `place_m` of a plate with this displacement, velocity and acceleration; to second
/// order, as [`super::accelerometer_phasors`].
fn felt_mps2([place, velocity, acceleration]: &[Vector3<f64>; 3], place_m: Vec2) -> Vec2 {
    let center_mps2 = acceleration.xy();
    center_mps2 - perp(center_mps2) * place.z + perp(place_m) * acceleration.z - place_m * (velocity.z * velocity.z)
}

/// One of the two motions.
struct Flank {
    base_radps: f64,
    /// Phasors of its steady velocity.
    velocity: Velocity,
}

impl Flank {
    /// Displacement, velocity and acceleration of x, y and spin at `t_s`, with the displacement's height and its first
    /// two derivatives.
    fn state(&self, t_s: f64, [height, slope, curvature]: [f64; 3]) -> [Vector3<f64>; 3] {
        let (mut place, mut velocity, mut acceleration) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        let (sin, cos) = libm::sincos(self.base_radps * t_s);
        let step = Complex::new(cos, sin);
        let mut turn = Complex::new(1.0, 0.0);
        for (k, of_harmonic) in (1..).zip(&self.velocity) {
            turn *= step;
            let rate = f64::from(k) * self.base_radps;
            for axis in 0..3 {
                let v = of_harmonic[axis] * turn;
                place[axis] += v.im / rate;
                velocity[axis] += v.re;
                acceleration[axis] -= v.im * rate;
            }
        }
        [
            place * height,
            velocity * height + place * slope,
            acceleration * height + velocity * (2.0 * slope) + place * curvature,
        ]
    }
}
