//! Comparison of two libraries of one rig, as the check of a library from elsewhere: a fingerprint is a text that can
//! be copied, while predictions can be compared.

use nalgebra::{Complex, Matrix3, Vector3};

use super::{AxisShape, Entry, FieldResponse, Library, PlateResponse};
use upm_core::units::mm_from_m;
use upm_document::Diagnostic;

/// Largest difference of two measurements of the same quantity, in standard deviations, the scatter of both included.
const SIGMAS: f64 = 3.0 * std::f64::consts::SQRT_2;
/// Factors of friction, and of the plate's speed, whose steps count as equal. A node of the grid may have been measured
/// by a single coin: at a spread of 10 % from coin to coin, as in the rig files, the ends are three standard deviations
/// of the difference of two coins. The standard deviations in a library do not include this spread: two calibrations of
/// one rig with different coins differ by up to 70 % at slow nodes, and by 20 % at the fastest.
const PARTS: [f64; 5] = [0.58, 0.79, 1.0, 1.21, 1.42];
/// Relative difference of two calibrations beyond their scatter: grids, temperature, wear.
const SHARE: f64 = 0.05;
/// Difference below which two steps are equal, m: shorter steps count as no motion in calibration.
const STEP_M: f64 = 0.2e-3;
/// Largest difference of two natural frequencies, relative, and of two damping ratios.
const RESONANCE: f64 = 0.1;
/// Largest difference of two channels' gains.
const GAIN: f64 = 0.02;
/// Fraction of the largest singular value of the motors' response below which one carries no information.
const SINGULAR: f64 = 1e-6;

impl Library {
    /// The first prediction of this library that `own`, measured on the same rig, contradicts: accelerometer gains,
    /// waveforms, resonances, the plate's velocity for the counts of each entry, the steps of parts, the response to
    /// synthesised motions. `None` when each is close enough to the prediction of `own`: gains within 2 %, natural
    /// frequencies within 10 %, damping ratios within 0.1, the others within 5 % plus, where the scatter is known, 3
    /// standard deviations of both measurements. Steps may also be those that `own` predicts for coins of up to 42 %
    /// more or less friction, which is as far apart as two single coins are, or for a plate speed changed as much.
    /// Standard deviations are those of `own` alone, so that another library cannot widen them.
    pub fn disagreement(&self, own: &Self) -> Option<Diagnostic> {
        self.other_gain(own)
            .or_else(|| self.other_shape(own))
            .or_else(|| other_plate(self.plate.as_ref(), own.plate.as_ref()))
            .or_else(|| self.other_entry(own))
            .or_else(|| self.other_step(own))
            .or_else(|| other_field(self.fields.as_ref(), own.fields.as_ref()))
    }

    fn other_gain(&self, own: &Self) -> Option<Diagnostic> {
        let pairs = self.accelerometer_gain.iter().zip(&own.accelerometer_gain).enumerate();
        let mut others = pairs.filter(|(_, (found, its))| differ(**found, **its, GAIN));
        others.next().map(|(k, (found, its))| beside_own(format!("accelerometer_gain[{k}]"), found, its))
    }

    fn other_shape(&self, own: &Self) -> Option<Diagnostic> {
        let flat = |AxisShape([first, second]): AxisShape| [first.cos, first.sin, second.cos, second.sin];
        let pairs = self.shapes.map(flat).into_iter().zip(own.shapes.map(flat));
        let mut named = ["x", "y", "spin"].into_iter().zip(pairs);
        named.find(|(_, (found, its))| differ_much(found, its)).map(|(axis, (found, its))| {
            beside_own(format!("shapes.{axis}"), format!("{found:.3?}"), format!("{its:.3?}"))
        })
    }

    fn other_entry(&self, own: &Self) -> Option<Diagnostic> {
        let answer = MotorResponse::of(own);
        let mut entries = self.entries.iter().enumerate();
        let (i, entry, expected) = entries.find_map(|(i, entry)| {
            let expected = answer.velocity_from_counts * self.axis_counts(entry);
            let off = (velocity(entry, answer.reach_m) - expected).norm();
            // written so that NaN is refused too
            let agrees = off <= SIGMAS * answer.scatter_mps + SHARE * expected.norm();
            (!agrees).then_some((i, entry, expected))
        })?;
        let shown = |v: Vector3<f64>| {
            let spin = v.z / answer.reach_m;
            format!("[{:.1}, {:.1}] mm/s and {spin:.3} rad/s", mm_from_m(v.x), mm_from_m(v.y))
        };
        Some(beside_own(format!("entries[{i}]"), shown(velocity(entry, answer.reach_m)), shown(expected)))
    }

    /// Compares steps at every node of this library's grid, and at those of `own` within it: a coarse grid also
    /// predicts between its nodes.
    fn other_step(&self, own: &Self) -> Option<Diagnostic> {
        let (mine, its) = (&self.displacement, &own.displacement);
        let other = |speed_mps: f64, sustain_s: f64| {
            let [found_m, own_m] = [mine, its].map(|model| model.distance(speed_mps, sustain_s));
            // Coulomb's law: with friction times k, and the plate's speed times k, steps are k times as long
            let rougher = PARTS.map(|part| part * its.distance(speed_mps / part, sustain_s));
            let faster = PARTS.map(|part| its.distance(speed_mps * part, sustain_s));
            let steps_m = rougher.into_iter().chain(faster);
            let (least_m, most_m) =
                steps_m.fold((own_m, own_m), |(least, most), step_m| (step_m.min(least), step_m.max(most)));
            let scatter_m = SIGMAS * its.sd(speed_mps, sustain_s) + SHARE * own_m + STEP_M;
            // written so that NaN is refused too
            let agrees = (least_m - scatter_m..=most_m + scatter_m).contains(&found_m);
            (!agrees).then(|| [found_m, own_m].map(|m| format!("{:.3} mm", mm_from_m(m))))
        };
        for (i, &speed_mps) in mine.speed_mps.iter().enumerate() {
            for (k, &sustain_s) in mine.sustain_s.iter().enumerate() {
                if let Some([found, its]) = other(speed_mps, sustain_s) {
                    return Some(beside_own(format!("displacement.distance_mm[{i}][{k}]"), found, its));
                }
            }
        }
        let within = |grid: &[f64], x: f64| {
            grid.first().is_some_and(|first| *first <= x) && grid.last().is_some_and(|last| x <= *last)
        };
        for &speed_mps in its.speed_mps.iter().filter(|speed| within(&mine.speed_mps, **speed)) {
            for &sustain_s in its.sustain_s.iter().filter(|sustain| within(&mine.sustain_s, **sustain)) {
                if let Some([found, its]) = other(speed_mps, sustain_s) {
                    let place = format!("{found} at {:.1} mm/s and {sustain_s} s", mm_from_m(speed_mps));
                    return Some(beside_own("displacement.distance_mm", place, its));
                }
            }
        }
        None
    }
}

/// Response of the plate to motor amplitudes, fitted to the entries of one library.
struct MotorResponse {
    /// Velocity (m/s; spin at `reach_m`) per axis amplitude of Eq. 7, counts.
    velocity_from_counts: Matrix3<f64>,
    /// Standard deviation of an entry about that fit, m/s.
    scatter_mps: f64,
    /// Radius at which spin counts like velocity, m.
    reach_m: f64,
}

impl MotorResponse {
    /// Least squares over all entries. Directions in which no entry moves the plate count as no motion.
    fn of(library: &Library) -> Self {
        let reach_m = 0.5 * library.plate_side_m;
        let (mut products, mut normal) = (Matrix3::zeros(), Matrix3::zeros());
        for entry in &library.entries {
            let counts = library.axis_counts(entry);
            products += velocity(entry, reach_m) * counts.transpose();
            normal += counts * counts.transpose();
        }
        let inverse = normal.pseudo_inverse(SINGULAR * normal.norm()).unwrap_or_else(|_| Matrix3::zeros());
        let velocity_from_counts = products * inverse;
        let off = |entry: &Entry| {
            (velocity(entry, reach_m) - velocity_from_counts * library.axis_counts(entry)).norm_squared()
        };
        let sum: f64 = library.entries.iter().map(off).sum();
        let scatter_mps = (sum / library.entries.len().max(1) as f64).sqrt();
        Self { velocity_from_counts, scatter_mps, reach_m }
    }
}

fn velocity(entry: &Entry, reach_m: f64) -> Vector3<f64> {
    let pump = &entry.pump;
    Vector3::new(pump.velocity_mps.x, pump.velocity_mps.y, pump.spin_radps * reach_m)
}

fn other_plate(found: Option<&PlateResponse>, own: Option<&PlateResponse>) -> Option<Diagnostic> {
    let (found, own) = match (found, own) {
        (None, None) => return None,
        (Some(found), Some(own)) => (found, own),
        (found, _) => {
            let (found, own) = if found.is_some() { ("resonances", "none") } else { ("nothing", "resonances") };
            return Some(beside_own("plate", found, own));
        }
    };
    let natural =
        (0..3).find(|&k| differ(found.natural_radps[k], own.natural_radps[k], RESONANCE * own.natural_radps[k]));
    let damping = (0..3).find(|&k| differ(found.damping_ratio[k], own.damping_ratio[k], RESONANCE));
    let hz = |radps: f64| format!("{:.2}", radps / std::f64::consts::TAU);
    let axis = |k: usize| ["x", "y", "spin"].get(k).copied().unwrap_or_default();
    let of_natural = natural.map(|k| {
        beside_own(format!("plate.natural_hz.{}", axis(k)), hz(found.natural_radps[k]), hz(own.natural_radps[k]))
    });
    of_natural.or_else(|| {
        damping.map(|k| {
            beside_own(format!("plate.damping_ratio.{}", axis(k)), found.damping_ratio[k], own.damping_ratio[k])
        })
    })
}

/// Compares the responses of each axis, harmonic by harmonic.
fn other_field(found: Option<&FieldResponse>, own: Option<&FieldResponse>) -> Option<Diagnostic> {
    let (Some(found), Some(own)) = (found, own) else { return None };
    let rows = |matrix: &Matrix3<Complex<f64>>, row: usize| -> Vec<f64> {
        matrix.row(row).iter().flat_map(|part| [part.re, part.im]).collect()
    };
    let pairs = found.twist_from_counts.iter().zip(&own.twist_from_counts).enumerate();
    let mut all = pairs.flat_map(|(k, (found, own))| (0..3).map(move |row| (k, row, rows(found, row), rows(own, row))));
    let (k, row, found, own) = all.find(|(_, _, found, own)| differ_much(found, own))?;
    let size = |row: &[f64]| row.iter().map(|part| part * part).sum::<f64>().sqrt();
    let off = found.iter().zip(&own).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt() / size(&own);
    let path = format!("fields.twist_from_counts[{k}][{row}]");
    Some(Diagnostic::new("", path, format!("{:.0} % off the plate's own", 100.0 * off), format!("{} %", 100.0 * SHARE)))
}

/// Written so that NaN differs from everything.
fn differ(found: f64, own: f64, allowed: f64) -> bool {
    let agree = (found - own).abs() <= allowed;
    !agree
}

/// True when the vectors differ by more than [`SHARE`] of `own`.
fn differ_much(found: &[f64], own: &[f64]) -> bool {
    let off = found.iter().zip(own).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let size = own.iter().map(|part| part * part).sum::<f64>().sqrt();
    differ(off, 0.0, SHARE * size)
}

fn beside_own(path: impl std::fmt::Display, found: impl std::fmt::Display, own: impl std::fmt::Display) -> Diagnostic {
    let allowed = format!("{own} within the scatter of calibration, as the plate's own library has it");
    Diagnostic::new("", path, found, allowed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn shipped(path: &str) -> Library {
        Library::load(&Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(path)).unwrap()
    }

    fn upm_2() -> Library {
        shipped("assets/libraries/upm-2.json")
    }

    fn path_of(change: impl FnOnce(&mut Library)) -> String {
        let (own, mut other) = (upm_2(), upm_2());
        change(&mut other);
        other.disagreement(&own).map_or_else(String::new, |fault| fault.path)
    }

    #[test]
    fn equal_library_agrees() {
        assert_eq!(upm_2().disagreement(&upm_2()), None);
    }

    #[test]
    fn small_library_of_the_same_rig_agrees() {
        let (own, other) = (shipped("assets/libraries/upm-1.json"), shipped("tests/golden/small-library.json"));
        assert_eq!(other.disagreement(&own), None);
    }

    #[test]
    fn changed_predictions_are_named_by_their_path() {
        let reversed = |library: &mut Library| library.entries.iter_mut().for_each(|entry| entry.pump = -entry.pump);
        assert_eq!(path_of(reversed), "entries[0]");
        let reversed_drive = |library: &mut Library| library.shapes.iter_mut().for_each(reverse_shape);
        assert_eq!(path_of(reversed_drive), "shapes.x");
        let reversed_counts = |library: &mut Library| library.entries[7].amplitudes.iter_mut().for_each(|a| *a = -*a);
        assert_eq!(path_of(reversed_counts), "entries[7]");
        let reversed_field = |library: &mut Library| {
            library.fields.as_mut().unwrap().twist_from_counts.iter_mut().for_each(|matrix| *matrix = -*matrix);
        };
        assert_eq!(path_of(reversed_field), "fields.twist_from_counts[0][0]");
        let longer = |library: &mut Library| library.displacement.distance_m[9].iter_mut().for_each(|d| *d *= 2.0);
        assert!(path_of(longer).starts_with("displacement.distance_mm[9]["));
        let scattered = |library: &mut Library| {
            library.displacement.distance_m[9].iter_mut().for_each(|d| *d *= 2.0);
            library.displacement.sd_m.iter_mut().flatten().for_each(|sd| *sd = 1.0);
        };
        assert!(path_of(scattered).starts_with("displacement.distance_mm[9]["), "its own scatter counts for nothing");
        assert_eq!(path_of(|library| library.accelerometer_gain[2] = 1.1), "accelerometer_gain[2]");
        assert_eq!(path_of(|library| library.plate = None), "plate");
        assert_eq!(path_of(|library| library.plate.as_mut().unwrap().natural_radps[1] *= 2.0), "plate.natural_hz.y");
    }

    #[test]
    fn grid_of_two_nodes_is_compared_between_its_nodes() {
        let coarse = |library: &mut Library| {
            let model = &mut library.displacement;
            for row in model.distance_m.iter_mut().chain(&mut model.sd_m) {
                *row = vec![row[0], row[row.len() - 1]];
            }
            let rows = [&mut model.distance_m, &mut model.sd_m];
            rows.into_iter().for_each(|rows| *rows = vec![rows[0].clone(), rows[rows.len() - 1].clone()]);
            model.sustain_s = vec![model.sustain_s[0], model.sustain_s[model.sustain_s.len() - 1]];
            model.speed_mps = vec![model.speed_mps[0], model.speed_mps[model.speed_mps.len() - 1]];
        };
        assert_eq!(path_of(coarse), "displacement.distance_mm");
    }

    fn reverse_shape(shape: &mut AxisShape) {
        shape.0.iter_mut().for_each(|harmonic| (harmonic.cos, harmonic.sin) = (-harmonic.cos, -harmonic.sin));
    }
}
