//! A job file as a person writes it. Fields are SI; their comments, which the schema prints, have the file's units.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::faults::MOST_FAULTS;
use super::read::{NAME_PATTERN, optional_mm_point, optional_mm_points};
use super::rig_file::RigSource;
use super::shape_file::{CircleShape, LissajousShape, SvgShape, TargetRule};
use upm_core::document::Path;
use upm_core::geometry::Vec2;
use upm_core::job::Bin;
use upm_core::units::{micrometres, mm, whole};
use upm_planning::cor_library::Library;
use upm_recording::FaultEntry;

/// A job: which rig, which parts, and what to do with them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "job")]
pub struct JobFile {
    /// Name of the job and of its run folder: letters of any script, digits, `.`, `_` and `-`, not first `.` or `-`.
    #[schemars(length(min = 1, max = 64), extend("pattern" = NAME_PATTERN))]
    pub(crate) name: String,
    /// Seed of everything random.
    #[serde(default = "whole::<u64, 1>")]
    #[schemars(range(max = u64::MAX))]
    pub seed: u64,
    /// The rig: a path relative to this file, or the object itself. A job sent to a daemon may leave it out.
    pub rig: Option<RigSource>,
    /// The daemon's plate to run on; means nothing elsewhere.
    #[schemars(length(min = 1, max = 64))]
    pub plate: Option<String>,
    /// COR library in place of the rig's: a path relative to this file, or the object itself.
    pub(crate) library: Option<LibraryRef>,
    /// Parts on the plate.
    #[schemars(length(min = 1, max = 64))]
    pub(crate) parts: Vec<PartsEntry>,
    /// Goal of the run. Either this or `tasks`.
    pub(crate) task: Option<TaskSection>,
    /// Goals one after another: each begins where the one before has ended. A `hold` between two is a pause.
    #[schemars(length(min = 1, max = 32))]
    pub(crate) tasks: Option<Vec<TaskSection>>,
    /// How often `tasks` are gone through; 0 is without end.
    #[serde(default = "whole::<u32, 1>")]
    #[schemars(range(max = 1_000_000))]
    pub(crate) repeat: u32,
    /// How motions are found.
    #[serde(default)]
    pub(crate) planner: PlannerChoice,
    /// A part this near its target has arrived, mm.
    #[serde(rename = "tolerance_mm", default = "micrometres::<500>", with = "mm")]
    #[schemars(with = "f64", range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub(crate) tolerance_m: f64,
    /// When to give up.
    #[serde(default)]
    pub(crate) limits: RunLimits,
    /// Faults of the simulated rig, to see what a run makes of them. A daemon takes them only where its file allows it.
    #[schemars(length(max = MOST_FAULTS))]
    pub(crate) faults: Option<Vec<FaultEntry>>,
    /// False alarms that guards may give in 1,000 h of plate time of a healthy rig, all together: more find a fault
    /// sooner.
    #[serde(default = "whole::<f64, 1>")]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub(crate) false_alarms_per_1000_h: f64,
    /// Policy for a computer that is too slow for the plate.
    #[serde(default)]
    pub(crate) deadlines: DeadlinePolicy,
}

impl JobFile {
    /// The tasks with their paths in the file.
    pub(super) fn each_task(&self) -> Vec<(Path, &TaskSection)> {
        let tasks = self.tasks.iter().flatten().enumerate();
        let listed = tasks.map(|(i, task)| (Path::root().key("tasks").index(i), task));
        self.task.iter().map(|task| (Path::root().key("task"), task)).chain(listed).collect()
    }
}

/// A COR library named by its file or written out; the library room reads the object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum LibraryRef {
    /// Path of a library file, relative to the file it stands in.
    #[schemars(title = "path")]
    File(PathBuf),
    /// The library itself.
    #[schemars(title = "library")]
    Inline(#[schemars(with = "Library")] Value),
}

/// Parts of one kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct PartsEntry {
    /// penny, nickel, dime, quarter or a kind of the rig's.
    pub(crate) kind: String,
    /// How many.
    #[serde(default = "whole::<u32, 1>")]
    #[schemars(range(min = 1, max = 64))]
    pub(crate) count: u32,
    /// Name of the part in tasks, findings and reports; only with count 1. Left out: kind and number, as `penny-2`.
    #[schemars(length(min = 1, max = 64), extend("pattern" = NAME_PATTERN))]
    pub(crate) name: Option<String>,
    /// Where it starts, mm; only with count 1. Left out: at random, by the seed.
    #[serde(rename = "position_mm", default, with = "optional_mm_point")]
    #[schemars(with = "Option<[f64; 2]>", skip_serializing_if = "Option::is_none")]
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub(crate) position_m: Option<Vec2>,
}

/// Goal of a run; `type` selects the kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(crate) enum TaskSection {
    /// One part goes to the centre, then along the branches of a plus sign, clockwise, out and back.
    PlusSign {
        /// Rounds over all four branches; 0 is without end.
        #[serde(default = "whole::<u32, 1>")]
        #[schemars(range(max = 1_000_000))]
        laps: u32,
        /// How far the part's rim stays from the plate's edge, mm.
        #[serde(rename = "edge_margin_mm", default = "micrometres::<5000>", with = "mm")]
        #[schemars(with = "f64", range(min = 1.0, max = 1000.0))]
        edge_margin_m: f64,
        /// Largest distance from the path, mm, for the whole course of every pulse.
        #[serde(rename = "corridor_mm", default = "micrometres::<500>", with = "mm")]
        #[schemars(with = "f64", range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
        corridor_m: f64,
    },
    /// Every part follows its own path.
    Trajectories {
        /// One path for each part, in the order of the job's `parts`; a path with a `count` is for that many. Where the
        /// paths name their `parts`, the others stay where they are, and make room where they lie on a path.
        #[schemars(length(min = 1, max = 64))]
        paths: Vec<PathEntry>,
        /// The parts hold their phase to each other: all are at the same share of their laps at any time. Asks for
        /// laps that take equal times (length over speed, within 1 %) and for equal repeats.
        #[serde(default)]
        in_phase: bool,
        /// Largest distance from the paths, mm, for the whole course of every pulse.
        #[serde(rename = "corridor_mm", default = "micrometres::<1000>", with = "mm")]
        #[schemars(with = "f64", range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
        corridor_m: f64,
    },
    /// Every part goes to a place.
    Arrange {
        /// The parts that go to the places, by name; the others stay where they are, and make room where they lie on
        /// one. Left out: all.
        #[schemars(length(min = 1, max = 64))]
        parts: Option<Vec<String>>,
        /// One place for each part, in the order of `parts`, mm. Either this or `targets`.
        #[serde(rename = "targets_mm", default, with = "optional_mm_points")]
        #[schemars(with = "Option<Vec<[f64; 2]>>", skip_serializing_if = "Option::is_none")]
        #[schemars(length(min = 1, max = 64), inner(inner(range(min = -1000.0, max = 1000.0))))]
        targets_m: Option<Vec<Vec2>>,
        /// A rule that makes the places.
        targets: Option<Box<TargetRule>>,
        /// Assignment of parts to places. Left out: optimal, or fixed where `parts` are named.
        assignment: Option<Assignment>,
    },
    /// Every part goes into its kind's bin.
    Sort {
        /// Rectangles for the kinds, 1 to 16.
        #[schemars(length(min = 1, max = 16))]
        bins: Vec<Bin>,
    },
    /// Every part stays where it is.
    Hold {
        /// How long, s; 0 or left out: without end. A hold that lasts as long as the plate time limit, or longer, ends
        /// at the limit, completed.
        #[serde(default)]
        #[schemars(range(min = 0.0, max = 1e6))]
        duration_s: f64,
    },
}

/// A path, with exactly one of `waypoints_mm`, `circle`, `lissajous` and `svg`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct PathEntry {
    /// Corners of the path, mm, in order.
    #[serde(rename = "waypoints_mm", default, with = "optional_mm_points")]
    #[schemars(with = "Option<Vec<[f64; 2]>>", skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 1000), inner(inner(range(min = -1000.0, max = 1000.0))))]
    pub(crate) waypoints_m: Option<Vec<Vec2>>,
    /// All round a circle.
    pub(crate) circle: Option<CircleShape>,
    /// All round a closed figure of two sine waves.
    pub(crate) lissajous: Option<LissajousShape>,
    /// Along the one line of an SVG drawing.
    pub(crate) svg: Option<SvgShape>,
    /// Parts that follow this path, evenly spaced round it. With more than one, the line back from its last point to
    /// the first is a part of it, and parts of one kind may exchange their paths and first points.
    #[serde(default = "whole::<u32, 1>")]
    #[schemars(range(min = 1, max = 64))]
    pub(crate) count: u32,
    /// The parts that follow it, by name, in place of `count`: on every path or on none.
    #[schemars(length(min = 1, max = 64))]
    pub(crate) parts: Option<Vec<String>>,
    /// Speed along it, mm/s.
    #[serde(rename = "speed_mm_s", with = "mm")]
    #[schemars(with = "f64", range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub(crate) speed_mps: f64,
    /// How often it is gone through, from its last point straight back to the first; 0 is without end.
    #[serde(default = "whole::<u32, 1>")]
    #[schemars(range(max = 1_000_000))]
    pub(crate) repeat: u32,
}

impl PathEntry {
    /// Number of parts that follow it.
    pub(super) fn parts_on_it(&self) -> usize {
        self.parts.as_ref().map_or(self.count as usize, Vec::len)
    }
}

/// Assignment of parts to places.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Assignment {
    /// Parts of one kind may exchange their targets.
    #[default]
    Optimal,
    /// Each part has its own target.
    Fixed,
}

/// How motions are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlannerChoice {
    /// The planner that suits rig and task: where the rig has `fields`, `moving_field` for `arrange` and `sort`, and
    /// `synthesized_field` for other jobs of two parts or more; else `cor_sequence`.
    #[default]
    Auto,
    /// Rotations about measured centres, one after another. Works on every rig that has a library.
    CorSequence,
    /// One motion of many harmonics a cycle, which moves every part its own step at once. Asks for a rig with `fields`;
    /// much faster than rotations with several parts.
    SynthesizedField,
    /// Such motions one after another without a pause: the parts keep the speed that they have won. For `arrange`,
    /// `sort` and `trajectories` on a rig with `fields`.
    MovingField,
    /// The papers' plain method, for comparison: fixed centres, the ideal field, the pseudo-inverse.
    PseudoInverse,
}

/// Policy for a computer that is too slow for the plate. It changes no journal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DeadlinePolicy {
    /// The simulated plate waits: its time falls behind the clock, and the run goes on.
    #[default]
    Relaxed,
    /// The run is stopped by the drive lease, as it must be on real hardware.
    Strict,
}

/// When to give up; tasks without end are completed then.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct RunLimits {
    /// Longest plate time of the run, s.
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub(crate) plate_time_s: f64,
}

impl Default for RunLimits {
    fn default() -> Self {
        Self { plate_time_s: 600.0 }
    }
}
