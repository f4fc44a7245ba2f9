//! The computing time of a rehearsal, modelled: the clock would give equal jobs different rehearsals.

use upm_library::Library;
use upm_planner::{Method, Plan, PlannedPulse};

/// Planning and playing a synthesised field, for each group of parts and second of the pulse, ms on one core of the
/// reference machine: 24 parts take 2.7 ms a cycle, 8 take 1.1 ms, 3 with short pulses 0.3 ms.
const FIELD_MS: f64 = 3.5;
/// Parts that the field planner moves in one vector.
const GROUP: usize = 8;
/// Planning a cycle of rotations and playing it, ms, and the part that grows with the square of the number of parts: most
/// cycles correct a sequence, some plan a new one. 8 parts take 10 ms a cycle in the mean, 16 take 40 ms.
const CYCLE_MS: f64 = 2.5;
const SQUARE_MS: f64 = 0.15;
/// A look, ms.
pub(super) const LOOK_MS: f64 = 0.02;

/// Modelled time of one attempt at a plan for `parts` parts, and of playing it, ms. A plan without pulses has taken the
/// planner as long as one for the longest pulse.
pub(super) fn attempt_ms(library: &Library, method: Method, longest_s: f64, plan: &Plan, parts: usize) -> f64 {
    match method {
        Method::SynthesizedField => {
            let sustain_s = plan.pulses.iter().map(PlannedPulse::sustain_s).reduce(f64::max).unwrap_or(longest_s);
            let flanks_s = library.fields.as_ref().map_or(0.0, |fields| 2.0 * fields.attack_s);
            FIELD_MS * parts.div_ceil(GROUP) as f64 * (flanks_s + sustain_s)
        }
        Method::CorSequence | Method::PseudoInverse => CYCLE_MS + SQUARE_MS * (parts as f64).powi(2),
    }
}
