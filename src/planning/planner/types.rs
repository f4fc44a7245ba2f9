use crate::cor_library::{CoilResponse, Library};
use upm_core::coded_enum;
use upm_core::geometry::Vec2;
use upm_core::signal::{Drive, Follows, TwistWave};
use upm_core::units::mm_from_m;

/// State of one part as the planner sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartState {
    /// Position of its centre, m.
    pub position_m: Vec2,
    /// Displacement wanted in this cycle, m.
    pub step_m: Vec2,
    /// Radius of its outline, m.
    pub radius_m: f64,
    /// Ratio of measured to predicted distance of this part so far; 1 when nothing is known.
    pub gain: f64,
}

/// The longest step of any part, m.
pub(super) fn largest_step_m(parts: &[PartState]) -> f64 {
    parts.iter().map(|part| part.step_m.norm()).fold(0.0, f64::max)
}

coded_enum! {
    /// Method by which motions are found, with its name in a job file; the more promising ones come last.
    #[derive(Default)]
    pub enum PlanningMethod {
        /// The papers' plain method, for comparison: [`PseudoInverse`](super::PseudoInverse).
        PseudoInverse = "pseudo_inverse",
        /// Sequences of rotations: [`RotationPlanner`](super::RotationPlanner).
        #[default]
        CorSequence = "cor_sequence",
        /// One motion of many harmonics per cycle, synthesised for the steps wanted in it.
        SynthesizedField = "synthesized_field",
        /// Such motions one after another without a pause: [`MovingPlanner`](super::MovingPlanner).
        MovingField = "moving_field",
    }
}

/// Limits and wishes that the planner observes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlannerParams {
    /// Half the plate's side, m.
    pub half_side_m: f64,
    /// Distance of the motors' lines of action from the plate's centre, m.
    pub lever_arm_m: f64,
    /// Distance of a part's rim from the plate's edge, m; negative lets it overhang.
    pub edge_margin_m: f64,
    /// Gap kept between rims, m.
    pub separation_m: f64,
    /// Steps smaller than half of this are not worth a pulse, m.
    pub min_distance_m: f64,
    /// Time from one camera frame to the next, s: parts are seen at rest in the first whole frame after a pulse.
    pub frame_s: f64,
    /// Exposure time of the camera, s.
    pub exposure_s: f64,
    /// Longest sustain, s.
    pub max_sustain_s: f64,
}

impl PlannerParams {
    /// The status of a plan without pulses for `parts` that need none or whose numbers are none.
    pub(super) fn nothing_to_plan(&self, parts: &[PartState]) -> Option<PlanStatus> {
        let finite = |p: &PartState| {
            let numbers = [p.position_m.x, p.position_m.y, p.step_m.x, p.step_m.y, p.radius_m, p.gain];
            numbers.iter().all(|v| v.is_finite()) && p.gain > 0.0
        };
        if !parts.iter().all(finite) {
            return Some(PlanStatus::SolverFailed("a part's position is not finite".into()));
        }
        (largest_step_m(parts) < 0.5 * self.min_distance_m).then_some(PlanStatus::NothingToDo)
    }
}

/// One pulse of a plan.
#[derive(Clone, Debug, PartialEq)]
pub enum PlannedPulse {
    /// A rotation about one centre, out of the library.
    Rotation(Rotation),
    /// A synthesised motion that gives every part its own displacement at once.
    Field(FieldPulse),
}

impl PlannedPulse {
    /// The drive that plays the pulse on the library's rig; `None` where the library cannot drive it.
    pub fn drive(&self, library: &Library) -> Option<Drive> {
        match self {
            Self::Rotation(rotation) => library
                .drive_with_rest(rotation.entry, rotation.sustain_s, rotation.rest_s)
                .map(|drive| drive.scaled(rotation.amplitude.copysign(rotation.distance_m))),
            Self::Field(field) => library.field_drive(&field.wave, field.follows, field.sustain_s),
        }
    }

    /// The response of the plate to each coil in it; `None` where the library does not give it.
    pub fn coils(&self, library: &Library) -> Option<CoilResponse> {
        match self {
            Self::Rotation(_) => library.rotation_coils(),
            Self::Field(_) => library.field_coils(),
        }
    }
}

/// One rotation of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Rotation {
    /// Index into the library's entries.
    pub entry: usize,
    /// The rotation d_j, m: distance that it carries a part on the entry's typical belt; negative runs the drive in
    /// reverse.
    pub distance_m: f64,
    /// Fraction of the entry's full amplitude, 0 to 1.
    pub amplitude: f64,
    /// Time between attack and decay, s.
    pub sustain_s: f64,
    /// Rest after it, until all parts are forecast to be at rest, s.
    pub rest_s: f64,
}

impl Rotation {
    /// The rotation about the library's entry `entry` that carries the fastest of parts at `places_m` by `distance_m`.
    ///
    /// # Errors
    /// An entry or a distance that the library does not have: the allowed and the found one.
    pub fn carrying(library: &Library, entry: usize, distance_m: f64, places_m: &[Vec2]) -> Result<Self, String> {
        let last = library.entries.len().saturating_sub(1);
        let missing = || format!("entry: expected one of 0 to {last}, found {entry}");
        let found = library.entries.get(entry).ok_or_else(missing)?;
        let speed_mps = places_m.iter().map(|&place_m| found.speed_at(place_m)).fold(0.0, f64::max);
        let model = &library.displacement;
        let [least_mm, most_mm] = [model.min_distance(speed_mps), model.max_distance(speed_mps)].map(mm_from_m);
        let sustain_s = model.sustain_for(speed_mps, distance_m.abs()).ok_or_else(|| {
            format!("distance: expected {least_mm:.2} to {most_mm:.2} mm, either way, found {}", mm_from_m(distance_m))
        })?;
        Ok(Self { entry, distance_m, amplitude: 1.0, sustain_s, rest_s: library.rest_after(sustain_s) })
    }
}

/// One synthesised motion under an envelope (equation sheet, section 5).
#[derive(Clone, Debug, PartialEq)]
pub struct FieldPulse {
    /// The plate's velocity at full height.
    pub wave: TwistWave,
    /// The quantity that follows the envelope.
    pub follows: Follows,
    /// Time at full height, between attack and decay, s.
    pub sustain_s: f64,
}

/// A limit that shaped or stopped a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// Part `part` would leave the plate.
    Edge {
        /// Index of the part.
        part: usize,
    },
    /// Two parts would touch.
    Separation {
        /// Indices of the parts.
        parts: [usize; 2],
    },
    /// No motion of the library gives the wanted steps.
    Unreachable,
}

/// Outcome of planning.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum PlanStatus {
    /// The pulses bring the parts nearer to their subgoals; [`Plan::predicted_m`] has how near.
    Solved,
    /// All steps are smaller than the smallest pulse can make.
    #[default]
    NothingToDo,
    /// No plan within the limits; carries the limit that prevented it.
    Infeasible(Limit),
    /// The solver failed; carries its own message.
    SolverFailed(String),
}

/// Pulses for this cycle and their predicted effect.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Outcome of planning.
    pub status: PlanStatus,
    /// The sequence, first to last; empty unless solved.
    pub pulses: Vec<PlannedPulse>,
    /// Indices of library entries: that of each pulse of the whole sequence (rotations), or the centres used
    /// (pseudo-inverse); empty for fields.
    pub candidates: Vec<usize>,
    /// Predicted position of each part after each pulse, m: `predicted_m[pulse][part]`.
    pub predicted_m: Vec<Vec<Vec2>>,
    /// True when it continues a sequence begun in an earlier cycle: only its end need bring the parts nearer.
    pub continues: bool,
    /// The part that is predicted to leave its corridor most, and by how much, m; `None` where all keep it.
    pub corridor_excess: Option<(usize, f64)>,
}

impl From<PlanStatus> for Plan {
    /// A plan without pulses.
    fn from(status: PlanStatus) -> Self {
        Self { status, ..Self::default() }
    }
}
