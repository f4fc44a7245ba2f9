use super::path_follower::{PathFollower, PlateScene};
use super::room::places_beside;
use super::{LateLap, PartOutline, PathStretch, Setpoints, Task};
use upm_core::geometry::{Polyline, Segment, Vec2};
use upm_core::time::PlateTime;

/// Assumed length of a cycle before the first was measured, s.
const FIRST_CYCLE_S: f64 = 0.5;
/// Half width of the search for a part along its path, around the reference, in leads and strides: narrow enough to
/// exclude the other pass through a crossing.
const SEARCHED: f64 = 2.0;
/// Share of the corridor by which a straight step may cut the path; the rest allows for the part's own deviation.
const CUT: f64 = 0.4;
/// Bisections for the length of a step that cuts the path by no more than that.
const HALVINGS: usize = 8;
/// Rounding of lengths over many laps, m.
const ROUNDING_M: f64 = 1e-9;
/// A lap is late when its speed is below this share of the speed asked.
const IN_TIME: f64 = 0.97;

/// The path of one part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PathParams {
    /// Corners, m. A part without corners stays where it was first seen, and makes room where it lies on a path.
    pub waypoints_m: Vec<Vec2>,
    /// Speed along the path, m/s of plate time.
    pub speed_mps: f64,
    /// Number of passes through the waypoints, from the last straight back to the first; 0 for an endless path.
    pub repeat: u32,
    /// True where the part may exchange its path with another of its kind, so that ways to the first points are short.
    pub exchange: bool,
}

impl PathParams {
    /// The whole way of a part, once.
    pub fn line(&self, is_closed: bool) -> Polyline {
        let back = self.waypoints_m.get(..1).filter(|_| is_closed || self.repeat != 1);
        Polyline::new([&self.waypoints_m, back.unwrap_or_default()].concat())
    }

    /// Length of all passes, m, the last one back to the first waypoint if `is_closed`; infinite for an endless path.
    pub fn length_m(&self, is_closed: bool) -> f64 {
        let Some(laps) = self.repeat.checked_sub(1) else { return f64::INFINITY };
        let lap_m = self.line(true).length_m();
        let last_m = if is_closed { lap_m } else { Polyline::new(self.waypoints_m.clone()).length_m() };
        f64::from(laps) * lap_m + last_m
    }
}

/// Mean speed of the part that has furthest to go to its first waypoint, m/s: 25 to 78 mm/s in the shipped jobs.
const APPROACH_MPS: f64 = 40e-3;

/// Parameters of parts on paths.
#[derive(Clone, Debug, Default)]
pub struct TrajectoriesParams {
    /// The plate and its parts.
    pub scene: PlateScene,
    /// Path of each part.
    pub paths: Vec<PathParams>,
    /// True if all have completed the same fraction of their laps at any time. Each pass then ends at the first
    /// waypoint, otherwise the last pass ends at the last one.
    pub in_phase: bool,
    /// Lead of a reference over its part, beyond which it waits, m.
    pub lead_m: f64,
    /// Largest distance along the path from a part to its subgoal, m.
    pub stride_m: f64,
    /// Distance from a waypoint within which a part has arrived, m.
    pub arrive_m: f64,
    /// Largest distance from the path, m.
    pub corridor_m: f64,
}

/// Task that follows [`TrajectoriesParams`]. First all parts go to the first waypoints of their paths; from then on a
/// reference runs along each path in plate time, and waits where its part lags. A subgoal is the reference's position
/// at the end of the cycle.
#[derive(Clone, Debug, Default)]
pub struct Trajectories {
    params: TrajectoriesParams,
    approach: Option<PathFollower>,
    followers: Vec<CurveFollower>,
    begun_at: Option<PlateTime>,
    /// Share of the way to the first waypoints in the time of the task; 0 without end.
    approach_share: f64,
    lap_begun_at: PlateTime,
    laps: u32,
    late_lap: Option<LateLap>,
    looked_at: Option<PlateTime>,
    /// Running mean of the length of a cycle, s.
    cycle_s: f64,
}

impl Trajectories {
    /// A new task with these parameters.
    pub fn new(params: TrajectoriesParams) -> Self {
        Self { params, cycle_s: FIRST_CYCLE_S, ..Self::default() }
    }

    fn begin(&mut self, parts_in_table_m: &[Vec2]) -> PathFollower {
        let TrajectoriesParams { scene, paths, in_phase, corridor_m, .. } = &self.params;
        let finite_m = |part_m: &Vec2| if part_m.iter().all(|x| x.is_finite()) { *part_m } else { Vec2::zeros() };
        let seen_m: Vec<Vec2> = parts_in_table_m.iter().map(finite_m).collect();
        let line = |path: &PathParams| (!path.waypoints_m.is_empty()).then(|| path.line(*in_phase));
        let firsts_m = places_beside(scene, &paths.iter().map(line).collect::<Vec<_>>(), *corridor_m, &seen_m);
        let follower = |(i, first_m): (usize, &Vec2)| {
            let path = paths.get(i).filter(|path| !path.waypoints_m.is_empty()).cloned();
            let stays = || PathParams { waypoints_m: vec![*first_m], repeat: 1, ..PathParams::default() };
            CurveFollower::new(path.unwrap_or_else(stays), *in_phase)
        };
        self.followers = firsts_m.iter().enumerate().map(follower).collect();
        self.begun_at = None;
        let may = |i: usize| paths.get(i).is_some_and(|path| path.exchange);
        let group = |(i, disc): (usize, &PartOutline)| if may(i) { disc.kind } else { usize::MAX - i };
        let groups = scene.discs.iter().enumerate().map(group).collect();
        let approach = PathFollower::new(scene, &firsts_m, groups, parts_in_table_m);
        let approach_s = approach.distances_m().fold(0.0, f64::max) / APPROACH_MPS;
        let on_paths_s = self.followers.iter().filter(|follower| follower.end_m > 0.0);
        let on_paths_s = on_paths_s.map(|follower| follower.end_m / follower.speed_mps).fold(0.0, f64::max);
        self.approach_share = approach_s / (approach_s + on_paths_s).max(f64::MIN_POSITIVE);
        approach
    }

    /// Moves the references on by `elapsed_s` and the subgoals ahead of them.
    fn advance(&mut self, seen_m: &[Vec2], elapsed_s: f64) {
        let TrajectoriesParams { lead_m, stride_m, corridor_m, in_phase, .. } = self.params;
        for (follower, part_m) in self.followers.iter_mut().zip(seen_m) {
            follower.find(*part_m, SEARCHED * (lead_m + stride_m));
            let held_m = (follower.reference_m + follower.speed_mps * elapsed_s).min(follower.along_m + lead_m);
            follower.reference_m = held_m.max(follower.reference_m).min(follower.end_m);
        }
        self.align(in_phase, |follower| &mut follower.reference_m);
        for follower in &mut self.followers {
            let ahead_m = (follower.reference_m + follower.speed_mps * self.cycle_s).min(follower.along_m + stride_m);
            follower.ahead_m = follower.uncut_m(ahead_m.min(follower.end_m), CUT * corridor_m);
        }
        self.align(in_phase, |follower| &mut follower.ahead_m);
    }

    /// Brings a length of every path to the least fraction of a lap among them, where the parts are in phase.
    fn align(&mut self, in_phase: bool, length_m: impl Fn(&mut CurveFollower) -> &mut f64) {
        let moving = self.followers.iter_mut().filter(|follower| in_phase && follower.lap_m() > 0.0);
        let share = moving.map(|follower| *length_m(follower) / follower.lap_m()).reduce(f64::min);
        if let Some(share) = share {
            self.followers.iter_mut().for_each(|follower| *length_m(follower) = share * follower.lap_m());
        }
    }

    /// Counts the laps that every part has completed, and compares the time of the last with the time asked.
    fn count_laps(&mut self, now: PlateTime) {
        let moving = || self.followers.iter().filter(|follower| follower.lap_m() > 0.0);
        let laps = moving().map(CurveFollower::laps).min().unwrap_or(0);
        if laps > self.laps {
            let asked_s = moving().map(|follower| follower.lap_m() / follower.speed_mps).fold(0.0, f64::max);
            let took_s = now.secs_since(self.lap_begun_at) / f64::from(laps - self.laps);
            self.late_lap = (asked_s < IN_TIME * took_s).then_some(LateLap { lap: laps, took_s, asked_s });
            (self.laps, self.lap_begun_at) = (laps, now);
        }
    }

    /// Speed of the whole task as a share of the speed asked; 1 without a path.
    fn speed_share(&self, now: PlateTime) -> f64 {
        let asked_s = self.followers.iter().filter(|follower| follower.end_m > 0.0);
        let asked_s = asked_s.map(|follower| follower.end_m / follower.speed_mps).fold(0.0, f64::max);
        let took_s = self.begun_at.map_or(0.0, |begun_at| now.secs_since(begun_at));
        if took_s > asked_s { asked_s / took_s } else { 1.0 }
    }

    fn phase(&self, now: PlateTime, done: bool, finished: usize) -> String {
        let repeats = || self.params.paths.iter().map(|path| path.repeat);
        match self.speed_share(now) {
            share if done && share < IN_TIME => {
                return format!("all paths followed to their ends, at {:.0} % of the speed asked", 100.0 * share);
            }
            _ if done => return "all paths followed to their ends".into(),
            _ => {}
        }
        let (lap, of) = (u64::from(self.laps) + 1, self.followers.len());
        match (self.params.in_phase, repeats().max().unwrap_or(0), repeats().min().unwrap_or(0)) {
            (true, _, 0) => format!("round the paths in phase, lap {lap}"),
            (true, laps, _) => format!("round the paths in phase, lap {lap} of {laps}"),
            (false, 1, 1) => format!("along the paths: {finished} of {of} at the end"),
            (false, ..) => format!("round the paths, lap {lap}: {finished} of {of} at the end"),
        }
    }

    /// Setpoints on the paths, `elapsed_s` after the previous observation.
    fn on_paths(&mut self, now: PlateTime, seen_m: &[Vec2], elapsed_s: f64) -> Setpoints {
        let TrajectoriesParams { arrive_m, in_phase, .. } = self.params;
        self.advance(seen_m, elapsed_s);
        self.count_laps(now);
        let is_at_end = |(follower, part_m): &(&CurveFollower, &Vec2)| follower.finished(**part_m, arrive_m);
        let finished = self.followers.iter().zip(seen_m).filter(is_at_end).count();
        let done = finished == self.followers.len();
        let of_each = |what: &dyn Fn(&CurveFollower) -> f64| self.followers.iter().map(what).collect::<Vec<_>>();
        let (gone_m, end_m) =
            (of_each(&|f| f.reference_m).iter().sum::<f64>(), of_each(&|f| f.end_m).iter().sum::<f64>());
        let gone = if end_m > 0.0 && end_m.is_finite() { (gone_m / end_m).clamp(0.0, 1.0) } else { 0.0 };
        let phase_error =
            |f: &CurveFollower| if f.lap_m() > 0.0 { (f.along_m - f.reference_m) / f.lap_m() } else { 0.0 };
        let stretches = self.followers.iter().zip(seen_m);
        Setpoints {
            subgoals_m: self.followers.iter().map(|f| f.place_m(f.ahead_m)).collect(),
            targets_m: self.followers.iter().map(CurveFollower::target_m).collect(),
            phase: self.phase(now, done, finished),
            progress: if done { 1.0 } else { self.approach_share + (1.0 - self.approach_share) * gone },
            laps: if done { self.params.paths.iter().map(|path| path.repeat).max().unwrap_or(0) } else { self.laps },
            cross_track_m: of_each(&|f| f.off_m),
            paths: stretches.map(|(f, part_m)| f.stretch(*part_m, &self.params)).collect(),
            late_lap: self.late_lap,
            phase_error: if in_phase { of_each(&phase_error) } else { Vec::new() },
            done,
            ..Setpoints::default()
        }
    }
}

impl Task for Trajectories {
    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let of = parts_in_table_m.len();
        let elapsed_s = self.looked_at.replace(now).map_or(0.0, |before| now.secs_since(before).max(0.0));
        if elapsed_s > 0.0 {
            self.cycle_s = 0.5 * (self.cycle_s + elapsed_s);
        }
        let mut approach = match self.approach.take().filter(|approach| approach.seen_m.len() == of) {
            Some(approach) => approach,
            None => self.begin(parts_in_table_m),
        };
        let begins = self.begun_at.is_none();
        if begins {
            approach.observe(parts_in_table_m);
            if of > 0 && approach.distances_m().all(|distance_m| distance_m <= self.params.arrive_m) {
                (self.begun_at, self.lap_begun_at) = (Some(now), now);
                self.followers = approach.place_of.iter().map(|&path| self.followers[path].clone()).collect();
            }
        }
        let wanted = if self.begun_at.is_none() {
            let there = approach.distances_m().filter(|distance_m| *distance_m <= self.params.arrive_m).count();
            let wanted = approach.wanted("to the first waypoints", there);
            Setpoints { progress: self.approach_share * wanted.progress, ..wanted }
        } else {
            approach.see(parts_in_table_m);
            self.on_paths(now, &approach.seen_m, if begins { 0.0 } else { elapsed_s })
        };
        self.approach = Some(approach);
        wanted
    }
}

/// One part on its path. Arc lengths count over all laps, m.
#[derive(Clone, Debug)]
struct CurveFollower {
    /// One lap: the waypoints and back to the first.
    lap: Polyline,
    speed_mps: f64,
    /// Arc length of the path's end; infinite for an endless one.
    end_m: f64,
    reference_m: f64,
    /// Arc length of the part's foot, and the part's distance from it, m.
    along_m: f64,
    off_m: f64,
    /// Arc length of the subgoal.
    ahead_m: f64,
}

impl CurveFollower {
    fn new(path: PathParams, is_closed: bool) -> Self {
        let (lap, end_m) = (path.line(true), path.length_m(is_closed));
        let speed_mps = if path.speed_mps.is_finite() { path.speed_mps.max(0.0) } else { 0.0 };
        Self { lap, speed_mps, end_m, reference_m: 0.0, along_m: 0.0, off_m: 0.0, ahead_m: 0.0 }
    }

    fn lap_m(&self) -> f64 {
        self.lap.length_m()
    }

    fn place_m(&self, along_m: f64) -> Vec2 {
        if self.lap_m() > 0.0 { self.lap.at(self.lap_of(along_m).1) } else { self.lap.at(0.0) }
    }

    /// Laps completed at an arc length, and the rest of it; the end of the path is the end of its lap.
    fn lap_of(&self, along_m: f64) -> (f64, f64) {
        let laps = (along_m / self.lap_m()).floor();
        (laps, along_m - laps * self.lap_m())
    }

    /// Finds the part's foot near the reference.
    fn find(&mut self, part_m: Vec2, searched_m: f64) {
        if self.lap_m() > 0.0 {
            let searched_m = searched_m.min(0.25 * self.lap_m());
            let found = self.lap.nearest_around(part_m, self.reference_m, searched_m, self.ahead_m);
            (self.along_m, self.off_m) = (found.0.clamp(0.0, self.end_m), found.1);
        }
    }

    /// The largest arc length up to `ahead_m` to which a straight step from the part's foot stays within `cut_m` of the
    /// path.
    fn uncut_m(&self, ahead_m: f64, cut_m: f64) -> f64 {
        let (mut low_m, mut high_m) = (self.along_m.min(ahead_m), ahead_m.max(self.along_m));
        let cuts = |to_m: f64| {
            let step = Segment { from: self.place_m(self.along_m), to: self.place_m(to_m) };
            self.lap.stretch(self.along_m, to_m).points_m().iter().any(|&corner| step.distance(corner) > cut_m)
        };
        if self.lap_m() == 0.0 || !cuts(high_m) {
            return high_m;
        }
        for _ in 0..HALVINGS {
            let middle_m = 0.5 * (low_m + high_m);
            if cuts(middle_m) { high_m = middle_m } else { low_m = middle_m }
        }
        low_m
    }

    fn laps(&self) -> u32 {
        self.lap_of(self.along_m.min(self.reference_m) + ROUNDING_M).0.max(0.0) as u32
    }

    fn target_m(&self) -> Vec2 {
        if self.end_m.is_finite() { self.place_m(self.end_m) } else { self.lap.at(0.0) }
    }

    /// True when reference and part are at the end of the path.
    fn finished(&self, part_m: Vec2, arrive_m: f64) -> bool {
        self.reference_m > self.end_m - ROUNDING_M && (part_m - self.target_m()).norm() <= arrive_m
    }

    fn stretch(&self, part_m: Vec2, params: &TrajectoriesParams) -> Option<PathStretch> {
        let TrajectoriesParams { lead_m: beyond_m, arrive_m, corridor_m, .. } = *params;
        if self.lap_m() == 0.0 {
            return None;
        }
        let from_m = (self.along_m - beyond_m).max(0.0);
        let line = self.lap.stretch(from_m, (self.ahead_m.max(self.along_m) + beyond_m).min(self.end_m));
        let (reference_m, speed_mps) = (self.reference_m, self.speed_mps);
        let is_over = self.finished(part_m, arrive_m);
        Some(PathStretch { line, from_m, reference_m, speed_mps, lap_m: self.lap_m(), corridor_m, is_over })
    }
}

#[cfg(test)]
mod tests;
