//! Narrowest corridor that parts can hold on a rig.

use super::job_file::PlannerChoice;
use super::rig::RigSpec;
use std::f64::consts::TAU;
use upm_core::document::{Diagnostics, Path};
use upm_core::units::{GRAVITY_MPS2, mm_from_m};

/// Error of a part's measured position, px, and scatter of its position after a pulse, m: as in `run/tolerance.rs`.
const SENSING_PX: f64 = 0.01;
const SCATTER_M: f64 = 0.035e-3;
/// Number of standard deviations of sensing and scatter that are allowed for.
const DEVIATIONS: f64 = 3.0;

/// Narrowest half width of a corridor for `parts` parts, m: a part's own sway, plus three standard deviations of
/// sensing and scatter. A shaken part is pulled one way by friction for half a period at most and sways by `μ g
/// T²/32`.
fn narrowest_m(rig: &RigSpec, parts: usize, planner: PlannerChoice) -> f64 {
    let fields = rig.model.fields.filter(|_| match planner {
        PlannerChoice::SynthesizedField => true,
        PlannerChoice::Auto => parts > 1,
        PlannerChoice::CorSequence | PlannerChoice::PseudoInverse => false,
    });
    let period_s = TAU / fields.map_or(rig.model.base_radps, |fields| fields.base_radps);
    let sway_m = rig.document.friction.coefficient * GRAVITY_MPS2 * period_s * period_s / 32.0;
    let sensing_m = SENSING_PX * rig.sim.camera.position_m.z / rig.sim.camera.lens.focal_px;
    sway_m + DEVIATIONS * sensing_m.hypot(SCATTER_M)
}

/// Reports a corridor of half width `corridor_mm` that is narrower than the parts can hold.
pub(super) fn check(
    corridor_mm: f64,
    rig: &RigSpec,
    (parts, planner): (usize, PlannerChoice),
    at: &Path,
    faults: &mut Diagnostics,
) {
    let narrowest_mm = (100.0 * mm_from_m(narrowest_m(rig, parts, planner))).ceil() / 100.0;
    let allowed = format!("{narrowest_mm:.2} or more: sway, sensing and scatter of a part on {}", rig.model.name);
    faults.require(corridor_mm > narrowest_mm - 1e-9, at, corridor_mm, allowed);
}
