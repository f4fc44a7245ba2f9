use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{Complex, Vector3};
use rand_distr::{Distribution, StandardNormal};

use super::DryRunParams;
use upm_cor_library::Library;
use upm_core::geometry::Vec2;
use upm_core::random::Rng;
use upm_core::signal::{TwistHarmonic, TwistWave};
use upm_planner::{FieldPulse, PlannedPulse};

/// Relative error of the plate's motion in each harmonic, along each axis: in runs of the shipped jobs the motions read
/// by the accelerometers deviate by 0.9 to 1.4 % from the commanded ones, in the median over pulses.
pub(super) const PLATE_OFF: f64 = 0.014;
/// Relative error of a rotation's steps in length and, across, in direction; the same in every pulse of an entry. With
/// it rotations end off their learned forecasts by 1 % of the displacement, as in runs.
pub(super) const ENTRY_OFF: f64 = 0.01;
/// Standard deviation of the random error of a part's position after a pulse of either kind, m.
pub(super) const FIELD_SD_M: f64 = 0.05e-3;
pub(super) const ROTATION_SD_M: f64 = 0.03e-3;

/// Errors of forecasts for parts whose friction is known.
///
/// Most of the error repeats: the plate's motion deviates from the commanded one, and equal pulses carry parts equally.
/// In runs the errors of successive small steps correlate by 0.4 to 0.9, so parts settle; independent errors for each
/// pulse would let parts wander about their targets.
pub(super) struct ModelDisturbance {
    /// For each harmonic the factors of x, y and spin.
    plate: Vec<[Complex<f64>; 3]>,
    /// For each entry of the library the factor of its steps.
    entries: Vec<Complex<f64>>,
    rng: Rng,
}

impl ModelDisturbance {
    /// Draws the disturbance of one dry run.
    pub fn new(library: &Library, dry_run: &DryRunParams) -> Self {
        let DryRunParams { streams, number, .. } = dry_run;
        // the names of the streams seed their numbers: with other names, all forecasts change
        let mut rng = streams.numbered("rehearsal plate", *number);
        let harmonics = library.fields.as_ref().map_or(0, |fields| fields.twist_from_counts.len());
        let plate = (0..harmonics).map(|_| [(); 3].map(|()| factor(PLATE_OFF, &mut rng))).collect();
        let entries = library.entries.iter().map(|_| factor(ENTRY_OFF, &mut rng)).collect();
        Self { plate, entries, rng: streams.numbered("rehearsal scatter", *number) }
    }

    /// The actual pulse of the plate for the commanded pulse `asked`.
    pub fn made(&self, asked: &PlannedPulse) -> PlannedPulse {
        match asked {
            PlannedPulse::Rotation(_) => asked.clone(),
            PlannedPulse::Field(field) => {
                let factors = self.plate.iter().copied().chain(std::iter::repeat([Complex::new(1.0, 0.0); 3]));
                let harmonics = field.wave.harmonics.iter().zip(factors);
                let harmonics = harmonics
                    .map(|(harmonic, factors)| {
                        // the error of each axis is independent
                        TwistHarmonic::from_phasor(&harmonic.phasor().component_mul(&Vector3::from(factors)))
                    })
                    .collect();
                let wave = TwistWave { harmonics, ..field.wave };
                PlannedPulse::Field(FieldPulse { wave, ..*field })
            }
        }
    }

    /// Final position, m, of a part that was at `from_m` and is forecast to be at `forecast_m` after the actual pulse
    /// `made`.
    pub fn end_m(&mut self, made: &PlannedPulse, from_m: Vec2, forecast_m: Vec2) -> Vec2 {
        let step_m = forecast_m - from_m;
        let (step_m, sd_m) = match made {
            PlannedPulse::Rotation(rotation) => {
                let factor = self.entries.get(rotation.entry).copied().unwrap_or(Complex::new(1.0, 0.0));
                let turned = Complex::new(step_m.x, step_m.y) * factor;
                (Vec2::new(turned.re, turned.im), ROTATION_SD_M)
            }
            PlannedPulse::Field(_) => (step_m, FIELD_SD_M),
        };
        let sd_m = FRAC_1_SQRT_2 * sd_m;
        from_m + step_m + Vec2::new(sd_m * normal(&mut self.rng), sd_m * normal(&mut self.rng))
    }
}

/// 1 plus a complex normal number of standard deviation `off`.
fn factor(off: f64, rng: &mut Rng) -> Complex<f64> {
    let part = FRAC_1_SQRT_2 * off;
    Complex::new(1.0 + part * normal(rng), part * normal(rng))
}

/// A draw from the standard normal distribution.
pub(super) fn normal(rng: &mut Rng) -> f64 {
    StandardNormal.sample(rng)
}
