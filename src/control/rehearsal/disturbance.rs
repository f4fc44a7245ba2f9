use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{Complex, Vector3};
use rand_distr::{Distribution, StandardNormal};

use super::RehearsalParams;
use upm_core::geometry::Vec2;
use upm_core::random::Rng;
use upm_core::signal::{TwistHarmonic, TwistWave};
use upm_library::Library;
use upm_planner::{FieldPulse, PlannedPulse};

/// How far the plate is off each harmonic asked of it, along each axis, relative: in runs of the shipped jobs the
/// accelerometers read motions that are 0.9 to 1.4 % off what was asked, in the median over pulses.
pub(super) const PLATE_OFF: f64 = 0.014;
/// How far a rotation's steps are off in length and, across, in direction, relative: the same in every pulse of an entry.
/// With it rotations end off their learned forecasts as in runs, by 1 % of the way.
pub(super) const ENTRY_OFF: f64 = 0.01;
/// How far parts are off at random after a pulse of either kind, m: the standard deviation.
pub(super) const FIELD_SD_M: f64 = 0.05e-3;
pub(super) const ROTATION_SD_M: f64 = 0.03e-3;

/// Errors of forecasts for parts whose friction is known.
///
/// Most of them repeat: the plate does not quite make the motion it is asked for, and equal pulses carry parts equally. In
/// runs the errors of successive small steps correlate by 0.4 to 0.9, so parts settle; errors drawn anew for each pulse
/// would let parts wander about their targets.
pub(super) struct Disturbance {
    /// For each harmonic the factors of x, y and spin.
    plate: Vec<[Complex<f64>; 3]>,
    /// For each entry of the library the factor of its steps.
    entries: Vec<Complex<f64>>,
    rng: Rng,
}

impl Disturbance {
    /// The disturbance of one rehearsal.
    pub fn new(library: &Library, rehearsal: &RehearsalParams) -> Self {
        let RehearsalParams { streams, number, .. } = rehearsal;
        let mut rng = streams.numbered("rehearsal plate", *number);
        let harmonics = library.fields.as_ref().map_or(0, |fields| fields.twist_from_counts.len());
        let plate = (0..harmonics).map(|_| [(); 3].map(|()| factor(PLATE_OFF, &mut rng))).collect();
        let entries = library.entries.iter().map(|_| factor(ENTRY_OFF, &mut rng)).collect();
        Self { plate, entries, rng: streams.numbered("rehearsal scatter", *number) }
    }

    /// The pulse that the plate makes of `asked`.
    pub fn made(&self, asked: &PlannedPulse) -> PlannedPulse {
        match asked {
            PlannedPulse::Rotation(_) => asked.clone(),
            PlannedPulse::Field(field) => {
                let factors = self.plate.iter().copied().chain(std::iter::repeat([Complex::new(1.0, 0.0); 3]));
                let harmonics = field.wave.harmonics.iter().zip(factors);
                let harmonics = harmonics
                    .map(|(harmonic, factors)| {
                        // each axis is off by itself
                        TwistHarmonic::from_phasor(&harmonic.phasor().component_mul(&Vector3::from(factors)))
                    })
                    .collect();
                let wave = TwistWave { harmonics, ..field.wave };
                PlannedPulse::Field(FieldPulse { wave, ..*field })
            }
        }
    }

    /// Where a part ends that was at `from_m` and is forecast to be at `forecast_m` after the pulse `made`, m.
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

/// 1 and a complex number of standard deviation `off`.
fn factor(off: f64, rng: &mut Rng) -> Complex<f64> {
    let part = FRAC_1_SQRT_2 * off;
    Complex::new(1.0 + part * normal(rng), part * normal(rng))
}

/// A draw of the standard normal distribution.
pub(super) fn normal(rng: &mut Rng) -> f64 {
    StandardNormal.sample(rng)
}
