use super::path_follower::{Motions, PathFollower};
use super::{PartOutline, Setpoints, Task};
use upm_core::geometry::{Polyline, Vec2};
use upm_core::time::PlateTime;

/// Assumed length of a cycle before the first was measured, s.
const FIRST_CYCLE_S: f64 = 0.5;

/// Half width of the search for a part along its loop, around the reference, in leads and strides: narrow enough to
/// exclude the other pass through a crossing.
const SEARCHED: f64 = 2.0;

/// Parameters of parts on closed loops in phase: all have completed the same fraction of their loops.
#[derive(Clone, Debug)]
pub struct InPhaseParams {
    /// Half the plate's side, m.
    pub half_side_m: f64,
    /// The kind of motion that moves the parts.
    pub motions: Motions,
    /// Discs of the parts, in the order of the positions given to [`Task::next`].
    pub discs: Vec<PartOutline>,
    /// Corners of each part's loop, m, from its beginning; the last is joined straight to the first. A part without
    /// corners stays where it was first seen.
    pub loops_m: Vec<Vec<Vec2>>,
    /// Time of one lap, s.
    pub period_s: f64,
    /// Number of laps; 0 for an endless task.
    pub laps: u32,
    /// Lead of the common reference over a part, beyond which it waits, m.
    pub lead_m: f64,
    /// Largest distance from a part to its subgoal ahead, m.
    pub stride_m: f64,
    /// Distance from the first corner within which a part has arrived, m.
    pub arrive_m: f64,
}

/// Task that follows [`InPhaseParams`]. First all parts go to the first corners of their loops; from then on one
/// reference phase advances for all. A subgoal is the reference's position at the end of the cycle.
#[derive(Clone, Debug)]
pub struct InPhase {
    params: InPhaseParams,
    loops: Vec<Polyline>,
    approach: Option<PathFollower>,
    /// Laps of the reference since all parts were at their first corners.
    reference: Option<f64>,
    looked_at: Option<PlateTime>,
    /// Running mean of the length of a cycle, s.
    cycle_s: f64,
}

/// Position of a part relative to its loop.
#[derive(Clone, Copy, Debug, Default)]
struct LoopPosition {
    /// Laps completed by the part; `None` where there is no loop.
    phase: Option<f64>,
    /// Distance from the loop, m.
    off_m: f64,
}

impl InPhase {
    /// A new task with these parameters.
    pub fn new(params: InPhaseParams) -> Self {
        Self { params, loops: Vec::new(), approach: None, reference: None, looked_at: None, cycle_s: FIRST_CYCLE_S }
    }

    fn begin(&self, parts_in_table_m: &[Vec2]) -> (Vec<Polyline>, PathFollower) {
        let InPhaseParams { half_side_m, motions, discs, loops_m, .. } = &self.params;
        let corners = |(i, part_m): (usize, &Vec2)| match loops_m.get(i).map(Vec::as_slice) {
            Some([first, rest @ ..]) => [&[*first], rest, &[*first]].concat(),
            _ => vec![*part_m],
        };
        let loops: Vec<Polyline> = parts_in_table_m.iter().enumerate().map(corners).map(Polyline::new).collect();
        let firsts_m: Vec<Vec2> = loops.iter().map(|lap| lap.at(0.0)).collect();
        let each_its_own = (0..loops.len()).collect();
        (loops, PathFollower::new(motions, discs, *half_side_m, &firsts_m, each_its_own, parts_in_table_m))
    }

    /// Length of the shortest loop, ignoring those without length, m: on it a lead is the largest fraction of a lap.
    fn shortest_m(&self) -> f64 {
        self.loops.iter().map(Polyline::length_m).filter(|length_m| *length_m > 0.0).fold(f64::INFINITY, f64::min)
    }

    /// Position of a part on its loop, searched near the reference.
    fn place(&self, part: usize, part_m: Vec2, reference: f64) -> LoopPosition {
        let lap = &self.loops[part];
        let length_m = lap.length_m();
        if length_m == 0.0 {
            return LoopPosition::default();
        }
        let InPhaseParams { lead_m, stride_m, .. } = self.params;
        let searched_m = (SEARCHED * (lead_m + stride_m)).min(0.25 * length_m);
        let (along_m, off_m) = lap.nearest_around(part_m, reference * length_m, searched_m);
        LoopPosition { phase: Some(along_m / length_m), off_m }
    }

    fn at(&self, part: usize, phase: f64) -> Vec2 {
        let lap = &self.loops[part];
        lap.at(phase.rem_euclid(1.0) * lap.length_m())
    }

    /// Phase at the end of the task, laps; infinite for an endless one.
    fn end(&self) -> f64 {
        if self.params.laps == 0 { f64::INFINITY } else { f64::from(self.params.laps) }
    }

    /// Setpoints while parts are on their way to the first corners.
    fn approach(&self, steering: &PathFollower) -> Setpoints {
        let there = steering.distances_m().filter(|distance_m| *distance_m <= self.params.arrive_m).count();
        Setpoints { progress: 0.0, ..steering.wanted("to the first corners", there) }
    }

    /// Setpoints on the loops, `elapsed_s` after the previous observation.
    fn loop_setpoints(&mut self, seen_m: &[Vec2], elapsed_s: f64, reference: f64) -> Setpoints {
        let InPhaseParams { period_s, lead_m, stride_m, arrive_m, laps, .. } = self.params;
        let places: Vec<LoopPosition> =
            seen_m.iter().enumerate().map(|(part, part_m)| self.place(part, *part_m, reference)).collect();
        let slowest = places.iter().filter_map(|place| place.phase).reduce(f64::min).unwrap_or(self.end());
        let in_laps = |way_m: f64| way_m / self.shortest_m();
        let held = (slowest + in_laps(lead_m)).min(self.end());
        let now = (reference + elapsed_s / period_s).min(held).max(reference);
        let ahead = (now + self.cycle_s / period_s).min(slowest + in_laps(stride_m)).min(self.end()).max(slowest);
        self.reference = Some(now);

        let near_end = |(part, part_m): (usize, &Vec2)| (part_m - self.at(part, 0.0)).norm() <= arrive_m;
        let done = now >= self.end() && seen_m.iter().enumerate().all(near_end);
        let of_each = |phase: f64| (0..seen_m.len()).map(|part| self.at(part, phase)).collect::<Vec<_>>();
        let lap = now.min(self.end() - 1.0).max(0.0) as u32;
        Setpoints {
            subgoals_m: of_each(ahead),
            targets_m: of_each(0.0),
            phase: match laps {
                _ if done => "every lap done, in step".into(),
                0 => format!("round the loops in step, lap {}", u64::from(lap) + 1),
                _ => format!("round the loops in step, lap {} of {laps}", u64::from(lap) + 1),
            },
            progress: if done { 1.0 } else { (now / self.end()).clamp(0.0, 1.0) },
            laps: if done { laps } else { slowest.max(0.0) as u32 },
            cross_track_m: places.iter().map(|place| place.off_m).collect(),
            phase_error: places.iter().map(|place| place.phase.map_or(0.0, |phase| phase - now)).collect(),
            done,
            ..Setpoints::default()
        }
    }
}

impl Task for InPhase {
    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let of = parts_in_table_m.len();
        let mut elapsed_s = self.looked_at.replace(now).map_or(0.0, |before| now.secs_since(before).max(0.0));
        if elapsed_s > 0.0 {
            self.cycle_s = 0.5 * (self.cycle_s + elapsed_s);
        }
        let mut steering = match self.approach.take().filter(|steering| steering.seen_m().len() == of) {
            Some(steering) => steering,
            None => {
                let (loops, steering) = self.begin(parts_in_table_m);
                (self.loops, self.reference) = (loops, None);
                steering
            }
        };
        if self.reference.is_none() {
            steering.observe(parts_in_table_m);
            if of > 0 && steering.distances_m().all(|distance_m| distance_m <= self.params.arrive_m) {
                (self.reference, elapsed_s) = (Some(0.0), 0.0);
            }
        }
        let wanted = match self.reference {
            None => self.approach(&steering),
            Some(reference) => {
                steering.see(parts_in_table_m);
                self.loop_setpoints(steering.seen_m(), elapsed_s, reference)
            }
        };
        self.approach = Some(steering);
        wanted
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PENNY_M;
    use rand::RngExt;
    use std::f64::consts::TAU;
    use upm_core::random::Streams;

    const CORNERS: usize = 60;

    /// A figure eight that starts at fraction `turn` of its corners.
    fn eight(turn: f64) -> Vec<Vec2> {
        let at = |i: usize| TAU * (i as f64 / CORNERS as f64 + turn);
        (0..CORNERS).map(|i| Vec2::new(0.08 * at(i).sin(), 0.04 * (2.0 * at(i)).sin())).collect()
    }

    fn three_on_one_eight(laps: u32) -> InPhaseParams {
        InPhaseParams {
            half_side_m: 0.1524,
            motions: Motions::Independent,
            discs: vec![PartOutline { kind: 0, radius_m: PENNY_M }; 3],
            loops_m: (0..3).map(|i| eight(0.05 + f64::from(i) / 3.0)).collect(),
            period_s: 30.0,
            laps,
            lead_m: 0.004,
            stride_m: 0.012,
            arrive_m: 0.00045,
        }
    }

    /// Result of a run on the loops.
    #[derive(Debug, Default)]
    struct LoopRunResult {
        took_s: f64,
        /// Time from the first corners to the end, s.
        on_loops_s: f64,
        phase_error: f64,
        off_m: f64,
        gap_m: f64,
    }

    /// Parts that make `gain` of their displacements within a few percent, in cycles of changing length.
    fn run(params: InPhaseParams, mut gain: impl FnMut(usize, f64) -> f64) -> LoopRunResult {
        let mut rng = Streams::new(3).stream("strays");
        let mut parts = vec![Vec2::new(-0.1, -0.1), Vec2::new(0.1, -0.1), Vec2::new(0.0, 0.1)];
        let mut course = LoopRunResult { gap_m: f64::INFINITY, ..LoopRunResult::default() };
        let mut task = InPhase::new(params);
        let (mut progress, mut laps, mut on_loops_from_s) = (0.0, 0, None);
        for _ in 0..3000 {
            let wanted = task.next(PlateTime::from_secs(course.took_s), &parts);
            assert!(wanted.progress >= progress && wanted.laps >= laps, "{wanted:?}");
            (progress, laps) = (wanted.progress, wanted.laps);
            if wanted.done {
                course.on_loops_s = course.took_s - on_loops_from_s.unwrap_or(0.0);
                return course;
            }
            if !wanted.phase_error.is_empty() {
                on_loops_from_s.get_or_insert(course.took_s);
            }
            course.phase_error =
                wanted.phase_error.iter().fold(course.phase_error, |most, error| most.max(error.abs()));
            course.off_m = wanted.cross_track_m.iter().copied().fold(course.off_m, f64::max);
            for (i, part) in parts.iter_mut().enumerate() {
                let way = wanted.subgoals_m[i] - *part;
                let stray = Vec2::new(rng.random_range(-0.04..0.04), rng.random_range(-0.04..0.04)) * way.norm();
                *part += gain(i, course.took_s) * way.cap_magnitude(0.012) + stray;
            }
            for (a, b) in [(0, 1), (0, 2), (1, 2)] {
                course.gap_m = course.gap_m.min((parts[a] - parts[b]).norm() - 2.0 * PENNY_M);
            }
            course.took_s += rng.random_range(0.3..0.6);
        }
        panic!("not done: {course:?}");
    }

    #[test]
    fn three_go_round_one_figure_eight_in_step() {
        let course = run(three_on_one_eight(3), |_, _| 1.0);
        assert!(course.phase_error < 0.02 && course.off_m < 0.0015 && course.gap_m > 0.01, "{course:?}");
        assert!((course.on_loops_s - 90.0).abs() < 2.0, "they do not lag: {course:?}");
    }

    #[test]
    fn all_wait_for_one_that_is_held_up() {
        // the second part stands still for 5 s
        let held = |part: usize, at_s: f64| if part == 1 && (30.0..35.0).contains(&at_s) { 0.0 } else { 1.0 };
        let course = run(three_on_one_eight(2), held);
        let lap_m = Polyline::new(eight(0.0)).length_m();
        assert!(course.phase_error < (0.012 + 0.004) / lap_m && course.gap_m > 0.01, "{course:?}");
        assert!(course.on_loops_s > 63.0 && course.on_loops_s < 68.0, "{course:?}");
    }

    #[test]
    fn the_other_branch_of_the_crossing_is_not_taken_for_ones_own() {
        let mut task = InPhase::new(InPhaseParams { loops_m: vec![eight(0.0)], ..three_on_one_eight(0) });
        let firsts = [Vec2::zeros(), Vec2::new(0.1, 0.1), Vec2::new(-0.1, 0.1)];
        task.next(PlateTime::ZERO, &firsts);
        // half a lap on, the loop passes the same position again
        for (observe, x) in (1..).zip([0.001, -0.001, 0.0005]) {
            let seen = [Vec2::new(x, -x), firsts[1], firsts[2]];
            let wanted = task.next(PlateTime::from_secs(0.01 * f64::from(observe)), &seen);
            assert!(wanted.phase_error[0].abs() < 0.01 && wanted.phase_error[1..] == [0.0, 0.0], "{wanted:?}");
            assert_eq!(wanted.subgoals_m[1..], firsts[1..]);
        }
    }

    #[test]
    fn outputs_are_finite_for_nonfinite_inputs() {
        for period_s in [0.0, f64::NAN, f64::INFINITY, -1.0, 1e-300] {
            for parts in [&[][..], &[Vec2::new(f64::NAN, 0.0); 3], &[Vec2::zeros(); 4]] {
                let mut task = InPhase::new(InPhaseParams { period_s, arrive_m: 1.0, ..three_on_one_eight(2) });
                for observe in 0..5 {
                    let wanted = task.next(PlateTime::from_secs(f64::from(observe)), parts);
                    let numbers = wanted.subgoals_m.iter().flat_map(|p| p.iter()).chain(&wanted.cross_track_m);
                    assert!(numbers.chain(&wanted.phase_error).all(|x| x.is_finite()), "{wanted:?}");
                }
            }
        }
    }
}
