//! The planner of a run: finds the motions of a cycle and forecasts their effect.

use std::sync::Arc;

use super::params::ControlParams;
use super::run_end::RunEnd;
use upm_core::geometry::Vec2;
use upm_planning::cor_library::Library;
use upm_planning::planner::{
    Corridor, FieldPlanner, MovingPlanner, PartState, Plan, PlanStatus, PlannedPulse, PlanningMethod, PseudoInverse,
    RotationPlanner,
};

/// A planner of the caller's, in the place of the run's own.
pub trait OwnPlanner: Send {
    /// The pulses of one cycle, in the order in which they are played, for parts at rest, each with the step that it
    /// should make; none where the parts should stay.
    ///
    /// # Errors
    /// The reason, for people. It ends the run.
    fn plan(&mut self, parts: &[PartState]) -> Result<Vec<PlannedPulse>, String>;
}

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
    /// The caller's; the others forecast its pulses.
    Own {
        planner: Box<dyn OwnPlanner>,
        flows: RotationPlanner,
        fields: Option<FieldPlanner>,
    },
}

impl PulsePlanner {
    /// The planner that `method` asks for, or the ending of a run whose library lacks what it needs.
    pub fn new(run: &ControlParams, library: &Arc<Library>, own: Option<Box<dyn OwnPlanner>>) -> Result<Self, RunEnd> {
        let params = run.planner;
        let no_fields = || {
            let remedy = "take \"planner\": \"auto\" or \"cor_sequence\", or calibrate the rig with `fields`";
            RunEnd::failed(format!("the library has no response to synthesised fields: {remedy}"))
        };
        let rotations = || RotationPlanner::new(Arc::clone(library), params);
        if let Some(planner) = own {
            return Ok(Self::Own { planner, flows: rotations(), fields: FieldPlanner::new(library, params) });
        }
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
            Self::Own { planner, .. } => match planner.plan(parts) {
                Ok(pulses) => self.forecast_plan(parts.to_vec(), pulses),
                Err(why) => PlanStatus::SolverFailed(why).into(),
            },
        }
    }

    /// The plan of these pulses, one after another.
    fn forecast_plan(&self, mut parts: Vec<PartState>, pulses: Vec<PlannedPulse>) -> Plan {
        let mut predicted_m = Vec::with_capacity(pulses.len());
        for pulse in &pulses {
            let places_m = self.forecast(&parts, pulse).unwrap_or_else(|| parts.iter().map(|p| p.position_m).collect());
            parts.iter_mut().zip(&places_m).for_each(|(part, place_m)| part.position_m = *place_m);
            predicted_m.push(places_m);
        }
        let status = if pulses.is_empty() { PlanStatus::NothingToDo } else { PlanStatus::Solved };
        Plan { status, pulses, predicted_m, ..Plan::default() }
    }

    /// Bounds the displacement of a part in one sequence, m.
    pub fn limit_stride(&mut self, stride_m: Option<f64>) {
        if let Self::Rotations(planner) = self {
            planner.limit_stride(stride_m);
        }
    }

    /// True when it tries smaller steps itself where the whole ones are infeasible.
    pub fn tries_smaller(&self) -> bool {
        !matches!(self, Self::PseudoInverse { .. } | Self::Own { .. })
    }

    /// Forecast positions of `parts` after `pulse`, m; `None` for a pulse of a kind that it does not plan.
    pub fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>> {
        match (self, pulse) {
            (
                Self::Rotations(flows) | Self::PseudoInverse { flows, .. } | Self::Own { flows, .. },
                PlannedPulse::Rotation(rotation),
            ) => Some(flows.forecast(parts, rotation)),
            (Self::Fields(planner) | Self::Own { fields: Some(planner), .. }, PlannedPulse::Field(field)) => {
                Some(planner.forecast(parts, field))
            }
            _ => None,
        }
    }
}
