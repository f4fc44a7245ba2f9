use super::plan::Planned;
use upm_chart::{Chart, Color, Layer, Mark};
use upm_control::Rehearsal;
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;
use upm_runner::run::{PartForecast, PlanVerdict};

/// Extent of the picture, in half sides of the plate from its middle.
const SHOWN: f64 = 1.08;

/// Half the line in a part's weakest direction, in radii of the part.
const REACH: f64 = 1.7;

/// From a part's middle to its name, right and up, in radii of the part.
const BESIDE: f64 = 0.6;

/// The plate from above: where the parts start, where they are to go, their ways in the first rehearsal.
pub(super) fn chart(planned: &Planned) -> Chart {
    let half_side_mm = mm_from_m(planned.forecast.half_side_m);
    let mut layers = vec![Layer::plate(half_side_mm)];
    layers.extend(trails(planned));
    layers.extend(planned.forecast.parts.iter().enumerate().flat_map(|(i, part)| marks(i, part)));
    layers.push(weakest(&planned.forecast.parts));
    Chart::plate_map(format!("plan-{}", planned.job), title(planned), Some(SHOWN * half_side_mm), layers)
}

fn title(planned: &Planned) -> String {
    let Planned { job, rig, forecast } = planned;
    match forecast.range(|rehearsal| rehearsal.plate_time_s) {
        Some([_, median_s, _]) if forecast.verdict() == PlanVerdict::CanBeDone => {
            format!("{job} on {rig}: predicted to take {median_s:.1} s of plate time")
        }
        Some(_) => format!("{job} on {rig}: not every rehearsal reaches the goal"),
        None if forecast.verdict() == PlanVerdict::Undecided => {
            format!("{job} on {rig}: too long to be rehearsed to its end")
        }
        None => format!("{job} on {rig}: predicted that it cannot be done"),
    }
}

fn trails(planned: &Planned) -> impl Iterator<Item = Layer> {
    let trails = planned.forecast.rehearsals.first().map_or(&[][..], |Rehearsal { trails_m, .. }| trails_m);
    trails.iter().enumerate().map(|(i, trail_m)| {
        let points = trail_m.iter().map(|&p| at_mm(p));
        Layer::new(of_first(i, "predicted way"), Mark::Line, Color::nth(i), points)
    })
}

/// Rim at the start, target and name of part `i`.
fn marks(i: usize, part: &PartForecast) -> Vec<Layer> {
    let (color, start) = (Color::nth(i), at_mm(part.start.place.position_m));
    let rim = Mark::Circles { radius: mm_from_m(part.radius_m) };
    let name = Mark::Labels { texts: vec![part.id.clone()] };
    let beside = start.map(|along| along + mm_from_m(BESIDE * part.radius_m));
    let target = part.target.iter().map(|spot| at_mm(spot.place.position_m));
    vec![
        Layer::new(of_first(i, "start"), rim, color, [start]),
        Layer::new(of_first(i, "target"), Mark::Crosses, color, target),
        Layer::new("", name, color, [beside]),
    ]
}

/// Both ways from each start in the direction in which one pulse does least.
fn weakest(parts: &[PartForecast]) -> Layer {
    let (mut from, mut vectors) = (Vec::new(), Vec::new());
    for PartForecast { start, radius_m, .. } in parts {
        let ahead = start.place.weakest_direction * (REACH * radius_m);
        for vector in [ahead, -ahead] {
            from.push(at_mm(start.place.position_m));
            vectors.push(at_mm(vector));
        }
    }
    Layer::new("weakest direction", Mark::Arrows { vectors }, Color::Gray, from)
}

/// One label for all parts.
fn of_first(i: usize, label: &'static str) -> &'static str {
    if i == 0 { label } else { "" }
}

fn at_mm(at_m: Vec2) -> [f64; 2] {
    [at_m.x, at_m.y].map(mm_from_m)
}
