use std::sync::Arc;

use super::run_end::RunEnd;
use upm_cor_library::Library;
use upm_core::geometry::Vec2;
use upm_planner::{
    Corridor, FieldPlanner, PartState, Plan, PlannedPulse, PlannerParams, PlanningMethod, PseudoInverse,
    RotationPlanner,
};

/// A planner: finds the motions of a cycle and forecasts their effect.
pub(super) trait PulsePlanner {
    /// The pulses that make every part's step, within the corridors of those that have one.
    fn plan(&mut self, parts: &[PartState], corridors: &[Option<Corridor>]) -> Plan;

    /// True when it tries smaller steps itself where the whole ones are infeasible.
    fn tries_smaller(&self) -> bool {
        false
    }

    /// Bounds the displacement of a part in one sequence, m.
    fn limit_stride(&mut self, _stride_m: Option<f64>) {}

    /// Forecast positions of `parts` after `pulse`, m; `None` for a pulse of a kind that it does not plan.
    fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>>;
}

/// An unused planner, or the reason that the library has none. Several dry runs share one because its tables take a
/// few tenths of a second.
pub struct FreshPlanner(Result<AnyPlanner, RunEnd>);

#[derive(Clone)]
enum AnyPlanner {
    Rotations(RotationPlanner),
    /// The papers' method, which knows the ideal field alone; the measured `flows` forecast the displacements of its
    /// rotations.
    PseudoInverse {
        planner: PseudoInverse,
        flows: RotationPlanner,
    },
    Fields(FieldPlanner),
}

impl FreshPlanner {
    /// The planner that `method` asks for, or the reason that it cannot work with this library.
    pub fn new(method: PlanningMethod, library: &Arc<Library>, params: PlannerParams) -> Self {
        let rotations = || RotationPlanner::new(Arc::clone(library), params);
        Self(match method {
            PlanningMethod::CorSequence => Ok(AnyPlanner::Rotations(rotations())),
            PlanningMethod::PseudoInverse => {
                let planner = PseudoInverse::new(Arc::clone(library), params);
                Ok(AnyPlanner::PseudoInverse { planner, flows: rotations() })
            }
            PlanningMethod::SynthesizedField => {
                FieldPlanner::new(library, params).map(AnyPlanner::Fields).ok_or_else(|| {
                    let remedy = "take \"planner\": \"auto\" or \"cor_sequence\", or calibrate the rig with `fields`";
                    RunEnd::failed(format!("the library has no response to synthesised fields: {remedy}"))
                })
            }
        })
    }

    /// A planner, or the ending of a run without one.
    pub(super) fn plans(&self) -> Result<Box<dyn PulsePlanner>, RunEnd> {
        self.0.clone().map(|planner| Box::new(planner) as Box<dyn PulsePlanner>)
    }
}

impl PulsePlanner for AnyPlanner {
    fn plan(&mut self, parts: &[PartState], corridors: &[Option<Corridor>]) -> Plan {
        match self {
            Self::Rotations(planner) => planner.plan(parts, corridors),
            Self::PseudoInverse { planner, .. } => planner.plan(parts),
            Self::Fields(planner) => planner.plan(parts, corridors),
        }
    }

    fn limit_stride(&mut self, stride_m: Option<f64>) {
        if let Self::Rotations(planner) = self {
            planner.limit_stride(stride_m);
        }
    }

    fn tries_smaller(&self) -> bool {
        !matches!(self, Self::PseudoInverse { .. })
    }

    fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>> {
        match (self, pulse) {
            (Self::Rotations(flows) | Self::PseudoInverse { flows, .. }, PlannedPulse::Rotation(rotation)) => {
                Some(flows.forecast(parts, rotation))
            }
            (Self::Fields(planner), PlannedPulse::Field(field)) => Some(planner.forecast(parts, field)),
            _ => None,
        }
    }
}
