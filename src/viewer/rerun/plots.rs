use std::f64::consts::TAU;

use re_sdk_types::archetypes::{Scalars, SeriesLines, Transform3D};

use super::observation::Observation;
use super::paint;
use super::run_stream::{LogResult, RunStream};
use crate::types::RunContext;
use upm_control::CycleFacts;
use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::TwistHarmonic;
use upm_core::units::mm_from_m;
use upm_planning::planner::{PlannedPulse, PlanningMethod};

/// Mean speed of each part in a segment, of a run without pauses alone.
pub(super) const SPEED: &str = "motion/speed_mm_s";
const PLAN: &str = "timing/plan_us";

/// Plots with one line for each part.
const BY_PART: [&str; 6] = [
    "errors/to_target_mm",
    "errors/to_subgoal_mm",
    "errors/of_prediction_mm",
    "errors/cross_track_mm",
    "errors/sensing_mm",
    SPEED,
];

/// Plots with a single line.
const SINGLE: [&str; 5] = ["plan/total_mm", "plan/pulses", "timing/track_us", PLAN, "timing/cycle_us"];

/// The plan of each cycle, errors and wall times as curves.
pub(super) struct Plots {
    /// Frames tracked in this cycle, and the total time of tracking, µs.
    tracked: (u32, f64),
    half_side_m: f64,
    has_pauses: bool,
}

impl Plots {
    /// Logs names and colours of the series.
    pub(super) fn start(stream: &RunStream, context: &RunContext) -> Result<Self, String> {
        let palette = paint::palette(&context.parts);
        let has_pauses = context.method != PlanningMethod::MovingField;
        for path in BY_PART.into_iter().filter(|path| !has_pauses || *path != SPEED) {
            let names = context.parts.iter().map(|part| part.id.as_str());
            let lines = SeriesLines::new().with_names(names).with_colors(paint::colors(palette.parts()));
            stream.log_static(path, &lines.with_widths([1.5]))?;
        }
        for (path, color) in SINGLE.into_iter().zip(paint::series(SINGLE.len())) {
            let name = path.split_once('/').map_or(path, |(_, name)| name).replace('_', " ");
            stream.log_static(path, &SeriesLines::new().with_names([name]).with_colors([color]).with_widths([1.5]))?;
        }
        if !has_pauses {
            let lines = SeriesLines::update_fields().with_names(["plan us", "segment us"]).with_widths([1.5; 2]);
            stream.log_static(PLAN, &lines.with_colors(paint::series(2)))?;
        }
        Ok(Self { tracked: (0, 0.0), half_side_m: 0.5 * context.model.plate_side_m, has_pauses })
    }

    /// Logs the distance of measured from true positions.
    pub(super) fn observed(&mut self, stream: &RunStream, seen: &Observation) -> LogResult {
        let (frames, track_us) = seen.tracked;
        self.tracked = (self.tracked.0 + frames, self.tracked.1 + track_us);
        if seen.true_m.is_empty() {
            return Ok(());
        }
        log_each(stream, "errors/sensing_mm", distances_mm(&seen.measured_m(), &seen.true_m))
    }

    /// Logs the errors at the observation that starts a cycle, and its plan.
    pub(super) fn planned(&self, stream: &RunStream, cycle: &CycleFacts) -> LogResult {
        log_each(stream, "errors/to_target_mm", distances_mm(&cycle.observed_m, &cycle.wanted.targets_m))?;
        log_each(stream, "errors/cross_track_mm", cycle.wanted.cross_track_m.iter().map(|&off_m| mm_from_m(off_m)))?;
        let pulses = &cycle.plan.pulses;
        log_each(stream, "plan/pulses", [pulses.len() as f64])?;
        if let [PlannedPulse::Field(field), ..] = &pulses[..] {
            let speeds = field.wave.harmonics.iter().map(|harmonic| self.speed_mm_s(harmonic));
            return log_bars(stream, "plan/harmonics_mm_s", &speeds.collect::<Vec<_>>());
        }
        let distance_mm = |pulse: &PlannedPulse| match pulse {
            PlannedPulse::Rotation(rotation) => Some(mm_from_m(rotation.distance_m)),
            PlannedPulse::Field(_) => None,
        };
        let distances: Vec<f64> = pulses.iter().filter_map(distance_mm).collect();
        log_each(stream, "plan/total_mm", [distances.iter().map(|d| d.abs()).sum()])?;
        log_bars(stream, "plan/d_mm", &distances)
    }

    /// Amplitude of a harmonic's x, y and spin together, spin as the speed half a side from the centre.
    fn speed_mm_s(&self, harmonic: &TwistHarmonic) -> f64 {
        let square = |twist: Twist| twist.velocity_mps.norm_squared() + (twist.spin_radps * self.half_side_m).powi(2);
        mm_from_m((square(harmonic.cos) + square(harmonic.sin)).sqrt())
    }

    /// Logs the result of a cycle and its timing.
    pub(super) fn ended(&mut self, stream: &RunStream, cycle: &CycleFacts) -> LogResult {
        log_each(stream, "errors/to_subgoal_mm", distances_mm(&cycle.result_m, &cycle.wanted.subgoals_m))?;
        if let Some(predicted_m) = cycle.plan.predicted_m.last() {
            log_each(stream, "errors/of_prediction_mm", distances_mm(&cycle.result_m, predicted_m))?;
        }
        let (frames, track_us) = std::mem::take(&mut self.tracked);
        log_each(stream, "timing/track_us", [track_us / f64::from(frames.max(1))])?;
        match &cycle.plan.pulses[..] {
            [PlannedPulse::Field(field), ..] if !self.has_pauses => {
                let segment_s = TAU / field.wave.base_radps;
                // places are those at the ends of segments, times those of the frames before
                let segments = (cycle.ended_at.secs_since(cycle.observed_at) / segment_s).round().max(1.0);
                let speed = |step_mm| step_mm / (segments * segment_s);
                log_each(stream, SPEED, distances_mm(&cycle.observed_m, &cycle.result_m).map(speed))?;
                log_each(stream, PLAN, [cycle.plan_us, segment_s * 1e6])?;
            }
            _ => log_each(stream, PLAN, [cycle.plan_us])?,
        }
        log_each(stream, "timing/cycle_us", [cycle.cycle_us])
    }
}

/// Width of the drawing of bars; its height is 1.
pub(super) const BARS_WIDTH: f64 = 1.25;

/// Largest number of bars that have room for their heights as text.
const MOST_LABELS: usize = 8;

/// Logs bars from left to right. They are lines, since tables of the Python SDK cannot hold the tensors of a bar chart.
fn log_bars(stream: &RunStream, path: &str, heights: &[f64]) -> LogResult {
    let count = heights.len().max(1) as f64;
    let limit = |of: fn(f64, f64) -> f64| heights.iter().copied().fold(0.0, of);
    let scale = 1.0 / (limit(f64::max) - limit(f64::min)).max(1e-9);
    let axis = [0.0, limit(f64::max) * scale, 0.0];
    stream.log("plan", &Transform3D::from_translation_scale(axis, [BARS_WIDTH / count, -scale, 1.0]))?;
    let bar = |(j, &height): (usize, &f64)| [0.0, height].map(|end| [j as f32 + 0.5, end as f32]);
    let bars = paint::lines(heights.iter().enumerate().map(bar), paint::CENTER, (60.0 / count as f32).min(7.0));
    // many bars: every second or third has its height as text
    let step = heights.len().div_ceil(MOST_LABELS).max(1);
    let label = |(j, height): (usize, &f64)| {
        if j % step == 0 { format!("{:.*}", usize::from(height.abs() < 10.0), height) } else { String::new() }
    };
    stream.log(path, &bars.with_labels(heights.iter().enumerate().map(label)).with_show_labels(true))
}

fn log_each(stream: &RunStream, path: &str, values: impl IntoIterator<Item = f64>) -> LogResult {
    stream.log(path, &Scalars::new(values))
}

fn distances_mm(a_m: &[Vec2], b_m: &[Vec2]) -> impl Iterator<Item = f64> {
    a_m.iter().zip(b_m).map(|(a, b)| mm_from_m((a - b).norm()))
}
