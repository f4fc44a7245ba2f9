use upm_core::job::StopCause;
use upm_planning::planner::{Limit, PlanStatus, PlanningMethod};

/// A state of a run that may last over many cycles and that an operator should know about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// The whole steps of a cycle would take a part over the edge margin.
    StepsMeetEdge,
    /// The whole steps of a cycle would bring two parts closer than the gap they must keep.
    StepsMeetParts,
    /// No motion was found that moves every part that should move.
    StepsUnreachable,
    /// The planner's solver gave up.
    SolverFails,
    /// No path leads the part to its target past the other parts.
    PartBlocked {
        /// Index of the part.
        part: usize,
    },
    /// The part moves much less far than calibration predicts.
    PartSlow {
        /// Index of the part.
        part: usize,
    },
    /// The last lap took longer than its speed asks.
    LapLate,
    /// A part leaves the corridor along its path.
    CorridorLeft {
        /// Index of the part.
        part: usize,
    },
    /// The camera's frames show no table.
    TableMissing,
    /// The camera sends the same pictures again and again.
    CameraFrozen,
    /// Frame numbers or time stamps of the camera do not fit the present.
    CameraStale,
    /// The camera's frames show no plate: they are dark or garbage.
    CameraDark,
    /// The plate's place in the picture has changed: the camera or the plate was knocked.
    CameraMoved,
    /// The plate's motion in the pictures lags behind the drive.
    CameraLate,
    /// Something large hides part of the plate.
    ViewHidden,
    /// An object of a part's size lies on the plate that does not belong to the job.
    ForeignPart,
    /// Parts are where no motion since the last frame can have taken them.
    PartsJumped,
    /// A voice coil does not follow its signal.
    CoilFault {
        /// Index of the coil.
        coil: usize,
    },
    /// An accelerometer channel does not follow the plate's motion.
    AccelerometerFault {
        /// Index of the channel; `None` where the faulty one is unknown.
        channel: Option<usize>,
    },
    /// The plate does not move as planned.
    MotionOff,
    /// The part hardly moves although pulses should carry it.
    PartStuck {
        /// Index of the part.
        part: usize,
    },
    /// The part moves against the direction in which pulses should carry it.
    PartAstray {
        /// Index of the part.
        part: usize,
    },
}

impl Condition {
    /// A stable name for programs.
    pub fn code(self) -> &'static str {
        match self {
            Self::StepsMeetEdge => "steps_meet_edge",
            Self::StepsMeetParts => "steps_meet_parts",
            Self::StepsUnreachable => "steps_unreachable",
            Self::SolverFails => "solver_fails",
            Self::PartBlocked { .. } => "part_blocked",
            Self::PartSlow { .. } => "part_slow",
            Self::LapLate => "lap_late",
            Self::CorridorLeft { .. } => "corridor_left",
            guard => guard.stop_cause().map_or("", StopCause::code),
        }
    }

    /// True for a finding of a guard: rig or scene are not as they should be.
    pub fn is_guard(self) -> bool {
        self.stop_cause().is_some()
    }

    /// The cause with which this condition ends a run; `None` for one that ends no run.
    pub fn stop_cause(self) -> Option<StopCause> {
        Some(match self {
            Self::TableMissing => StopCause::TableMissing,
            Self::CameraFrozen => StopCause::CameraFrozen,
            Self::CameraStale => StopCause::CameraStale,
            Self::CameraDark => StopCause::CameraDark,
            Self::CameraMoved => StopCause::CameraMoved,
            Self::CameraLate => StopCause::CameraLate,
            Self::ViewHidden => StopCause::ViewHidden,
            Self::ForeignPart => StopCause::ForeignPart,
            Self::PartsJumped => StopCause::PartsJumped,
            Self::CoilFault { .. } => StopCause::CoilFault,
            Self::AccelerometerFault { .. } => StopCause::AccelerometerFault,
            Self::MotionOff => StopCause::MotionOff,
            Self::PartStuck { .. } => StopCause::PartStuck,
            Self::PartAstray { .. } => StopCause::PartAstray,
            Self::StepsMeetEdge
            | Self::StepsMeetParts
            | Self::StepsUnreachable
            | Self::SolverFails
            | Self::PartBlocked { .. }
            | Self::PartSlow { .. }
            | Self::LapLate
            | Self::CorridorLeft { .. } => return None,
        })
    }

    /// The condition behind a plan without pulses; `None` for a plan that can be played.
    pub(super) fn of_plan(status: &PlanStatus) -> Option<Self> {
        match status {
            PlanStatus::Solved | PlanStatus::NothingToDo => None,
            PlanStatus::Infeasible(Limit::Edge { .. }) => Some(Self::StepsMeetEdge),
            PlanStatus::Infeasible(Limit::Separation { .. }) => Some(Self::StepsMeetParts),
            PlanStatus::Infeasible(Limit::Unreachable) => Some(Self::StepsUnreachable),
            PlanStatus::SolverFailed(_) => Some(Self::SolverFails),
        }
    }

    /// The remedy, for people: a change they can make to the job or the rig.
    pub fn remedy(self) -> &'static str {
        match self {
            Self::StepsMeetEdge => "targets farther from the edge help",
            Self::StepsMeetParts => "more room between the targets helps, or another order of arrival",
            Self::StepsUnreachable => {
                "check the library's coverage with `upm check LIBRARY.json`, or take another planner"
            }
            Self::SolverFails => "check the library with `upm check LIBRARY.json`, or take another planner",
            Self::PartBlocked { .. } => "it waits until the others have moved; if they never do, change the targets",
            Self::PartSlow { .. } => "clean the part and the plate under it, or calibrate again if every part is slow",
            Self::LapLate => "`upm check --plan` gives the speed that can be held",
            Self::CorridorLeft { .. } => "a slower speed or a wider `corridor_mm` helps",
            guard => guard.stop_cause().and_then(StopCause::remedy).unwrap_or_default(),
        }
    }
}

/// The reason, for people, that a plan has no pulses. `id` names a part.
pub(super) fn no_plan_reason<'a>(status: &PlanStatus, method: PlanningMethod, id: impl Fn(usize) -> &'a str) -> String {
    match (status, method) {
        (PlanStatus::Solved, _) => "it has pulses".into(),
        (PlanStatus::NothingToDo, _) => "every step is shorter than the shortest pulse".into(),
        (PlanStatus::Infeasible(Limit::Edge { part }), _) => format!("{} would cross the edge margin", id(*part)),
        (PlanStatus::Infeasible(Limit::Separation { parts: [a, b] }), _) => {
            format!("{} and {} would come too close to each other", id(*a), id(*b))
        }
        (PlanStatus::Infeasible(Limit::Unreachable), PlanningMethod::SynthesizedField) => {
            "no motion was found that brings the parts closer to their places".into()
        }
        (PlanStatus::Infeasible(Limit::Unreachable), PlanningMethod::CorSequence | PlanningMethod::PseudoInverse) => {
            "no motion of the library moves every part that should move".into()
        }
        (PlanStatus::SolverFailed(why), _) => format!("the solver gave up ({why})"),
    }
}

/// Begin or end of a condition.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConditionChange {
    /// It began in this cycle.
    Began,
    /// It no longer holds, or the run has ended.
    Ended {
        /// Number of cycles in which it held.
        times: u64,
        /// Plate time from its beginning to the last cycle in which it held, s.
        lasted_s: f64,
    },
}
