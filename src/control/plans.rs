use std::sync::Arc;

use super::ending::Ending;
use upm_core::geometry::Vec2;
use upm_library::Library;
use upm_planner::{FieldPlanner, Method, PartState, Plan, PlannedPulse, PlannerParams, PseudoInverse, RotationPlanner};

/// Finds the motions of a cycle and says what they will do.
pub(super) trait Plans {
    /// The pulses that bring every part its step.
    fn plan(&mut self, parts: &[PartState]) -> Plan;

    /// True when it tries smaller steps itself where the whole ones are infeasible.
    fn tries_smaller(&self) -> bool {
        false
    }

    /// Where `parts` are forecast to be after `pulse`, m; `None` for a pulse of a kind that it does not plan.
    fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>>;
}

/// An unused planner, or the reason that the library has none. Several rehearsals share one: its tables take a few tenths
/// of a second.
pub struct FreshPlanner(Result<Kind, Ending>);

enum Kind {
    Rotations(RotationPlanner),
    Plain(Plain),
    Fields(FieldPlanner),
}

impl FreshPlanner {
    /// The one that `method` asks for; none where it cannot work with this library.
    pub fn new(method: Method, library: &Arc<Library>, params: PlannerParams) -> Self {
        let rotations = || RotationPlanner::new(Arc::clone(library), params);
        Self(match method {
            Method::CorSequence => Ok(Kind::Rotations(rotations())),
            Method::PseudoInverse => {
                let plain = PseudoInverse::new(Arc::clone(library), params);
                Ok(Kind::Plain(Plain { plain, flows: rotations() }))
            }
            Method::SynthesizedField => FieldPlanner::new(library, params).map(Kind::Fields).ok_or_else(|| {
                let remedy = "take \"planner\": \"auto\" or \"cor_sequence\", or calibrate the rig with `fields`";
                Ending::failed(format!("the library has no response to synthesised fields: {remedy}"))
            }),
        })
    }

    /// One to plan with; else the ending of a run that has none.
    pub(super) fn plans(&self) -> Result<Box<dyn Plans>, Ending> {
        match &self.0 {
            Ok(Kind::Rotations(planner)) => Ok(Box::new(planner.clone())),
            Ok(Kind::Plain(planner)) => Ok(Box::new(planner.clone())),
            Ok(Kind::Fields(planner)) => Ok(Box::new(planner.clone())),
            Err(ending) => Err(ending.clone()),
        }
    }
}

impl Plans for RotationPlanner {
    fn plan(&mut self, parts: &[PartState]) -> Plan {
        RotationPlanner::plan(self, parts)
    }

    fn tries_smaller(&self) -> bool {
        true
    }

    fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>> {
        match pulse {
            PlannedPulse::Rotation(rotation) => Some(RotationPlanner::forecast(self, parts, rotation)),
            PlannedPulse::Field(_) => None,
        }
    }
}

impl Plans for FieldPlanner {
    fn plan(&mut self, parts: &[PartState]) -> Plan {
        FieldPlanner::plan(self, parts)
    }

    fn tries_smaller(&self) -> bool {
        true
    }

    fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>> {
        match pulse {
            PlannedPulse::Rotation(_) => None,
            PlannedPulse::Field(field) => Some(FieldPlanner::forecast(self, parts, field)),
        }
    }
}

/// The papers' method, which knows the ideal field alone; what its rotations will do is told by the measured flows.
#[derive(Clone)]
struct Plain {
    plain: PseudoInverse,
    flows: RotationPlanner,
}

impl Plans for Plain {
    fn plan(&mut self, parts: &[PartState]) -> Plan {
        self.plain.plan(parts)
    }

    fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>> {
        Plans::forecast(&self.flows, parts, pulse)
    }
}
