//! Friction of the calibration's coins, derived from the measured distances.

use super::pump::{Discs, LANES, Pump};
use crate::cor_library::Library;

/// Range in which friction is searched.
const RANGE: (f64, f64) = (0.02, 2.0);
/// Iterations, each of which shrinks the range to one ninth.
const ROUNDS: usize = 9;

/// The Coulomb friction that reproduces the measured distances of translations: median over the faster half of the
/// table's speeds and the middle of its sustains. `None` where nothing moved.
pub(crate) fn friction_of(library: &Library) -> Option<f64> {
    let model = &library.displacement;
    let (speeds, sustains) = (model.speed_mps.len(), model.sustain_s.len());
    let pump = Pump::of(library);
    let mut found = Vec::new();
    for row in speeds / 2..speeds {
        for column in [sustains / 3, sustains / 2, 2 * sustains / 3] {
            let (&speed_mps, &sustain_s) = (model.speed_mps.get(row)?, model.sustain_s.get(column)?);
            // the pump's table holds whole sustain steps only
            let steps = (sustain_s / pump.sustain_step_s()).round() as usize;
            let distance_m = model.distance(speed_mps, steps as f64 * pump.sustain_step_s());
            found.extend(friction_that_goes(&pump, speed_mps, steps, distance_m));
        }
    }
    // the median, because few coins were measured at the fastest speeds
    found.sort_by(f64::total_cmp);
    found.get(found.len() / 2).copied()
}

/// The friction at which a belt of `speed_mps` carries a point by `distance_m` in a pulse of this many sustain steps.
fn friction_that_goes(pump: &Pump, speed_mps: f64, steps: usize, distance_m: f64) -> Option<f64> {
    let course = pump.course(steps);
    let travels_m = |friction: [f64; LANES]| {
        let discs = Discs { speed_mps: [speed_mps; LANES], spin_radps: [0.0; LANES], friction, radius_m: 0.0 };
        pump.travel(&discs, &course).map(|travel| travel.along_m)
    };
    let (mut low, mut high) = RANGE;
    let ends_m = travels_m(std::array::from_fn(|i| if i == 0 { low } else { high }));
    if !(distance_m > 0.0 && ends_m[0] < distance_m && ends_m[1] > distance_m) {
        return None;
    }
    for _ in 0..ROUNDS {
        let tried: [f64; LANES] = std::array::from_fn(|i| low + (high - low) * (i + 1) as f64 / (LANES + 1) as f64);
        let below = travels_m(tried).iter().take_while(|&&end_m| end_m < distance_m).count();
        (low, high) =
            (if below == 0 { low } else { tried[below - 1] }, if below == LANES { high } else { tried[below] });
        if high - low < 1e-6 {
            break;
        }
    }
    Some(0.5 * (low + high))
}
