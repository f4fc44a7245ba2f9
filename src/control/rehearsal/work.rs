//! The computing time of a rehearsal, modelled: the clock would give equal jobs different rehearsals.

use upm_library::Library;
use upm_planner::{Plan, PlannedPulse};

/// Planning and playing a synthesised field, for each group of parts and second of the pulse, ms on one core of the
/// reference machine: 24 parts take 2.7 ms a cycle, 8 take 1.1 ms, 3 with short pulses 0.3 ms.
const FIELD_MS: f64 = 3.5;
/// Parts that the field planner moves in one vector.
const GROUP: usize = 8;
/// Planning rotations, ms a plan, and playing one, ms a pulse and part.
const SEQUENCE_MS: f64 = 0.2;
const ROTATION_MS: f64 = 0.02;
/// A cycle without a pulse, ms.
const IDLE_MS: f64 = 0.02;

/// Modelled time of a cycle with `plan` for `parts` parts, ms.
pub(super) fn cycle_ms(library: &Library, plan: &Plan, parts: usize) -> f64 {
    let sounding_s = |sustain_s: f64| library.fields.as_ref().map_or(0.0, |f| 2.0 * f.attack_s) + sustain_s;
    let rotations = plan.pulses.iter().filter(|pulse| matches!(pulse, PlannedPulse::Rotation(_))).count();
    let fields = plan.pulses.iter().filter_map(|pulse| match pulse {
        PlannedPulse::Field(field) => Some(FIELD_MS * parts.div_ceil(GROUP) as f64 * sounding_s(field.sustain_s)),
        PlannedPulse::Rotation(_) => None,
    });
    let sequence_ms = if rotations > 0 { SEQUENCE_MS } else { 0.0 };
    IDLE_MS + fields.sum::<f64>() + sequence_ms + ROTATION_MS * (rotations * parts) as f64
}
