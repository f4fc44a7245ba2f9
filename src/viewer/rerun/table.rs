use std::f64::consts::TAU;

use re_sdk_types::archetypes::{Ellipses2D, Points2D, Transform3D};
use re_sdk_types::components::Color;

use super::observation::Observation;
use super::paint::{self, above, thin};
use super::run_stream::{LogResult, RunStream};
use super::task::TaskOverlay;
use super::trails::Trails;
use crate::types::RunContext;
use upm_chart::bin_outline;
use upm_control::{CycleFacts, PulseFacts};
use upm_core::geometry::{Twist, Vec2, perp};
use upm_core::signal::TwistWave;
use upm_core::units::mm_from_m;
use upm_perception::estimation::PlateFit;
use upm_planning::cor_library::Library;
use upm_planning::planner::{PlannedPulse, Rotation};
use upm_recording::MotionRecord;

/// Centres of rotation farther out are drawn at the rim of a window larger than the plate by this factor.
const WINDOW: f64 = 1.25;

/// Bounds of the view along both axes, mm.
pub(super) fn reach_mm(context: &RunContext) -> [f64; 2] {
    let reach_mm = mm_from_m(0.5 * context.model.plate_side_m) * WINDOW * 1.12;
    [-reach_mm, reach_mm]
}

/// Number of arrows of the field along each side of the plate.
const FIELD: usize = 11;

/// The view of the table from above, mm.
pub(super) struct TableView {
    half_side_m: f64,
    radii_mm: Vec<f32>,
    colors: Vec<Color>,
    measured: Trails,
    truth: Trails,
    /// Centres of rotation that the accelerometers read in the pulses of this cycle, m.
    read_m: (u64, Vec<Vec2>),
}

impl TableView {
    /// Logs the static data: the plate, the library's centres of rotation, sizes and colours of the parts.
    pub(super) fn start(stream: &RunStream, context: &RunContext) -> Result<Self, String> {
        let half_side_m = context.model.plate_side_m / 2.0;
        stream.log_static("table", &Transform3D::from_scale([1.0_f32, -1.0, 1.0]))?;
        let rim = bin_outline([-half_side_m; 2], [half_side_m; 2]).map(|corner| above(corner.into()));
        stream.log_static("table/outline", &paint::lines([rim], [210, 210, 220], 1.0))?;
        let window_m = WINDOW * half_side_m;
        let centers = context.library.entries.iter().filter_map(|entry| place_of(&entry.pump, window_m)).map(above);
        stream.log_static("table/library", &paint::dots(centers, paint::FAINT, 1.5))?;
        let radii_mm: Vec<f32> = context.parts.iter().map(|part| mm_from_m(part.radius_m) as f32).collect();
        let discs = |points: f32| {
            let sizes = radii_mm.iter().map(|&radius_mm| [radius_mm; 2]);
            Ellipses2D::update_fields().with_half_sizes(sizes).with_line_radii([thin(points)])
        };
        let palette = paint::palette(&context.parts);
        let colors = paint::colors(palette.parts());
        stream.log_static("table/measured", &discs(1.75).with_colors(colors.clone()))?;
        if context.truth.is_some() {
            // thinner than the line of the measured one, so that both are visible where they agree
            let truth = discs(0.6).with_draw_order(50.0);
            stream.log_static("table/true", &truth.with_colors([paint::color(paint::TRUE_PART)]))?;
        }
        let trails = Trails::new(context.parts.len(), 1.5e-3);
        TaskOverlay { root: "table", is_static: true, place: above }.log(stream, context)?;
        stream.log_static("table/names", &paint::names(&context.parts, colors.clone()))?;
        Ok(Self { half_side_m, radii_mm, colors, measured: trails.clone(), truth: trails, read_m: (0, Vec::new()) })
    }

    /// Logs where the parts are, and their trails at the start of a cycle.
    pub(super) fn observed(&mut self, stream: &RunStream, seen: &Observation) -> LogResult {
        let measured_m = seen.measured_m();
        let discs = measured_m.iter().copied().map(above).zip(self.radii_mm.iter().map(|radius_mm| -radius_mm));
        stream.log("table/names", &Points2D::update_fields().with_positions(discs.map(paint::below)))?;
        for (path, trails, places_m) in
            [("table/measured", &mut self.measured, &measured_m), ("table/true", &mut self.truth, &seen.true_m)]
        {
            if !places_m.is_empty() {
                trails.push(places_m);
                let centers = places_m.iter().copied().map(above);
                stream.log(path, &Ellipses2D::update_fields().with_centers(centers))?;
            }
        }
        if seen.frame.is_some() { self.trails(stream) } else { Ok(()) }
    }

    /// Logs the trails of the parts up to now.
    fn trails(&self, stream: &RunStream) -> LogResult {
        if !self.measured.is_empty() {
            let lines = paint::lines(self.measured.strips(above), paint::MEASURED, 1.0);
            stream.log("table/trails/measured", &lines.with_colors(self.colors.clone()))?;
        }
        if !self.truth.is_empty() {
            let lines = paint::lines(self.truth.strips(above), paint::TRUE_PART, 0.3);
            stream.log("table/trails/true", &lines.with_draw_order(35.0))?;
        }
        Ok(())
    }

    pub(super) fn cycle(&self, stream: &RunStream, cycle: &CycleFacts, context: &RunContext) -> LogResult {
        if !cycle.ends_at_rest {
            // where the planner of moving parts takes them to be, in no recorded frame
            let centers = cycle.observed_m.iter().copied().map(above);
            stream.log("table/measured", &Ellipses2D::update_fields().with_centers(centers))?;
        }
        self.log_wanted(stream, cycle)?;
        self.log_centers(stream, &cycle.plan.pulses, &context.library)?;
        self.log_forecast(stream, cycle)?;
        self.log_field(stream, &cycle.plan.pulses, &context.library)
    }

    /// Adds the centre of rotation that the accelerometers read in a rotation's pulse to those of its cycle.
    pub(super) fn pulse(&mut self, stream: &RunStream, pulse: &PulseFacts) -> LogResult {
        let Ok(PlateFit::Twist(fit)) = &pulse.fit else { return Ok(()) };
        if self.read_m.0 != pulse.cycle {
            self.read_m = (pulse.cycle, Vec::new());
        }
        self.read_m.1.extend(place_of(&fit.pump, WINDOW * self.half_side_m));
        let points = paint::dots(self.read_m.1.iter().copied().map(above), paint::MEASURED, 2.5);
        stream.at(pulse.started_at, pulse.cycle);
        stream.log("table/read_centers", &points.with_draw_order(40.0))
    }

    /// Logs the forecast of each field of this cycle: an arrow from the start to the end of each part's displacement.
    /// For rotations the centres show it.
    fn log_forecast(&self, stream: &RunStream, cycle: &CycleFacts) -> LogResult {
        let before_m = std::iter::once(&cycle.observed_m).chain(&cycle.plan.predicted_m);
        let stages = cycle.plan.pulses.iter().zip(before_m.zip(&cycle.plan.predicted_m));
        let of_fields = stages.filter(|(pulse, _)| matches!(pulse, PlannedPulse::Field(_)));
        let steps_m = of_fields.flat_map(|(_, (from_m, to_m))| from_m.iter().zip(to_m));
        let ends: Vec<_> = steps_m.map(|(from_m, to_m)| [*from_m, *to_m].map(above)).collect();
        if ends.is_empty() {
            return Ok(());
        }
        stream.log("table/forecast", &paint::arrows(ends, paint::PREDICTED, 1.75))
    }

    fn log_wanted(&self, stream: &RunStream, cycle: &CycleFacts) -> LogResult {
        let wanted = &cycle.wanted;
        let dots = |points_m: &[Vec2], paint, points| paint::dots(points_m.iter().copied().map(above), paint, points);
        let targets = dots(&wanted.targets_m, paint::TARGET, 4.5).with_colors(self.colors.clone());
        stream.log("table/wanted/targets", &targets)?;
        stream.log("table/wanted/subgoals", &dots(&wanted.subgoals_m, paint::SUBGOAL, 3.0))?;
        let predicted_m = cycle.plan.predicted_m.last().map_or(&[][..], Vec::as_slice);
        stream.log("table/wanted/predicted", &dots(predicted_m, paint::PREDICTED, 2.0))?;
        let steps = cycle.observed_m.iter().zip(&wanted.subgoals_m).map(|(from_m, to_m)| [*from_m, *to_m].map(above));
        stream.log("table/wanted/steps", &paint::arrows(steps, paint::SUBGOAL, 1.25))
    }

    /// Logs this cycle's centres of rotation, numbered in playing order.
    fn log_centers(&self, stream: &RunStream, pulses: &[PlannedPulse], library: &Library) -> LogResult {
        if let [PlannedPulse::Field(_), ..] = pulses {
            return Ok(());
        }
        let window_m = WINDOW * self.half_side_m;
        let chosen = pulses.iter().enumerate().filter_map(|(j, pulse)| {
            let PlannedPulse::Rotation(pulse) = pulse else { return None };
            let pump = library.entries.get(pulse.entry)?.pump * pulse.distance_m.signum();
            let how = match MotionRecord::of(&pump)? {
                MotionRecord::About { counter_clockwise: true, .. } => "ccw".to_owned(),
                MotionRecord::About { .. } => "cw".to_owned(),
                MotionRecord::Along { direction } => {
                    format!("towards {:.0}°", libm::atan2(direction.y, direction.x).to_degrees())
                }
            };
            let label = format!("{}: {:.1} mm {how}", j + 1, mm_from_m(pulse.distance_m.abs()));
            Some((above(place_of(&pump, window_m)?), label))
        });
        let (places, labels): (Vec<_>, Vec<_>) = chosen.unzip();
        let points = paint::dots(places, paint::CENTER, 5.0).with_labels(labels).with_show_labels(true);
        stream.log("table/centers", &points)
    }

    /// Logs the sum of the sequence's fields, to first order, or the mean direction of friction in a synthesised one;
    /// the longest arrow spans the grid's pitch.
    fn log_field(&self, stream: &RunStream, pulses: &[PlannedPulse], library: &Library) -> LogResult {
        let pitch_m = 2.0 * self.half_side_m / FIELD as f64;
        let middle = (FIELD as f64 - 1.0) / 2.0;
        let grid =
            (0..FIELD * FIELD).map(|i| Vec2::new((i % FIELD) as f64 - middle, (i / FIELD) as f64 - middle) * pitch_m);
        let fields: Vec<_> = pulses.iter().filter_map(|pulse| direction_field(pulse, library)).collect();
        let field: Vec<(Vec2, Vec2)> = grid.map(|p_m| (p_m, fields.iter().map(|at| at(p_m)).sum())).collect();
        let longest_m = field.iter().map(|(_, step_m)| step_m.norm()).fold(0.0, f64::max);
        let scale = if longest_m > 0.0 { 0.95 * pitch_m / longest_m } else { 0.0 };
        let ends = field.iter().map(|(p_m, step_m)| [-0.5, 0.5].map(|share| above(p_m + step_m * (share * scale))));
        let arrows = paint::arrows(ends, paint::FAINT, 0.75).with_draw_order(-5.0);
        stream.log("table/field", &arrows.with_colors([Color::from_unmultiplied_rgba(170, 175, 190, 130)]))
    }
}

/// Field of directions of a pulse, with its weight relative to the plan's others of the same kind: `d τ(p)`, m, of a
/// rotation, or the mean direction of the plate's velocity over a period of a synthesised motion.
fn direction_field(pulse: &PlannedPulse, library: &Library) -> Option<Box<dyn Fn(Vec2) -> Vec2>> {
    Some(match pulse {
        PlannedPulse::Rotation(Rotation { entry, distance_m, .. }) => {
            let (pump, distance_m) = (library.entries.get(*entry)?.pump, *distance_m);
            Box::new(move |p_m| pump.direction_at(p_m) * distance_m)
        }
        PlannedPulse::Field(field) => {
            let period: Vec<Twist> = over_a_period(&field.wave).collect();
            Box::new(move |p_m| mean_direction(&period, p_m))
        }
    })
}

/// The centre of rotation of `pump`, clamped to the rim of a square of half side `window_m`.
fn place_of(pump: &Twist, window_m: f64) -> Option<Vec2> {
    let center = match MotionRecord::of(pump)? {
        MotionRecord::About { center_m, .. } => center_m,
        // v = ω (p - C)^⊥ puts the centre to the left of the flow of a counter-clockwise rotation
        MotionRecord::Along { direction } => perp(direction) * 1e3,
    };
    let reach = center.amax() / window_m;
    Some(if reach > 1.0 { center / reach } else { center })
}

/// Number of moments sampled in a base period: 16 per period of the highest possible harmonic.
const MOMENTS: usize = 256;

/// The plate's velocity at moments spread evenly over one base period.
fn over_a_period(wave: &TwistWave) -> impl Iterator<Item = Twist> + '_ {
    let turns: Vec<(f64, f64)> = (0..MOMENTS).map(|i| libm::sincos(TAU * i as f64 / MOMENTS as f64)).collect();
    (0..MOMENTS).map(move |i| {
        (1..).zip(&wave.harmonics).fold(Twist::ZERO, |sum, (k, harmonic)| {
            let (sin, cos) = turns[k * i % MOMENTS];
            sum + harmonic.cos * cos + harmonic.sin * sin
        })
    })
}

/// The direction in which friction pulls a part at rest at `p_m`, times its share of sliding friction: the mean of the
/// direction of the plate's velocity there (equation sheet, section 5).
fn mean_direction(period: &[Twist], p_m: Vec2) -> Vec2 {
    period.iter().map(|twist| twist.direction_at(p_m)).sum::<Vec2>() / period.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_fixtures::rig;

    #[test]
    fn far_centres_are_drawn_at_the_rim() {
        let on = |center: Vec2| place_of(&Twist::about(center, 2.0), 0.1).unwrap();
        assert!((on(Vec2::new(0.05, 0.02)) - Vec2::new(0.05, 0.02)).norm() < 1e-12);
        assert!((on(Vec2::new(0.4, 0.2)) - Vec2::new(0.1, 0.05)).norm() < 1e-12);
        let translation = place_of(&Twist::new(1.0, 0.0, 0.0), 0.1).unwrap();
        assert!((translation - Vec2::new(0.0, 0.1)).norm() < 1e-12);
        assert!((translation - on(Vec2::new(0.0, -90.0))).norm() > 0.1, "a turn about a point below flows to the left");
        assert_eq!(place_of(&Twist::ZERO, 0.1), None);
    }

    #[test]
    fn the_field_of_one_rotation_is_its_tangent() {
        let library = rig::library();
        let pulse = PlannedPulse::Rotation(Rotation {
            entry: 40,
            distance_m: 0.003,
            amplitude: 1.0,
            sustain_s: 0.1,
            rest_s: 0.04,
        });
        let step_m = direction_field(&pulse, &library).unwrap()(Vec2::new(0.05, 0.0));
        assert!((step_m - Vec2::new(0.0, 0.003)).norm() < 1e-12, "entry 40 turns about the plate's centre");
    }

    #[test]
    fn a_pump_wave_pulls_along_its_field_by_the_papers_share() {
        let pump = Twist::about(Vec2::new(0.02, 0.0), 3.0);
        let period: Vec<Twist> = over_a_period(&TwistWave::pump(pump, 377.0)).collect();
        let p_m = Vec2::new(0.07, 0.03);
        let pulled = mean_direction(&period, p_m);
        assert!((pulled - pump.direction_at(p_m) * 0.2386).norm() < 6e-3, "one moment of 256 is 0.004: {pulled}");
    }
}
