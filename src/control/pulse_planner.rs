//! The planner of a run: finds the motions of a cycle and forecasts their effect.

use std::sync::Arc;

use super::params::ControlParams;
use super::run_end::RunEnd;
use upm_core::geometry::Vec2;
use upm_planning::cor_library::Library;
use upm_planning::planner::{
    Corridor, FieldPlanner, MovingPlanner, PartState, Plan, PlannedPulse, PlanningMethod, PseudoInverse,
    RotationPlanner,
};

/// A planner of one of the methods.
pub(super) enum PulsePlanner {
    Rotations(RotationPlanner),
    /// The papers' method, which knows the ideal field alone; the measured `flows` forecast the displacements of its
    /// rotations.
    PseudoInverse {
        planner: PseudoInverse,
        flows: RotationPlanner,
    },
    Fields(FieldPlanner),
    /// Motions without pauses.
    Moving(MovingPlanner),
}

impl PulsePlanner {
    /// The planner that `method` asks for, or the ending of a run whose library lacks what it needs.
    pub fn new(run: &ControlParams, library: &Arc<Library>) -> Result<Self, RunEnd> {
        let params = run.planner;
        let no_fields = || {
            let remedy = "take \"planner\": \"auto\" or \"cor_sequence\", or calibrate the rig with `fields`";
            RunEnd::failed(format!("the library has no response to synthesised fields: {remedy}"))
        };
        let rotations = || RotationPlanner::new(Arc::clone(library), params);
        match run.method {
            PlanningMethod::CorSequence => Ok(Self::Rotations(rotations())),
            PlanningMethod::PseudoInverse => {
                let planner = PseudoInverse::new(Arc::clone(library), params);
                Ok(Self::PseudoInverse { planner, flows: rotations() })
            }
            PlanningMethod::SynthesizedField => {
                FieldPlanner::new(library, params).map(Self::Fields).ok_or_else(no_fields)
            }
            PlanningMethod::MovingField => {
                let radii_m: Vec<f64> = (0..run.parts.len()).map(|part| run.radius_m(part)).collect();
                MovingPlanner::new(library, params, &radii_m).map(Self::Moving).ok_or_else(no_fields)
            }
        }
    }

    /// The pulses that make every part's step, within the corridors of those that have one.
    pub fn plan(&mut self, parts: &[PartState], corridors: &[Option<Corridor>]) -> Plan {
        match self {
            Self::Rotations(planner) => planner.plan(parts, corridors),
            Self::PseudoInverse { planner, .. } => planner.plan(parts),
            Self::Fields(planner) => planner.plan(parts, corridors),
            // its segments are planned for parts in motion
            Self::Moving(_) => Plan::default(),
        }
    }

    /// Bounds the displacement of a part in one sequence, m.
    pub fn limit_stride(&mut self, stride_m: Option<f64>) {
        if let Self::Rotations(planner) = self {
            planner.limit_stride(stride_m);
        }
    }

    /// True when it tries smaller steps itself where the whole ones are infeasible.
    pub fn tries_smaller(&self) -> bool {
        !matches!(self, Self::PseudoInverse { .. })
    }

    /// Forecast positions of `parts` after `pulse`, m; `None` for a pulse of a kind that it does not plan.
    pub fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>> {
        match (self, pulse) {
            (Self::Rotations(flows) | Self::PseudoInverse { flows, .. }, PlannedPulse::Rotation(rotation)) => {
                Some(flows.forecast(parts, rotation))
            }
            (Self::Fields(planner), PlannedPulse::Field(field)) => Some(planner.forecast(parts, field)),
            _ => None,
        }
    }
}
