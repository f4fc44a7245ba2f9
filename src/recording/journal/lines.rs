//! The lines of the journal as serialised by serde.

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde::Serialize;
use serde_json::Value;

use super::fixed::{Fixed, Mm, PointMm, Seconds, fixed_pair, mm, point_mm, seconds};
use crate::motion::MotionRecord;
use crate::wave::off_part;
use upm_control::PulseFacts;
use upm_core::job::{EventLevel, Outcome, RunnerUp, StopCause};
use upm_core::signal::{Harmonic, MOTORS, TwistWave};
use upm_perception::estimation::PlateFit;
use upm_planning::cor_library::Library;
use upm_planning::planner::{Limit, Plan, PlanStatus, PlannedPulse};

/// Code of the event of a recording that ended early.
pub const RECORDING_FAILED: &str = "recording_failed";

/// A line of `journal.jsonl`. Lengths are millimetres in the table frame, times seconds of plate time; null replaces a
/// number that is not finite.
#[derive(Serialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(super) enum JournalLine<'a> {
    /// Table and parts located without prior knowledge.
    Localised {
        at_s: Seconds,
        corners_px: [[Fixed<3>; 2]; 4],
        side_px: Fixed<3>,
        rotation_deg: Fixed<4>,
        parts: Vec<FoundPart>,
    },
    /// The same at the places where they were tracked, before a task counts as completed.
    Confirmed { at_s: Seconds, corner_px: Fixed<3>, part_mm: Mm, parts_mm: Vec<PointMm> },
    /// A cycle: observed, wanted, planned, sent, read back, predicted and measured.
    Cycle {
        /// From 0.
        cycle: u64,
        /// Time of the observation that the plan is based on.
        observed_at_s: Seconds,
        /// A point for each part, in the order of the job.
        observed_mm: Vec<PointMm>,
        wanted: WantedPart<'a>,
        plan: PlanPart<'a>,
        sent: &'a [SentLine],
        /// Predicted positions at the end of the plan; null without a plan.
        predicted_mm: Option<Vec<PointMm>>,
        /// Time of the next observation.
        ended_at_s: Seconds,
        result_mm: Vec<PointMm>,
    },
    /// Pulses of a cycle that never ended.
    UnfinishedCycle { cycle: u64, sent: &'a [SentLine] },
    /// Something worth a line, a condition that began or ended, or the end of the run.
    Event {
        at_s: Seconds,
        level: EventLevel,
        text: &'a str,
        #[serde(flatten)]
        detail: Option<DetailPart<'a>>,
    },
}

/// The JSON Schema (draft 2020-12) of one line of `journal.jsonl`.
pub fn journal_schema() -> Value {
    // a schema for serialisation: nothing reads a line back into these types
    let generator = SchemaSettings::draft2020_12().for_serialize().into_generator();
    generator.into_root_schema_for::<JournalLine<'static>>().to_value()
}

#[derive(Serialize, JsonSchema)]
pub(super) struct FoundPart {
    pub kind: usize,
    pub center_px: [Fixed<3>; 2],
    pub radius_px: Fixed<3>,
    pub position_mm: PointMm,
    pub score: Fixed<4>,
}

#[derive(Serialize, JsonSchema)]
pub(super) struct WantedPart<'a> {
    pub phase: &'a str,
    /// From 0 to 1.
    pub progress: Fixed<6>,
    pub laps: u32,
    pub subgoals_mm: Vec<PointMm>,
    pub targets_mm: Vec<PointMm>,
    pub cross_track_mm: Vec<Mm>,
}

#[derive(Serialize, JsonSchema)]
pub(super) struct PlanPart<'a> {
    #[serde(flatten)]
    pub status: StatusPart<'a>,
    pub candidates: usize,
    /// True for the rest of a sequence that an earlier cycle began.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub continues: bool,
    pub pulses: Vec<PlannedPart>,
}

#[derive(Serialize, JsonSchema)]
#[serde(tag = "status", rename_all = "snake_case")]
pub(super) enum StatusPart<'a> {
    Solved,
    NothingToDo,
    Infeasible { limit: &'static str, limited_parts: Vec<usize> },
    SolverFailed { reason: &'a str },
}

#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
pub(super) enum PlannedPart {
    Rotation {
        entry: usize,
        #[serde(flatten)]
        motion: Option<MotionPart>,
        d_mm: Mm,
        amplitude: Fixed<4>,
        sustain_s: Seconds,
    },
    Field {
        base_hz: Fixed<4>,
        harmonics: Vec<HarmonicPart>,
        sustain_s: Seconds,
    },
}

impl PlannedPart {
    pub fn new(pulse: &PlannedPulse, library: &Library) -> Self {
        match pulse {
            PlannedPulse::Rotation(rotation) => {
                let entry = library.entries.get(rotation.entry);
                Self::Rotation {
                    entry: rotation.entry,
                    motion: entry.and_then(|entry| MotionRecord::of(&entry.pump)).map(MotionPart::new),
                    d_mm: mm(rotation.distance_m),
                    amplitude: Fixed(rotation.amplitude),
                    sustain_s: Fixed(rotation.sustain_s),
                }
            }
            PlannedPulse::Field(field) => Self::Field {
                base_hz: hz(field.wave.base_radps),
                harmonics: harmonics(&field.wave),
                sustain_s: Fixed(field.sustain_s),
            },
        }
    }
}

/// One harmonic of the plate's velocity: that of its centre and its spin.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct HarmonicPart {
    cos_mm_s: [Fixed<3>; 2],
    sin_mm_s: [Fixed<3>; 2],
    cos_rad_s: Fixed<5>,
    sin_rad_s: Fixed<5>,
}

fn harmonics(wave: &TwistWave) -> Vec<HarmonicPart> {
    let parts = wave.harmonics.iter().map(|harmonic| HarmonicPart {
        cos_mm_s: fixed_pair(harmonic.cos.velocity_mps * 1e3),
        sin_mm_s: fixed_pair(harmonic.sin.velocity_mps * 1e3),
        cos_rad_s: Fixed(harmonic.cos.spin_radps),
        sin_rad_s: Fixed(harmonic.sin.spin_radps),
    });
    parts.collect()
}

fn hz(radps: f64) -> Fixed<4> {
    Fixed(radps / std::f64::consts::TAU)
}

#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged)]
pub(super) enum MotionPart {
    About { cor_mm: PointMm, rotation: i8 },
    Along { direction: [Fixed<4>; 2] },
}

impl MotionPart {
    fn new(motion: MotionRecord) -> Self {
        match motion {
            MotionRecord::About { center_m, counter_clockwise } => {
                Self::About { cor_mm: point_mm(center_m), rotation: if counter_clockwise { 1 } else { -1 } }
            }
            MotionRecord::Along { direction } => Self::Along { direction: fixed_pair(direction) },
        }
    }
}

pub(super) fn status_of(plan: &Plan) -> StatusPart<'_> {
    match &plan.status {
        PlanStatus::Solved => StatusPart::Solved,
        PlanStatus::NothingToDo => StatusPart::NothingToDo,
        PlanStatus::SolverFailed(reason) => StatusPart::SolverFailed { reason },
        PlanStatus::Infeasible(limit) => {
            let (limit, limited_parts) = match *limit {
                Limit::Edge { part } => ("edge", vec![part]),
                Limit::Separation { parts } => ("separation", parts.to_vec()),
                Limit::Unreachable => ("unreachable", Vec::new()),
            };
            StatusPart::Infeasible { limit, limited_parts }
        }
    }
}

/// One pulse as it was sent and what the accelerometers read of it.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct SentLine {
    started_at_s: Seconds,
    /// True for the small probe at the beginning of a run, which moves no part.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    probe: bool,
    base_hz: Fixed<4>,
    attack_s: Seconds,
    sustain_s: Seconds,
    rest_s: Seconds,
    /// For each motor and each harmonic: cos and sin, counts.
    counts: [Vec<[Fixed<3>; 2]>; MOTORS],
    read: ReadPart,
}

#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged)]
enum ReadPart {
    Fit {
        /// Velocity of the plate's centre, mm/s, at the pump wave's amplitude.
        pump_mm_s: [Fixed<3>; 2],
        pump_rad_s: Fixed<5>,
        #[serde(flatten)]
        motion: Option<MotionPart>,
        residual_m_s2: Fixed<4>,
    },
    Wave {
        harmonics: Vec<HarmonicPart>,
        residual_m_s2: Fixed<4>,
        /// Root mean square difference between the measured and the commanded wave over plate and period, relative to
        /// the latter.
        off_asked: Option<Fixed<4>>,
    },
    Diagnostic {
        fault: String,
    },
}

impl SentLine {
    pub(super) fn new(facts: &PulseFacts, library: &Library) -> Self {
        let drive = &facts.drive;
        let counts = |harmonics: &Vec<Harmonic>| harmonics.iter().map(|h| [Fixed(h.cos), Fixed(h.sin)]).collect();
        let read = match &facts.fit {
            Ok(PlateFit::Twist(fit)) => ReadPart::Fit {
                pump_mm_s: fixed_pair(fit.pump.velocity_mps * 1e3),
                pump_rad_s: Fixed(fit.pump.spin_radps),
                motion: MotionRecord::of(&fit.pump).map(MotionPart::new),
                residual_m_s2: Fixed(fit.motion.residual_rms_mps2),
            },
            Ok(PlateFit::Wave(fit)) => ReadPart::Wave {
                harmonics: harmonics(&fit.wave),
                residual_m_s2: Fixed(fit.residual_rms_mps2),
                off_asked: match &facts.planned {
                    PlannedPulse::Field(asked) => Some(Fixed(off_part(&fit.wave, &asked.wave, library.plate_side_m))),
                    PlannedPulse::Rotation(_) => None,
                },
            },
            Err(fault) => ReadPart::Diagnostic { fault: fault.to_string() },
        };
        Self {
            started_at_s: seconds(facts.started_at),
            probe: facts.is_probe,
            base_hz: hz(drive.base_radps),
            attack_s: Fixed(drive.envelope.attack_s),
            sustain_s: Fixed(drive.envelope.sustain_s),
            rest_s: Fixed(drive.envelope.rest_s),
            counts: drive.motors.each_ref().map(counts),
            read,
        }
    }
}

#[derive(Serialize, JsonSchema)]
#[serde(untagged)]
pub(super) enum DetailPart<'a> {
    /// A lasting finding that began or ended.
    Finding {
        code: &'static str,
        #[schemars(extend("enum" = ["began", "ended"]))]
        change: &'static str,
        /// Cycles in which it held.
        #[serde(skip_serializing_if = "Option::is_none")]
        times: Option<u64>,
        /// The explanation that the senses can tell least from it.
        #[serde(skip_serializing_if = "Option::is_none")]
        runner_up: Option<&'a RunnerUp>,
    },
    RunEnded {
        outcome: Outcome,
        #[serde(skip_serializing_if = "Option::is_none")]
        code: Option<StopCause>,
    },
    RecordingEnded {
        #[schemars(extend("const" = "recording_failed"))]
        code: &'static str,
    },
}
