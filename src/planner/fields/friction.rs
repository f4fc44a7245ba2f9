//! The friction of the calibration's coins, out of how far they went.

use upm_core::geometry::Vec2;
use upm_core::signal::Envelope;
use upm_library::Library;

use super::course::{Course, Disc};
use super::waves::Waves;

/// Friction is looked for between these.
const RANGE: (f64, f64) = (0.02, 2.0);
/// Frictions that are tried at once, and how often: each time the range shrinks to a ninth, in the end to a millionth.
const TRIED: usize = 8;
const ROUNDS: usize = 6;

/// The Coulomb friction with which coins would have gone as far as was measured in translations: mean over the faster half
/// of the table's speeds and the middle of its sustains. `None` where nothing moved.
pub(super) fn friction_of(library: &Library) -> Option<f64> {
    let model = &library.displacement;
    let (speeds, sustains) = (model.speed_mps.len(), model.sustain_s.len());
    let waves = Waves::new(library.base_radps, 2, 1.0);
    let mut found = Vec::new();
    for row in speeds / 2..speeds {
        for column in [sustains / 3, sustains / 2, 2 * sustains / 3] {
            let (&speed_mps, &sustain_s) = (model.speed_mps.get(row)?, model.sustain_s.get(column)?);
            let distance_m = *model.distance_m.get(row)?.get(column)?;
            let envelope = Envelope { attack_s: library.attack_s, sustain_s, rest_s: 0.0 };
            found.extend(friction_that_goes(&waves, speed_mps, &envelope, distance_m));
        }
    }
    if found.is_empty() { None } else { Some(found.iter().sum::<f64>() / found.len() as f64) }
}

/// The friction at which the pump `A (sin wt + ½ cos 2wt)`, as the library's waveforms play it, with A = `speed_mps`, carries a
/// point by `distance_m`. The phase at the start counts: it makes up to a fifth of the distance.
fn friction_that_goes(waves: &Waves, speed_mps: f64, envelope: &Envelope, distance_m: f64) -> Option<f64> {
    let mut coefficients = vec![0.0; waves.len()];
    (coefficients[1], coefficients[2]) = (speed_mps, 0.5 * speed_mps);
    let mut course = Course::default();
    let mut go_m = |frictions: [f64; TRIED]| -> Vec<f64> {
        let discs = frictions.map(|friction| Disc { position_m: Vec2::zeros(), radius_m: 0.0, friction });
        course.run(waves, &coefficients, envelope, &discs);
        course.ends_m.iter().map(|end| end.x).collect()
    };
    let (mut low, mut high) = RANGE;
    let ends_m = go_m(std::array::from_fn(|i| if i == 0 { low } else { high }));
    if !(distance_m > 0.0 && ends_m[0] < distance_m && ends_m[1] > distance_m) {
        return None;
    }
    for _ in 0..ROUNDS {
        let tried = std::array::from_fn(|i| low + (high - low) * (i + 1) as f64 / (TRIED + 1) as f64);
        let below = go_m(tried).iter().take_while(|&&end_m| end_m < distance_m).count();
        (low, high) =
            (if below == 0 { low } else { tried[below - 1] }, if below == TRIED { high } else { tried[below] });
    }
    Some(0.5 * (low + high))
}
