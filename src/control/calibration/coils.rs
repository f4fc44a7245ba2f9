//! Gains of the single coils, from pulses that drive two or four of them.
//!
//! A pulse of x drives X1 and X2 against each other (Eq. 7): their sum moves the plate along x and their difference
//! turns it. A pulse of y does the same with Y1 and Y2. A pulse of spin shows both differences along x and y and the
//! sum of all four. Three pulses thus give nine equations for four gains; a residual that no gains explain is a fault
//! of another kind.

use nalgebra::{Complex, Matrix3, Matrix3x4, Matrix4, Matrix4x3};

use super::axis_pulse::AxisPulse;
use super::{CalibrationError, CoilError};
use upm_core::geometry::{Twist, Vec2};
use upm_core::phasor::{argument, polar};
use upm_core::rig::RigModel;
use upm_core::signal::{MOTORS, Motor, MotorArrangement};
use upm_perception::estimation::{AccelerometerPair, twist_from_corners};

/// A coil below this share of its nominal force is dead.
const DEAD: f64 = 0.2;
/// Least and largest force of a coil, relative to its nominal one.
const GAIN: (f64, f64) = (0.7, 1.3);
/// Largest deviation of a coil from the mean of the four, relative.
const UNLIKE: f64 = 0.15;
/// Largest share of the response that the coils' gains may leave unexplained: resonances below the drive make up to
/// half of it.
const MISFIT: f64 = 0.25;
/// The same for two exchanged coils.
const SWAPPED_MISFIT: f64 = 0.15;

/// Motors whose force has the sign of the pulse: X1 for x, Y1 for y and spin.
const X1: usize = 0;
const Y1: usize = 2;
/// Motor forces, in counts, of the three pulses, for motors around the plate.
const PLAYED: Matrix4x3<f64> = Matrix4x3::new(1.0, 0.0, -1.0, -1.0, 0.0, -1.0, 0.0, 1.0, 1.0, 0.0, -1.0, 1.0);
/// Wrench of the motors along x, along y and about the centre (over the lever arm), in counts (Eq. 7).
const WRENCH: Matrix3x4<f64> = Matrix3x4::new(1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0);

/// The coils' gains as one harmonic of three pulses shows them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CoilGains {
    /// Wrench on a free plate for one count of each pulse, in counts: rows x, y, spin; columns the pulses.
    wrench: Matrix3<f64>,
    /// Gain of each coil, as a multiple of the nominal one.
    gain: [f64; MOTORS],
    /// Share of `wrench`, root mean square, that these gains leave unexplained.
    misfit: f64,
    arrangement: MotorArrangement,
}

impl CoilGains {
    /// The gains from the first and from the second harmonic of `pulses`. The second is the more reliable one: at its
    /// frequency the plate is closer to a free mass.
    pub fn read(pulses: &[AxisPulse; 3], sensors: &AccelerometerPair, model: &RigModel) -> [Self; 2] {
        let force_n = model.newtons_per_count;
        let along = force_n / model.plate_mass_kg;
        let about = model.lever_arm_m * force_n / model.plate_inertia_kgm2;
        let parts = |of: Twist| [of.velocity_mps.x / along, of.velocity_mps.y / along, of.spin_radps / about];
        [0, 1].map(|harmonic: usize| {
            // the wrench on a free plate that explains the readings of a pulse, for one count of its motor, in counts
            let answer = |(axis, motor): (usize, usize)| -> [Complex<f64>; 3] {
                let pulse = &pulses[axis];
                let [cos, sin] = [2 * harmonic, 2 * harmonic + 1].map(|k| {
                    let at: [f64; 4] = std::array::from_fn(|channel| pulse.shown[channel][k] / sensors.gain[channel]);
                    parts(twist_from_corners(Vec2::new(at[0], at[1]), Vec2::new(at[2], at[3]), sensors.position_m))
                });
                let force = pulse.drive.motors[motor].get(harmonic).copied().unwrap_or_default().phasor();
                std::array::from_fn(|row| Complex::new(cos[row], -sin[row]) / force)
            };
            let columns = [(0, X1), (1, Y1), (2, Y1)].map(answer);
            let wrench = real_part(&Matrix3::from_fn(|row, column| columns[column][row]));
            Self::of(wrench, model.motor_arrangement)
        })
    }

    fn of(wrench: Matrix3<f64>, arrangement: MotorArrangement) -> Self {
        let gain = gains_of(&wrench);
        let explained = WRENCH * Matrix4::from_diagonal(&gain.into()) * PLAYED;
        Self { wrench, gain, misfit: part_left(&wrench, &explained), arrangement }
    }

    /// Refuses two exchanged coils, and dead or reversed ones, where that explains the readings.
    pub fn check_working(&self) -> Result<(), CalibrationError> {
        let (swap, misfit) = self.swapped();
        if misfit < SWAPPED_MISFIT && misfit < 0.5 * self.misfit {
            let [coil, other] = swap;
            return Err(CalibrationError::Coil { coil, fault: CoilError::Swapped { other } });
        }
        let gains = Motor::ALL.into_iter().zip(self.gain);
        let (coil, gain) = gains.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((Motor::X1, f64::NAN));
        if self.misfit > MISFIT || gain >= DEAD {
            return Ok(());
        }
        let fault = if gain < -DEAD { CoilError::Reversed { gain } } else { CoilError::Dead { gain } };
        Err(CalibrationError::Coil { coil, fault })
    }

    /// Refuses gains that contradict the rig file or each other. `first` holds those of the first harmonic: resonances
    /// raise them and a low-pass lowers those of the second, so a faulty coil is one that is off in both.
    pub fn check_gains(&self, first: &Self) -> Result<(), CalibrationError> {
        if self.misfit > MISFIT {
            return Err(CalibrationError::Coupled { misfit: self.misfit });
        }
        let mean = self.gain.iter().sum::<f64>() / MOTORS as f64;
        let of = |coil: usize| (Motor::ALL[coil], self.gain[coil] / mean);
        let unlike = |&(_, ratio): &(Motor, f64)| (ratio - 1.0).abs();
        let worst = (0..MOTORS).map(of).max_by(|a, b| unlike(a).total_cmp(&unlike(b)));
        if let Some((coil, ratio)) = worst.filter(|worst| unlike(worst) > UNLIKE) {
            return Err(CalibrationError::Coil { coil, fault: CoilError::Unlike { ratio } });
        }
        for (coil, (&a, &b)) in Motor::ALL.into_iter().zip(self.gain.iter().zip(&first.gain)) {
            let gain = if (a - 1.0).abs() < (b - 1.0).abs() { a } else { b };
            if !(GAIN.0..=GAIN.1).contains(&gain) {
                return Err(CalibrationError::Coil { coil, fault: CoilError::Gain { gain } });
            }
        }
        Ok(())
    }

    /// The coil whose gain has changed since `before`, and its relative change; `None` where gains do not explain the
    /// response or more than one differs by more than `allowed`.
    pub fn changed_since(&self, before: &Self, allowed: f64) -> Option<(Motor, f64)> {
        let change = |coil: usize| (self.gain[coil] / before.gain[coil] - 1.0).abs();
        let mut off = (0..MOTORS).map(|coil| (Motor::ALL[coil], change(coil))).filter(|(_, change)| *change > allowed);
        let found = off.next().filter(|_| self.misfit <= MISFIT);
        found.filter(|_| off.next().is_none())
    }

    /// The two coils whose exchange explains most of the response, and the share left unexplained.
    fn swapped(&self) -> ([Motor; 2], f64) {
        let pairs = (0..MOTORS).flat_map(|a| (a + 1..MOTORS).map(move |b| [a, b]));
        let of_pair = |[a, b]: [usize; 2]| {
            let signs = Matrix4::from_diagonal(&self.arrangement.turned([1.0; MOTORS]).into());
            let mut played = signs * PLAYED;
            played.swap_rows(a, b);
            let played = signs * played;
            let expected = WRENCH * played;
            let scale = self.wrench.dot(&expected) / expected.norm_squared();
            ([Motor::ALL[a], Motor::ALL[b]], part_left(&self.wrench, &(expected * scale.max(0.0))))
        };
        let nothing = ([Motor::X1, Motor::X2], f64::INFINITY);
        pairs.map(of_pair).min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or(nothing)
    }
}

fn part_left(found: &Matrix3<f64>, explained: &Matrix3<f64>) -> f64 {
    (found - explained).norm() / found.norm().max(f64::MIN_POSITIVE)
}

/// Least squares of four gains on `WRENCH · gains · PLAYED`.
fn gains_of(wrench: &Matrix3<f64>) -> [f64; MOTORS] {
    let [x, y, spin] = [wrench[(0, 0)], wrench[(1, 1)], wrench[(2, 2)]];
    let (of_x, of_y) = ((2.0 * x - y + spin) / 3.0, (2.0 * y - x + spin) / 3.0);
    let differ_x = 0.5 * (wrench[(2, 0)] + wrench[(0, 2)]);
    let differ_y = 0.5 * (wrench[(2, 1)] + wrench[(1, 2)]);
    [of_x - differ_x, of_x + differ_x, of_y + differ_y, of_y - differ_y].map(|twice| 0.5 * twice)
}

/// The response without the delay common to all: the motors' low-pass turns a harmonic by less than 90°.
fn real_part(answers: &Matrix3<Complex<f64>>) -> Matrix3<f64> {
    let turned_rad = 0.5 * argument(answers.iter().map(|answer| answer * answer).sum::<Complex<f64>>());
    answers.map(|answer| (answer * polar(1.0, -turned_rad)).re)
}
