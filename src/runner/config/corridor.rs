//! Narrowest corridor that parts can hold on a rig.

use super::job_file::PlannerChoice;
use super::rig::RigSpec;
use std::f64::consts::TAU;
use upm_core::document::{Diagnostics, Path};
use upm_core::units::{GRAVITY_MPS2, mm_from_m};
use upm_sim::CameraParams;

/// Error of a part's measured place at rest, px: 2.9 to 3.1 µm rms at 0.35 mm/px in runs on `upm-2`, its camera's noise
/// and lens included.
const SENSING_PX: f64 = 0.01;
/// Scatter of a part along one axis after a synthesised field, m; the library has no such figure. In runs on `upm-2`
/// parts end 0.05 mm off at random in both axes together.
pub(crate) const FIELD_SCATTER_M: f64 = 0.035e-3;
/// Number of standard deviations of sensing and scatter that are allowed for.
const DEVIATIONS: f64 = 3.0;

/// Three standard deviations of a part's measured place under `camera` and its scatter along one axis, m.
pub(crate) fn accuracy_m(camera: &CameraParams, scatter_m: f64) -> f64 {
    DEVIATIONS * (SENSING_PX * camera.position_m.z / camera.focal_px).hypot(scatter_m)
}

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
    sway_m + accuracy_m(&rig.sim.camera, FIELD_SCATTER_M)
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
