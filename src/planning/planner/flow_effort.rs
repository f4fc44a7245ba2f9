//! Estimate of the number of pulses for a step of all parts: a step along the library's flows needs few.

use nalgebra::{DMatrix, DVector};

use crate::cor_library::Library;
use upm_core::geometry::{Twist, Vec2, perp};

/// Distance carried by the counted pulses on a typical belt, m: the usual length in sequences.
const PULSE_M: f64 = 2e-3;
/// Entries slower than this fraction of the fastest are not counted.
const STRONG: f64 = 0.35;
/// Largest number of motions counted: of more, every second, third and so on, since they overlap.
const MOST: usize = 180;
/// Ridge: least effect of all flows together in any direction, relative to the mean.
const RIDGE: f64 = 1e-3;
/// Nodes of belt speed.
const SPEEDS: usize = 64;

/// Least sum of squares of equally long pulses, over all motions of a library, that makes a step. On random positions
/// and steps its root correlates with the time of the least-time program: 0.95 for 2 and 4 parts, 0.88 for 8.
#[derive(Clone, Debug)]
pub struct FlowEffort {
    twists: Vec<Twist>,
    speed_step_mps: f64,
    /// Distance carried by the pulse, over the belt's speed, m.
    ways_m: [f64; SPEEDS],
}

impl FlowEffort {
    /// The estimate with the flows of `library`.
    pub fn new(library: &Library) -> Self {
        let half_side_m = 0.5 * library.plate_side_m;
        let fastest =
            |twist: &Twist| twist.velocity_mps.norm() + twist.spin_radps.abs() * half_side_m * std::f64::consts::SQRT_2;
        let typical = |twist: &Twist| libm::hypot(twist.velocity_mps.norm(), 0.7 * twist.spin_radps * half_side_m);
        let strongest = library.entries.iter().map(|entry| typical(&entry.pump)).fold(0.0, f64::max);
        let pumps = library.entries.iter().map(|entry| entry.pump);
        let strong: Vec<Twist> = pumps.filter(|twist| typical(twist) >= STRONG * strongest).collect();
        let twists: Vec<Twist> = strong.iter().step_by(strong.len().div_ceil(MOST).max(1)).copied().collect();
        let most_mps = twists.iter().map(fastest).fold(1e-6, f64::max);
        let speed_step_mps = most_mps / (SPEEDS - 1) as f64;
        let model = &library.displacement;
        let sustain_s = model.sustain_for(strongest, PULSE_M).or(model.sustain_s.first().copied()).unwrap_or(0.0);
        let ways_m = std::array::from_fn(|i| model.distance(speed_step_mps * i as f64, sustain_s));
        Self { twists, speed_step_mps, ways_m }
    }

    /// Squared number of pulses for `steps_m` of parts at `places_m`, a sum of squares over the motions; adds its
    /// slopes by position and by step, 1/m, to `slopes`. Infinite where positions are not finite.
    pub fn squared(&self, places_m: &[Vec2], steps_m: &[Vec2], slopes: Option<(&mut [Vec2], &mut [Vec2])>) -> f64 {
        let rows = 2 * places_m.len().min(steps_m.len());
        if rows == 0 {
            return 0.0;
        }
        let mut kernel = DMatrix::<f64>::zeros(rows, rows);
        let mut flows: Vec<LocalFlow> = Vec::with_capacity(self.twists.len() * places_m.len());
        let mut ways = vec![0.0; rows];
        for twist in &self.twists {
            for (way, &place_m) in ways.chunks_exact_mut(2).zip(places_m) {
                let flow = self.flow(twist, place_m);
                way.copy_from_slice(flow.way_m.as_slice());
                flows.push(flow);
            }
            for (column, &by) in ways.iter().enumerate() {
                let sums = &mut kernel.as_mut_slice()[column * rows + column..(column + 1) * rows];
                sums.iter_mut().zip(&ways[column..]).for_each(|(sum, way)| *sum += by * way);
            }
        }
        let ridge = RIDGE * kernel.trace() / rows as f64;
        (0..rows).for_each(|k| kernel[(k, k)] += ridge);
        let steps = DVector::from_iterator(rows, steps_m.iter().flat_map(|step| [step.x, step.y]));
        let Some(factors) = kernel.cholesky() else { return f64::INFINITY };
        let prices = factors.solve(&steps);
        if let Some((by_place, by_step)) = slopes {
            let price = |i: usize| Vec2::new(prices[2 * i], prices[2 * i + 1]);
            by_step.iter_mut().enumerate().for_each(|(i, slope)| *slope += price(i) * 2.0);
            for (twist, flows) in self.twists.iter().zip(flows.chunks_exact(places_m.len())) {
                let count: f64 = flows.iter().enumerate().map(|(i, flow)| flow.way_m.dot(&price(i))).sum();
                for (i, (slope, flow)) in by_place.iter_mut().zip(flows).enumerate() {
                    *slope -= flow.slope(twist, price(i)) * (2.0 * count);
                }
            }
        }
        steps.dot(&prices).max(0.0)
    }

    /// Flow of one pulse of `twist` at `place_m`.
    fn flow(&self, twist: &Twist, place_m: Vec2) -> LocalFlow {
        let belt_mps = twist.velocity_at(place_m);
        let speed = belt_mps.norm();
        if speed < 1e-9 {
            return LocalFlow { belt_mps, way_m: Vec2::zeros(), by_belt_s: 0.0, by_speed: 0.0 };
        }
        let place = (speed / self.speed_step_mps).min((SPEEDS - 1) as f64);
        let node = (place as usize).min(SPEEDS - 2);
        let rise_m = self.ways_m[node + 1] - self.ways_m[node];
        let by_belt_s = (self.ways_m[node] + (place - node as f64) * rise_m) / speed;
        let by_speed = (rise_m / self.speed_step_mps - by_belt_s) / (speed * speed);
        LocalFlow { belt_mps, way_m: belt_mps * by_belt_s, by_belt_s, by_speed }
    }
}

/// Flow at one position: displacement g(|v|) v by a pulse on a belt of velocity v.
struct LocalFlow {
    belt_mps: Vec2,
    way_m: Vec2,
    /// g.
    by_belt_s: f64,
    /// g' / |v|.
    by_speed: f64,
}

impl LocalFlow {
    /// Slope by position of the displacement times `price`.
    fn slope(&self, twist: &Twist, price: Vec2) -> Vec2 {
        let by_belt = price * self.by_belt_s + self.belt_mps * (self.by_speed * price.dot(&self.belt_mps));
        -perp(by_belt) * twist.spin_radps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::fixture::{library, mm, scene};

    #[test]
    fn common_motion_of_all_parts_takes_least_effort() {
        let effort = FlowEffort::new(&library());
        for seed in 0..8 {
            let places_m: Vec<Vec2> = scene(6, 0.0, seed).iter().map(|part| part.position_m).collect();
            let center_m = places_m.iter().sum::<Vec2>() / 6.0;
            let of = |step: &dyn Fn(Vec2) -> Vec2| {
                let steps_m: Vec<Vec2> = places_m.iter().map(|&place_m| step(place_m - center_m)).collect();
                let rms_m = (steps_m.iter().map(|step| step.norm_squared()).sum::<f64>() / 6.0).sqrt();
                effort
                    .squared(&places_m, &steps_m.iter().map(|step| step * (10e-3 / rms_m)).collect::<Vec<_>>(), None)
                    .sqrt()
            };
            let (shift, turn) = (of(&|_| mm(1.0, 2.0)), of(&perp));
            // flows about centres are free of divergence: shear is among them, spreading is not
            let (shear, spread) = (of(&|arm| Vec2::new(arm.x, -arm.y)), of(&|arm| arm));
            assert!(shift.max(turn) < 0.5 * shear && shear < 0.8 * spread, "{shift} {turn} {shear} {spread}");
        }
    }

    #[test]
    fn slopes_agree_with_differences() {
        let effort = FlowEffort::new(&library());
        for seed in 0..4 {
            let parts = scene(5, 10e-3, seed);
            let places_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
            let steps_m: Vec<Vec2> = parts.iter().map(|part| part.step_m).collect();
            let (mut by_place, mut by_step) = (vec![Vec2::zeros(); 5], vec![Vec2::zeros(); 5]);
            let value = effort.squared(&places_m, &steps_m, Some((&mut by_place, &mut by_step)));
            let scale = value / 10e-3;
            for (i, axis) in (0..5).flat_map(|i| [(i, 0), (i, 1)]) {
                let difference = |of_place: bool| {
                    let at = |by_m: f64| {
                        let (mut places_m, mut steps_m) = (places_m.clone(), steps_m.clone());
                        if of_place {
                            places_m[i][axis] += by_m
                        } else {
                            steps_m[i][axis] += by_m
                        }
                        effort.squared(&places_m, &steps_m, None)
                    };
                    (at(1e-7) - at(-1e-7)) / 2e-7
                };
                // the derivative of the ridge is neglected
                assert!((by_place[i][axis] - difference(true)).abs() < 0.02 * scale, "{seed} {i}");
                assert!((by_step[i][axis] - difference(false)).abs() < 1e-3 * scale, "{seed} {i}");
            }
        }
    }

    #[test]
    fn zero_motion_takes_no_effort_and_nan_positions_infinite_effort() {
        let effort = FlowEffort::new(&library());
        assert_eq!(effort.squared(&[], &[], None), 0.0);
        assert_eq!(effort.squared(&[mm(10.0, 20.0)], &[Vec2::zeros()], None), 0.0);
        let nowhere = effort.squared(&[Vec2::new(f64::NAN, 0.0)], &[mm(1.0, 0.0)], None);
        assert!(nowhere == f64::INFINITY, "{nowhere}");
    }
}
