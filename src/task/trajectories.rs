use super::{Setpoints, Task};
use upm_core::geometry::{Polyline, Vec2};
use upm_core::time::PlateTime;

/// The path of one part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PathParams {
    /// Corners, m. A part without corners stays where it was first seen.
    pub waypoints_m: Vec<Vec2>,
    /// Speed along the path, m/s.
    pub speed_mps: f64,
    /// Number of passes through the waypoints, from the last straight back to the first, ending at the last; 0 for an
    /// endless path.
    pub repeat: u32,
}

/// Task that moves every part on its own path at its own speed. A reference point runs ahead on each path; it waits at
/// the first waypoint until the part has arrived, and wherever the part lags by more than the lead.
#[derive(Clone, Debug)]
pub struct Trajectories {
    paths: Vec<PathParams>,
    lead_m: f64,
    arrive_m: f64,
    followers: Vec<CurveFollower>,
    looked_at: Option<PlateTime>,
}

impl Trajectories {
    /// Task with path `i` for part `i`. `lead_m` is the largest distance from a part to its reference, `arrive_m` the
    /// distance within which a part has arrived.
    pub fn new(paths: Vec<PathParams>, lead_m: f64, arrive_m: f64) -> Self {
        Self { paths, lead_m, arrive_m, followers: Vec::new(), looked_at: None }
    }

    /// Creates the followers at the first observation; parts without a path get one without waypoints.
    fn meet(&mut self, parts_in_table_m: &[Vec2]) {
        self.followers.truncate(parts_in_table_m.len());
        for (i, part_m) in parts_in_table_m.iter().enumerate().skip(self.followers.len()) {
            let path = self.paths.get(i).cloned().unwrap_or_default();
            self.followers.push(CurveFollower::new(path, *part_m));
        }
    }

    fn phase(&self, done: bool) -> String {
        let of = self.followers.len();
        let on_path = self.followers.iter().filter(|f| f.leg == Leg::Path).count();
        let finished = self.followers.iter().filter(|f| f.finished(self.arrive_m)).count();
        match self.followers.iter().map(|f| f.path.repeat).max() {
            None => "no parts".into(),
            _ if done => "all paths followed to their ends".into(),
            _ if on_path < of => format!("to the first waypoints: {on_path} of {of} there"),
            Some(1) => format!("along the paths: {finished} of {of} at the end"),
            Some(_) => format!("round the paths, lap {}: {finished} of {of} at the end", u64::from(self.laps()) + 1),
        }
    }

    /// Laps completed by every part.
    fn laps(&self) -> u32 {
        self.followers.iter().map(|f| f.laps(self.arrive_m)).min().unwrap_or(0)
    }

    fn progress(&self, done: bool) -> f64 {
        if self.followers.is_empty() || self.followers.iter().any(|f| f.path.repeat == 0) {
            0.0
        } else if done {
            1.0
        } else {
            self.followers.iter().map(CurveFollower::progress).sum::<f64>() / self.followers.len() as f64
        }
    }
}

impl Task for Trajectories {
    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        self.meet(parts_in_table_m);
        let elapsed_s = self.looked_at.replace(now).map_or(0.0, |before| now.secs_since(before));
        for (follower, part_m) in self.followers.iter_mut().zip(parts_in_table_m) {
            follower.observe(*part_m);
            follower.advance(elapsed_s, self.lead_m, self.arrive_m);
        }
        let done = !self.followers.is_empty() && self.followers.iter().all(|f| f.finished(self.arrive_m));
        let of_each = |what: &dyn Fn(&CurveFollower) -> Vec2| self.followers.iter().map(what).collect::<Vec<_>>();
        Setpoints {
            subgoals_m: of_each(&CurveFollower::reference_m),
            targets_m: of_each(&CurveFollower::target_m),
            phase: self.phase(done),
            progress: self.progress(done),
            laps: self.laps(),
            cross_track_m: self.followers.iter().map(|f| f.cross_track_m(self.lead_m)).collect(),
            done,
            ..Setpoints::default()
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Leg {
    /// From the part's first position to the first waypoint.
    Approach,
    /// On the path itself.
    Path,
}

/// One part and its reference point.
#[derive(Clone, Debug)]
struct CurveFollower {
    path: PathParams,
    approach: Polyline,
    /// One lap: the waypoints and back to the first.
    lap: Polyline,
    /// Distance of the last waypoint along the lap, m.
    last_waypoint_at_m: f64,
    leg: Leg,
    /// Laps the reference has completed.
    laps_run: u32,
    /// Distance of the reference along its leg, m.
    reference_at_m: f64,
    /// Latest position of the part, m.
    part_m: Vec2,
}

impl CurveFollower {
    fn new(path: PathParams, part_m: Vec2) -> Self {
        let part_m = if is_finite(part_m) { part_m } else { Vec2::zeros() };
        let mut corners = path.waypoints_m.clone();
        if corners.is_empty() {
            corners.push(part_m);
        }
        let last_waypoint_at_m = Polyline::new(corners.clone()).length_m();
        let first = corners[0];
        corners.push(first);
        Self {
            approach: Polyline::new(vec![part_m, first]),
            lap: Polyline::new(corners),
            last_waypoint_at_m,
            path,
            leg: Leg::Approach,
            laps_run: 0,
            reference_at_m: 0.0,
            part_m,
        }
    }

    /// Records the part's position; the part keeps its last one when the new one is not finite.
    fn observe(&mut self, part_m: Vec2) {
        if is_finite(part_m) {
            self.part_m = part_m;
        }
    }

    fn advance(&mut self, elapsed_s: f64, lead_m: f64, arrive_m: f64) {
        // The distance from reference to part cannot grow by more than the reference moves along the path.
        let slack_m = lead_m - (self.reference_m() - self.part_m).norm();
        let mut ahead_m = (self.path.speed_mps * elapsed_s).min(slack_m).max(0.0);
        if self.leg == Leg::Approach {
            let rest_m = self.approach.length_m() - self.reference_at_m;
            self.reference_at_m += ahead_m.min(rest_m);
            if ahead_m < rest_m || !self.is_near(self.approach.at(f64::MAX), arrive_m) {
                return;
            }
            (self.leg, self.reference_at_m) = (Leg::Path, 0.0);
            ahead_m -= rest_m;
        }
        self.run(ahead_m);
    }

    /// Moves the reference along the laps, at most to the last waypoint of the last one.
    fn run(&mut self, ahead_m: f64) {
        let length_m = self.lap.length_m();
        if length_m == 0.0 {
            return;
        }
        let laps_left = if self.path.repeat == 0 { u32::MAX } else { self.path.repeat - 1 - self.laps_run };
        let end_m = f64::from(laps_left) * length_m + self.last_waypoint_at_m;
        let reached_m = (self.reference_at_m + ahead_m).min(end_m);
        let laps_now = ((reached_m / length_m) as u32).min(laps_left);
        self.laps_run = self.laps_run.saturating_add(laps_now);
        self.reference_at_m = (reached_m - f64::from(laps_now) * length_m).clamp(0.0, length_m);
    }

    fn is_near(&self, place_m: Vec2, arrive_m: f64) -> bool {
        (self.part_m - place_m).norm() <= arrive_m
    }

    fn on_last_lap(&self) -> bool {
        self.lap.length_m() == 0.0 || self.laps_run.checked_add(1) == Some(self.path.repeat)
    }

    /// True when reference and part are at the last waypoint of the last lap.
    fn finished(&self, arrive_m: f64) -> bool {
        self.path.repeat > 0
            && self.leg == Leg::Path
            && self.on_last_lap()
            && self.reference_at_m >= self.last_waypoint_at_m
            && self.is_near(self.reference_m(), arrive_m)
    }

    fn laps(&self, arrive_m: f64) -> u32 {
        if self.finished(arrive_m) { self.path.repeat } else { self.laps_run }
    }

    fn reference_m(&self) -> Vec2 {
        match self.leg {
            Leg::Approach => self.approach.at(self.reference_at_m),
            Leg::Path => self.lap.at(self.reference_at_m),
        }
    }

    fn target_m(&self) -> Vec2 {
        match self.leg {
            Leg::Approach => self.approach.at(f64::MAX),
            Leg::Path if self.path.repeat == 0 => self.lap.at(f64::MAX),
            Leg::Path => self.lap.at(self.last_waypoint_at_m),
        }
    }

    /// Fraction of approach and laps that the reference has completed.
    fn progress(&self) -> f64 {
        let (approach_m, lap_m) = (self.approach.length_m(), self.lap.length_m());
        let total_m = approach_m + f64::from(self.path.repeat.saturating_sub(1)) * lap_m + self.last_waypoint_at_m;
        let done_m = match self.leg {
            Leg::Approach => self.reference_at_m,
            Leg::Path => approach_m + f64::from(self.laps_run) * lap_m + self.reference_at_m,
        };
        if total_m > 0.0 { (done_m / total_m).min(1.0) } else { 0.0 }
    }

    /// Distance from the relevant section of the path, m: up to twice the lead behind the reference.
    fn cross_track_m(&self, lead_m: f64) -> f64 {
        if self.leg == Leg::Approach || self.path.waypoints_m.is_empty() {
            return 0.0;
        }
        let from_m = self.reference_at_m - 2.0 * lead_m;
        let here_m = self.lap.distance_m(self.part_m, from_m.max(0.0), self.reference_at_m);
        if from_m < 0.0 && self.laps_run > 0 {
            let length_m = self.lap.length_m();
            here_m.min(self.lap.distance_m(self.part_m, (length_m + from_m).max(0.0), length_m))
        } else {
            here_m
        }
    }
}

fn is_finite(p: Vec2) -> bool {
    p.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::RngExt;
    use upm_core::random::Streams;

    const LEAD_M: f64 = 0.006;
    const ARRIVE_M: f64 = 0.0005;
    const CYCLE_S: f64 = 0.25;

    fn square(side_m: f64) -> Vec<Vec2> {
        [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| Vec2::new(x, y) * side_m).to_vec()
    }

    /// Runs a task to its end, with parts moving as `step` returns; returns the time it took, s.
    fn run(paths: Vec<PathParams>, starts: Vec<Vec2>, mut step: impl FnMut(usize, Vec2, Vec2) -> Vec2) -> f64 {
        let (mut task, mut parts, mut progress) = (Trajectories::new(paths, LEAD_M, ARRIVE_M), starts, 0.0);
        let mut cycle = 0;
        loop {
            assert!(cycle < 4000, "not done: {:?}", task.followers);
            let at = PlateTime::from_secs(f64::from(cycle) * CYCLE_S);
            let wanted = task.next(at, &parts);
            assert!(wanted.progress >= progress && wanted.progress <= 1.0, "{wanted:?} after {progress}");
            progress = wanted.progress;
            if wanted.done {
                for (part, target) in parts.iter().zip(&wanted.targets_m) {
                    assert!((part - target).norm() <= ARRIVE_M);
                }
                return at.secs();
            }
            for (i, part) in parts.iter_mut().enumerate() {
                *part = step(i, *part, wanted.subgoals_m[i]);
                assert!(part.iter().all(|x| x.is_finite()));
            }
            cycle += 1;
        }
    }

    #[test]
    fn a_perfect_part_keeps_the_speed() {
        let path = |repeat| PathParams { waypoints_m: square(0.04), speed_mps: 0.01, repeat };
        // An approach of 20 mm, then three sides of the last lap and four of each before; each stop to arrive costs a
        // cycle.
        for (repeat, length_m) in [(1, 0.02 + 0.12), (2, 0.02 + 0.28), (3, 0.02 + 0.44)] {
            let took_s = run(vec![path(repeat)], vec![Vec2::new(-0.02, 0.0)], |_, _, subgoal| subgoal);
            assert!((took_s - length_m / 0.01).abs() <= 2.5 * CYCLE_S, "{repeat}: {took_s}");
        }
    }

    #[test]
    fn laps_are_counted_and_round_trips_have_no_end() {
        let paths = vec![PathParams { waypoints_m: square(0.01), speed_mps: 0.01, repeat: 0 }];
        let (mut task, mut part) = (Trajectories::new(paths, LEAD_M, ARRIVE_M), Vec2::zeros());
        for cycle in 0..=400 {
            let wanted = task.next(PlateTime::from_secs(f64::from(cycle) * CYCLE_S), &[part]);
            part = wanted.subgoals_m[0];
            assert!(!wanted.done && wanted.progress == 0.0 && wanted.cross_track_m[0] < 1e-12 + 0.0025);
            let around = f64::from(cycle) * CYCLE_S * 0.01 / 0.04;
            assert!((f64::from(wanted.laps) - around).abs() <= 1.1, "{} laps after {around}", wanted.laps);
        }
    }

    #[test]
    fn the_reference_waits_for_a_part_that_is_stuck() {
        let paths = vec![PathParams { waypoints_m: square(0.04), speed_mps: 0.01, repeat: 1 }];
        let mut task = Trajectories::new(paths, LEAD_M, ARRIVE_M);
        let stuck = Vec2::new(-0.02, 0.0);
        for cycle in 0..100 {
            let wanted = task.next(PlateTime::from_secs(f64::from(cycle) * CYCLE_S), &[stuck]);
            assert!((wanted.subgoals_m[0] - stuck).norm() <= LEAD_M + 1e-12);
        }
    }

    #[test]
    fn cross_track_is_the_distance_from_the_path() {
        let paths = vec![PathParams { waypoints_m: square(0.04), speed_mps: 0.01, repeat: 1 }];
        let mut task = Trajectories::new(paths, LEAD_M, ARRIVE_M);
        task.next(PlateTime::ZERO, &[Vec2::zeros()]);
        let wanted = task.next(PlateTime::from_secs(0.4), &[Vec2::new(0.002, 0.001)]);
        assert!((wanted.cross_track_m[0] - 0.001).abs() < 1e-12, "{wanted:?}");
    }

    #[test]
    fn parts_without_a_path_stay() {
        let still = Vec2::new(0.03, 0.03);
        let paths = vec![PathParams { waypoints_m: square(0.01), speed_mps: 0.01, repeat: 0 }, PathParams::default()];
        let mut task = Trajectories::new(paths, LEAD_M, ARRIVE_M);
        for cycle in 0..20 {
            let wanted = task.next(PlateTime::from_secs(f64::from(cycle) * CYCLE_S), &[Vec2::zeros(), still, -still]);
            assert_eq!(wanted.subgoals_m[1..], [still, -still]);
            assert_eq!(wanted.cross_track_m[1..], [0.0, 0.0]);
        }
    }

    fn any_path() -> impl Strategy<Value = PathParams> {
        let corner = (-0.08..0.08f64, -0.08..0.08f64).prop_map(|(x, y)| Vec2::new(x, y));
        (proptest::collection::vec(corner, 1..5), 0.004..0.03f64, 1u32..3)
            .prop_map(|(waypoints_m, speed_mps, repeat)| PathParams { waypoints_m, speed_mps, repeat })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn noisy_parts_finish_their_paths(paths in proptest::collection::vec(any_path(), 1..4), seed in 0u64..1000) {
            let mut rng = Streams::new(seed).stream("walk");
            let starts = paths.iter().map(|_| Vec2::new(rng.random_range(-0.08..0.08), rng.random_range(-0.08..0.08))).collect();
            let took_s = run(paths.clone(), starts, |_, part, subgoal| {
                let noise = Vec2::new(rng.random_range(-0.0003..0.0003), rng.random_range(-0.0003..0.0003));
                part + rng.random_range(0.7..1.2) * (subgoal - part) + noise
            });
            // No reference exceeds its speed.
            for path in &paths {
                let follower = CurveFollower::new(path.clone(), path.waypoints_m[0]);
                let length_m = f64::from(path.repeat - 1) * follower.lap.length_m() + follower.last_waypoint_at_m;
                prop_assert!(took_s >= length_m / path.speed_mps - CYCLE_S);
            }
        }

        #[test]
        fn outputs_are_finite_for_nonfinite_inputs(
            paths in proptest::collection::vec(any_path(), 0..3), speed_mps in prop_oneof![Just(0.0), Just(f64::NAN), Just(-1.0), Just(1e300)],
            seen in proptest::collection::vec(prop_oneof![Just(f64::NAN), Just(f64::INFINITY), -0.1..0.1f64], 24),
        ) {
            let paths = paths.into_iter().map(|path| PathParams { speed_mps, ..path }).collect();
            let mut task = Trajectories::new(paths, LEAD_M, ARRIVE_M);
            for (cycle, six) in (0u32..).zip(seen.chunks(6)) {
                let parts: Vec<Vec2> = six.chunks(2).map(|p| Vec2::new(p[0], p[1])).collect();
                let wanted = task.next(PlateTime::from_secs(f64::from(cycle)), &parts);
                for p in wanted.subgoals_m.iter().chain(&wanted.targets_m) {
                    prop_assert!(is_finite(*p));
                }
                prop_assert!(wanted.cross_track_m.iter().all(|x| x.is_finite()) && wanted.progress.is_finite());
            }
        }
    }
}
