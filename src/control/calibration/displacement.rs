use std::f64::consts::{FRAC_PI_4, TAU};

use nalgebra::{DMatrix, DVector};

use super::super::facts::Sink;
use super::super::guards::Guards;
use super::super::perception::{FramePurpose, Perception};
use super::steering::{GENTLE_MPS, SteeringMotion};
use super::{CalibrationError, CalibrationParams, CalibrationSession};
use upm_core::geometry::{Twist, Vec2};
use upm_core::job::Finding;
use upm_core::units::mm_from_m;
use upm_planning::cor_library::{CameraNoise, DisplacementModel, Entry, Library};

/// Number of speed nodes of the model.
const SPEEDS: usize = 14;
/// Weight of the penalty on curvature between nodes; it determines nodes that no coin passed.
const SMOOTHING: f64 = 0.02;
/// Speeds at which the gentle motions are measured, as multiples of [`GENTLE_MPS`]: the model needs nodes
/// on both sides of it.
const GENTLE_STEPS: [f64; 3] = [0.6, 1.2, 4.0];
/// The plate's edge keeps this distance from a coin's rim, m.
const EDGE_M: f64 = 4e-3;
/// Limit for the displacement of a pulse, as a multiple of the longest displacement wanted.
const FARTHEST: f64 = 1.5;
/// Displacement below which the strongest pulse counts as no motion, m.
const STILL_M: f64 = 0.2e-3;

/// Largest difference between opening and closing steps, in standard deviations of their mean.
const CLOSING_SIGMAS: f64 = 3.0;
/// The share of the step allowed on top: coins differ in friction and have moved by the end.
const CLOSING_SHARE: f64 = 0.1;

/// Sustains measured per period of the drive. The phase at which a pulse ends decides the parts' last push: their
/// distance rises in steps, one per period, of up to a tenth.
const SUSTAINS_A_PERIOD: f64 = 6.0;
/// With [`MANY`] sustains, every motion is measured with only one in this many of them.
const TURNS: usize = 3;
/// Number of sustains from which that applies.
const MANY: usize = 24;

/// Measurement of one coin in one pulse.
struct DisplacementSample {
    speed_mps: f64,
    sustain: usize,
    distance_m: f64,
}

struct SilentSink;
impl Sink for SilentSink {}

/// The camera's view of the coins, and how far two looks at the same coins at rest are apart.
struct Looks {
    perception: Perception,
    last_m: Vec<Vec2>,
    /// Sums of squares and their number: differences of a coin's places along an axis, m², and corners, px².
    places_m2: (f64, usize),
    corners_px2: (f64, usize),
}

/// Moves the coins to and fro with every entry of `library` and fits the displacement model to the camera's
/// measurements, whose noise is the second result.
pub(super) fn measure(
    session: &mut CalibrationSession<'_>,
    library: &Library,
    params: &CalibrationParams,
) -> Result<(DisplacementModel, CameraNoise), CalibrationError> {
    let guards = Guards { without: Some(Finding::PartsJumped), ..Guards::default() };
    let perception = Perception::open(&mut session.io(&mut SilentSink), &params.kinds, &params.coins, guards)?;
    let mut looks = Looks { perception, last_m: Vec::new(), places_m2: (0.0, 0), corners_px2: (0.0, 0) };
    // Lengthens the pulse until a coin moves as far as the model must cover. Sustains are spaced evenly up to there.
    let longest_s = session.model.max_sustain_s;
    let speed = |entry: &Entry| entry.pump.velocity_mps.norm();
    let by_speed = |a: &(usize, &Entry), b: &(usize, &Entry)| speed(a.1).total_cmp(&speed(b.1));
    let entry = library.entries.iter().enumerate().max_by(by_speed).map_or(0, |(entry, _)| entry);
    let mut farthest = 0.0f64;
    let mut top_s = longest_s;
    let mut opening = Vec::new();
    for step in 1..=12 {
        let sustain_s = longest_s * f64::from(step) / 12.0;
        opening.clear();
        for reversed in [false, true] {
            opening.extend(pulse(session, &mut looks, library, params, (entry, reversed), (0, sustain_s))?);
        }
        farthest = opening.iter().map(|sample| sample.distance_m).fold(farthest, f64::max);
        if farthest >= params.longest_m {
            top_s = sustain_s;
            break;
        }
    }
    if farthest < STILL_M {
        let peak_mps2 = session.peak_mps2();
        return Err(CalibrationError::TooWeak { moved_mm: farthest * 1e3, needed_mm: STILL_M * 1e3, peak_mps2 });
    }
    let periods = top_s * session.model.base_radps / TAU;
    let last = (periods * SUSTAINS_A_PERIOD).ceil().min(params.sustains as f64 - 1.0).max(1.0);
    let sustain_s: Vec<f64> = (0..=last as usize).map(|k| top_s * k as f64 / last).collect();
    let motions = library.entries.len();
    let mut samples = Vec::new();
    for (k, &sustain) in sustain_s.iter().enumerate() {
        let turns = if sustain_s.len() < MANY { 1 } else { TURNS };
        for entry in (0..motions).filter(|entry| (entry + k) % turns == 0) {
            session.report("displacement", k * motions + entry, motions * sustain_s.len());
            for reversed in [false, true] {
                samples.extend(pulse(session, &mut looks, library, params, (entry, reversed), (k, sustain))?);
            }
        }
    }
    let model = fit(&samples, sustain_s);
    check_closing(&opening, &model)?;
    Ok((model, looks.noise()))
}

/// Refuses a rig whose opening pulses, which chose the longest sustain, carried coins differently than the closing
/// ones; the pulses of that sustain come last.
fn check_closing(opening: &[DisplacementSample], model: &DisplacementModel) -> Result<(), CalibrationError> {
    let Some(&longest_s) = model.sustain_s.last().filter(|_| !opening.is_empty()) else { return Ok(()) };
    let count = opening.len() as f64;
    let mean = |of: &dyn Fn(&DisplacementSample) -> f64| opening.iter().map(of).sum::<f64>() / count;
    let opening_m = mean(&|sample| sample.distance_m);
    let closing_m = mean(&|sample| model.distance(sample.speed_mps, longest_s));
    let sd_m = (mean(&|sample| model.sd(sample.speed_mps, longest_s).powi(2)) / count).sqrt();
    let allowed_m = CLOSING_SIGMAS * sd_m + CLOSING_SHARE * closing_m;
    if (opening_m - closing_m).abs() <= allowed_m {
        return Ok(());
    }
    let [opening_mm, closing_mm, allowed_mm] = [opening_m, closing_m, allowed_m].map(mm_from_m);
    Err(CalibrationError::StepChanged { opening_mm, closing_mm, allowed_mm })
}

/// Motions that give coins all over the plate many speeds in many directions: centres on the plate and outside it, and
/// translations, each as strong as the motors allow and gently.
pub(super) fn motions(half_side_m: f64) -> Vec<SteeringMotion> {
    const CENTERS: [[f64; 2]; 8] =
        [[0.0, 0.0], [-0.6, -0.3], [0.3, 0.6], [0.6, -0.6], [-0.3, 0.3], [1.5, 0.7], [-1.2, 1.5], [-0.6, -2.0]];
    let centers = CENTERS.map(|[x, y]| Twist::about(Vec2::new(x, y) * half_side_m, 1.0));
    let translations = (0..4).map(|i| {
        let (sin, cos) = libm::sincos(FRAC_PI_4 * f64::from(i));
        Twist::new(cos, sin, 0.0)
    });
    let directions: Vec<Twist> = centers.into_iter().chain(translations).collect();
    let strong = directions.iter().map(|&direction| SteeringMotion { direction, top_mps: f64::INFINITY });
    let gentle = GENTLE_STEPS.iter().flat_map(|step| {
        directions.iter().map(move |&direction| SteeringMotion { direction, top_mps: step * GENTLE_MPS })
    });
    strong.chain(gentle).collect()
}

/// Plays one pulse and measures every coin. Plays nothing, and has no samples, where a coin could go over the edge.
fn pulse(
    session: &mut CalibrationSession<'_>,
    looks: &mut Looks,
    library: &Library,
    params: &CalibrationParams,
    (entry, reversed): (usize, bool),
    (sustain, sustain_s): (usize, f64),
) -> Result<Vec<DisplacementSample>, CalibrationError> {
    let before = looks.again(session)?;
    let (Some(motion), Some(drive)) = (library.entries.get(entry), library.drive(entry, sustain_s)) else {
        return Ok(Vec::new());
    };
    let pump = if reversed { -motion.pump } else { motion.pump };
    let reach = 0.5 * session.model.plate_side_m - EDGE_M - params.kinds.first().map_or(0.0, |kind| kind.radius_m);
    let leaves = |p: &Vec2| (p + pump.direction_at(*p) * (FARTHEST * params.longest_m)).amax() > reach;
    let outwards = |p: &Vec2| p.dot(&pump.direction_at(*p)) > 0.0;
    if before.iter().any(|p| leaves(p) && outwards(p)) {
        return Ok(Vec::new());
    }
    session.rig.play(&if reversed { drive.reversed() } else { drive })?;
    while session.rig.now() < session.rig.settled_at() {
        session.stop_check()?;
        looks.perception.observe(&mut session.io(&mut SilentSink), FramePurpose::Pulse)?;
    }
    let after = observe_at_rest(session, &mut looks.perception)?;
    let sample = |(a, b): (&Vec2, &Vec2)| {
        let middle = 0.5 * (a + b);
        let distance_m = (b - a).dot(&pump.direction_at(middle));
        DisplacementSample { speed_mps: pump.velocity_at(middle).norm(), sustain, distance_m }
    };
    let samples = before.iter().zip(&after).map(sample).collect();
    looks.last_m = after;
    Ok(samples)
}

impl Looks {
    /// Looks once more at coins that rest where they were last seen.
    fn again(&mut self, session: &mut CalibrationSession<'_>) -> Result<Vec<Vec2>, CalibrationError> {
        let places_m = observe_at_rest(session, &mut self.perception)?;
        let apart_m2 = self.last_m.iter().zip(&places_m).map(|(last, place)| (place - last).norm_squared());
        self.places_m2 = (self.places_m2.0 + apart_m2.sum::<f64>(), self.places_m2.1 + 2 * self.last_m.len());
        let corner_px = self.perception.corner_px().unwrap_or(0.0);
        self.corners_px2 = (self.corners_px2.0 + corner_px * corner_px, self.corners_px2.1 + 1);
        self.last_m.clone_from(&places_m);
        Ok(places_m)
    }

    /// Half of the variance of a difference is that of one look.
    fn noise(&self) -> CameraNoise {
        let mean = |(sum, count): (f64, usize)| sum / count.max(1) as f64;
        CameraNoise { corner_px: mean(self.corners_px2).sqrt(), place_m: (0.5 * mean(self.places_m2)).sqrt() }
    }
}

fn observe_at_rest(
    session: &mut CalibrationSession<'_>,
    perception: &mut Perception,
) -> Result<Vec<Vec2>, CalibrationError> {
    const LOOKS: usize = 120;
    for _ in 0..LOOKS {
        session.stop_check()?;
        let is_at_rest = perception.observe(&mut session.io(&mut SilentSink), FramePurpose::Cycle)?;
        if is_at_rest && perception.frames_missing() == 0 {
            return Ok(perception.positions_m());
        }
    }
    Err(CalibrationError::Unseen("a coin was lost during calibration".into()))
}

/// Least squares of a piecewise linear curve over speed for every sustain; distances never fall with sustain.
fn fit(samples: &[DisplacementSample], sustain_s: Vec<f64>) -> DisplacementModel {
    let mut moving: Vec<f64> = samples.iter().filter(|s| s.distance_m > 0.05e-3).map(|s| s.speed_mps).collect();
    moving.sort_unstable_by(f64::total_cmp);
    let fastest = samples.iter().map(|s| s.speed_mps).fold(0.0, f64::max);
    // One in a hundred may be an outlier: a coin near the centre of rotation that something else moved.
    let first = 0.8 * moving.get(moving.len() / 100).map_or(fastest, |&slowest| slowest);
    let ratio = libm::pow(fastest / first, 1.0 / (SPEEDS - 1) as f64);
    let speed_mps: Vec<f64> = (0..SPEEDS as i32).map(|i| first * ratio.powi(i)).collect();

    let columns: Vec<(Vec<f64>, Vec<f64>)> = (0..sustain_s.len())
        .map(|k| {
            let here: Vec<&DisplacementSample> = samples.iter().filter(|s| s.sustain == k).collect();
            fit_curve(&here, &speed_mps)
        })
        .collect();
    let mut distance_m: Vec<Vec<f64>> =
        (0..SPEEDS).map(|i| columns.iter().map(|(distance, _)| distance[i].max(0.0)).collect()).collect();
    for row in &mut distance_m {
        for k in 1..row.len() {
            row[k] = row[k].max(row[k - 1]);
        }
    }
    let sd_m = (0..SPEEDS).map(|i| columns.iter().map(|(_, sd)| sd[i]).collect()).collect();
    DisplacementModel { speed_mps, sustain_s, distance_m, sd_m }
}

/// Node values, and the scatter about them, of one sustain's samples.
fn fit_curve(samples: &[&DisplacementSample], speed_mps: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let nodes = speed_mps.len();
    let mut normal = DMatrix::<f64>::identity(nodes, nodes) * 1e-9;
    let mut right = DVector::<f64>::zeros(nodes);
    for sample in samples {
        let (i, part) = place(speed_mps, sample.speed_mps);
        for (a, wa) in [(i, 1.0 - part), (i + 1, part)] {
            right[a] += wa * sample.distance_m;
            for (b, wb) in [(i, 1.0 - part), (i + 1, part)] {
                normal[(a, b)] += wa * wb;
            }
        }
    }
    for i in 1..nodes - 1 {
        let bend = [(i - 1, 1.0), (i, -2.0), (i + 1, 1.0)];
        for (a, wa) in bend {
            for (b, wb) in bend {
                normal[(a, b)] += SMOOTHING * wa * wb;
            }
        }
    }
    let values = normal.cholesky().map_or_else(|| DVector::zeros(nodes), |factor| factor.solve(&right));
    let mut scatter = vec![(0.0, 1e-12); nodes];
    for sample in samples {
        let (i, part) = place(speed_mps, sample.speed_mps);
        let error = sample.distance_m - ((1.0 - part) * values[i] + part * values[i + 1]);
        for (a, weight) in [(i, 1.0 - part), (i + 1, part)] {
            scatter[a].0 += weight * error * error;
            scatter[a].1 += weight;
        }
    }
    (values.iter().copied().collect(), scatter.iter().map(|(sum, weight)| (sum / weight).sqrt()).collect())
}

/// The node at or below `speed` and the fraction of the interval to the next one, clamped to the grid.
fn place(speed_mps: &[f64], speed: f64) -> (usize, f64) {
    let i = speed_mps.partition_point(|&node| node <= speed).clamp(1, speed_mps.len() - 1) - 1;
    let part = (speed - speed_mps[i]) / (speed_mps[i + 1] - speed_mps[i]);
    (i, part.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fit_finds_a_known_curve_again() {
        let truth = |speed: f64, k: usize| (speed - 0.005).max(0.0) * 0.05 * (k + 1) as f64;
        let mut samples = Vec::new();
        for k in 0..3 {
            for i in 0..200 {
                let speed_mps = 0.004 + 0.0002 * f64::from(i);
                samples.push(DisplacementSample { speed_mps, sustain: k, distance_m: truth(speed_mps, k) });
            }
        }
        let model = fit(&samples, vec![0.0, 0.1, 0.2]);
        for (i, &speed) in model.speed_mps.iter().enumerate().skip(3) {
            for k in 0..3 {
                assert!(
                    (model.distance_m[i][k] - truth(speed, k)).abs() < 0.05 * truth(speed, k) + 1e-5,
                    "{speed} {k}"
                );
            }
        }
    }
}
