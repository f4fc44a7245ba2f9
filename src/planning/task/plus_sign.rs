use super::{PathStretch, Setpoints, Task};
use upm_core::geometry::{Polyline, Vec2};
use upm_core::time::PlateTime;

/// Parameters of the paper's first task (section 3.4, Fig. 13): one part goes to the centre by translations along x,
/// then y, and then follows the branches of a plus sign clockwise: out to the edge, back to the centre, next branch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlusSignParams {
    /// Half the plate's side, m.
    pub half_side_m: f64,
    /// Radius of the part's outline, m.
    pub part_radius_m: f64,
    /// Distance of the part's rim from the plate's edge at the end of a branch, m.
    pub edge_margin_m: f64,
    /// Laps of four branches; 0 for an endless task.
    pub laps: u32,
    /// Distance from the end of a segment within which the part has arrived, m.
    pub arrive_m: f64,
    /// Largest distance from the part to its subgoal ahead, m.
    pub stride_m: f64,
    /// Largest distance from the path, m.
    pub corridor_m: f64,
}

/// Directions of the branches, clockwise from -x.
const BRANCHES: [(Vec2, &str); 4] = [
    (Vec2::new(-1.0, 0.0), "-x"),
    (Vec2::new(0.0, 1.0), "+y"),
    (Vec2::new(1.0, 0.0), "+x"),
    (Vec2::new(0.0, -1.0), "-y"),
];

/// Legs to the centre before the first lap: along x, then along y.
const CENTRING: u64 = 2;
/// Legs of a lap: outwards and back on each branch.
const LAP: u64 = 8;

/// Straight section of the path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct PathSegment {
    from_m: Vec2,
    to_m: Vec2,
}

impl PathSegment {
    fn length_m(&self) -> f64 {
        (self.to_m - self.from_m).norm()
    }

    /// Unit vector along it; zero when it has no length.
    fn direction(&self) -> Vec2 {
        (self.to_m - self.from_m).try_normalize(0.0).unwrap_or_default()
    }

    /// Distance of `p_m` along it, m: negative before the start, more than the length past the end.
    fn along_m(&self, p_m: Vec2) -> f64 {
        (p_m - self.from_m).dot(&self.direction())
    }

    /// The point `stride_m` ahead of the foot of `p_m`, at most the end.
    fn carrot_m(&self, p_m: Vec2, stride_m: f64) -> Vec2 {
        let foot_m = self.along_m(p_m).clamp(0.0, self.length_m());
        self.from_m + self.direction() * (foot_m + stride_m).min(self.length_m())
    }
}

/// Task that follows [`PlusSignParams`]. It steers the first part; others keep their first position as subgoal.
#[derive(Clone, Debug, Default)]
pub struct PlusSign {
    params: PlusSignParams,
    /// Number of legs driven.
    leg: u64,
    segment: PathSegment,
    /// Beginning of the segment before it, m, and the length of all before it, m.
    before_m: Vec2,
    gone_m: f64,
    /// Latest position of each part, m.
    seen_m: Vec<Vec2>,
    /// First position of each part, m.
    first_seen_m: Vec<Vec2>,
    /// Furthest progress along the present segment, as a fraction of its length.
    furthest: f64,
}

impl PlusSign {
    /// A new task with these parameters. A branch too short for the part has no length.
    pub fn new(params: PlusSignParams) -> Self {
        Self { params, ..Self::default() }
    }

    /// Distance of the part's centre from the plate's centre at the end of a branch, m.
    pub fn reach_m(&self) -> f64 {
        let PlusSignParams { half_side_m, part_radius_m, edge_margin_m, .. } = self.params;
        (half_side_m - part_radius_m - edge_margin_m).max(0.0)
    }

    /// Records the parts' positions; a part keeps its last one when the new one is not finite.
    fn observe(&mut self, parts_in_table_m: &[Vec2]) {
        let begins = self.first_seen_m.is_empty();
        self.seen_m.resize(parts_in_table_m.len(), Vec2::zeros());
        for (seen, part) in self.seen_m.iter_mut().zip(parts_in_table_m) {
            if part.iter().all(|x| x.is_finite()) {
                *seen = *part;
            }
        }
        self.first_seen_m.truncate(self.seen_m.len());
        self.first_seen_m.extend(self.seen_m.iter().skip(self.first_seen_m.len()).copied());
        if begins {
            let start = self.seen_m.first().copied().unwrap_or_default();
            (self.segment, self.before_m) = (PathSegment { from_m: start, to_m: Vec2::new(0.0, start.y) }, start);
        }
    }

    /// Number of legs; the largest number for endless laps.
    fn legs(&self) -> u64 {
        match self.params.laps {
            0 => u64::MAX,
            laps => CENTRING + LAP * u64::from(laps),
        }
    }

    fn is_done(&self) -> bool {
        self.leg == self.legs()
    }

    /// Laps driven, the present branch, and whether the part is on its way back; `None` before the first lap.
    fn place(&self) -> Option<(u32, usize, bool)> {
        let leg = self.leg.checked_sub(CENTRING)?;
        Some(((leg / LAP) as u32, (leg % LAP / 2) as usize, leg % 2 == 1))
    }

    fn arrived(&self, part_m: Vec2) -> bool {
        let arrive_m = self.params.arrive_m;
        if self.leg + 1 == self.legs() {
            return (part_m - self.segment.to_m).norm() <= arrive_m;
        }
        !self.is_done() && self.segment.along_m(part_m) >= self.segment.length_m() - arrive_m
    }

    fn advance(&mut self, part_m: Vec2) {
        (self.before_m, self.gone_m) = (self.segment.from_m, self.gone_m + self.segment.length_m());
        self.leg += 1;
        let centre = Vec2::zeros();
        let (from_m, to_m) = match self.place() {
            None => (Vec2::new(0.0, part_m.y), centre),
            Some(_) if self.is_done() => (centre, centre),
            Some((_, branch, false)) => (centre, self.tip_m(branch)),
            Some((_, branch, true)) => (self.tip_m(branch), centre),
        };
        self.segment = PathSegment { from_m, to_m };
        self.furthest = 0.0;
    }

    fn tip_m(&self, branch: usize) -> Vec2 {
        BRANCHES[branch].0 * self.reach_m()
    }

    fn progress(&self) -> f64 {
        if self.params.laps == 0 || self.is_done() {
            return if self.is_done() { 1.0 } else { 0.0 };
        }
        let start_m = self.first_seen_m.first().copied().unwrap_or_default();
        let all_m = start_m.x.abs() + start_m.y.abs() + 8.0 * self.reach_m() * f64::from(self.params.laps);
        let gone_m = self.gone_m + self.furthest * self.segment.length_m();
        (gone_m / all_m.max(f64::MIN_POSITIVE)).min(1.0)
    }

    fn phase(&self) -> String {
        let Some((laps, branch, back)) = self.place() else {
            return format!("to the centre, along {}", if self.leg == 0 { "x" } else { "y" });
        };
        match self.params.laps {
            1 if self.is_done() => return "1 lap driven".into(),
            of if self.is_done() => return format!("{of} laps driven"),
            _ => {}
        }
        let of = if self.params.laps == 0 { String::new() } else { format!(" of {}", self.params.laps) };
        let way = if back { "back" } else { "outwards" };
        format!("lap {}{of}: branch {}, {way}", u64::from(laps) + 1, BRANCHES[branch].1)
    }

    /// The present segment and the one before it round a corner: a part that has arrived short of it is still on that.
    fn stretch(&self) -> PathStretch {
        let before_m = if matches!(self.place(), Some((.., true))) { self.segment.from_m } else { self.before_m };
        let line = Polyline::new(vec![before_m, self.segment.from_m, self.segment.to_m]);
        let from_m = self.gone_m - (self.segment.from_m - before_m).norm();
        PathStretch {
            is_over: false,
            line,
            from_m,
            reference_m: self.gone_m,
            speed_mps: 0.0,
            lap_m: 8.0 * self.reach_m(),
            corridor_m: self.params.corridor_m,
        }
    }
}

impl Task for PlusSign {
    fn next(&mut self, _now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        self.observe(parts_in_table_m);
        let Some(part_m) = self.seen_m.first().copied() else {
            return Setpoints { phase: "no part".into(), ..Setpoints::default() };
        };
        // From any position at most both centring segments and one more segment are over at once.
        for _ in 0..3 {
            if self.arrived(part_m) {
                self.advance(part_m);
            }
        }
        let length_m = self.segment.length_m();
        let along = if length_m > 0.0 { (self.segment.along_m(part_m) / length_m).clamp(0.0, 1.0) } else { 0.0 };
        self.furthest = self.furthest.max(along);
        let mut wanted = Setpoints {
            subgoals_m: self.first_seen_m.clone(),
            targets_m: self.first_seen_m.clone(),
            phase: self.phase(),
            progress: self.progress(),
            laps: self.place().map_or(0, |(laps, ..)| laps),
            cross_track_m: vec![0.0; parts_in_table_m.len()],
            paths: vec![None; parts_in_table_m.len()],
            done: self.is_done(),
            ..Setpoints::default()
        };
        wanted.subgoals_m[0] = self.segment.carrot_m(part_m, self.params.stride_m);
        wanted.targets_m[0] = self.segment.to_m;
        let stretch = self.stretch();
        wanted.cross_track_m[0] = stretch.nearest(part_m).1;
        wanted.paths[0] = Some(stretch).filter(|_| !wanted.done);
        wanted
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::RngExt;
    use upm_core::geometry::cross;
    use upm_core::random::Streams;

    const PARAMS: PlusSignParams = PlusSignParams {
        half_side_m: 0.1016,
        part_radius_m: crate::task::PENNY_M,
        edge_margin_m: 0.003,
        laps: 2,
        arrive_m: 0.0005,
        stride_m: 0.008,
        corridor_m: 0.0005,
    };

    /// Follows a plus sign until it is done; returns the ends of the branches' segments and the number of cycles.
    fn follow(params: PlusSignParams, start_m: Vec2, mut step: impl FnMut(Vec2, Vec2) -> Vec2) -> (Vec<Vec2>, usize) {
        let (mut task, mut part_m, mut ends) = (PlusSign::new(params), start_m, Vec::new());
        let (mut leg, mut progress) = (task.leg, 0.0);
        let mut cycle = 0;
        loop {
            assert!(cycle < 5000, "not done: leg {leg}");
            let wanted = task.next(PlateTime::ZERO, &[part_m]);
            let before = std::mem::replace(&mut leg, task.leg);
            if before != leg && before >= CENTRING {
                ends.push(part_m);
            }
            assert!(wanted.progress >= progress && wanted.progress <= 1.0, "{wanted:?}");
            progress = wanted.progress;
            if wanted.done {
                assert_eq!((wanted.laps, wanted.progress, wanted.targets_m[0]), (params.laps, 1.0, Vec2::zeros()));
                return (ends, cycle);
            }
            part_m = step(part_m, wanted.subgoals_m[0]);
            cycle += 1;
        }
    }

    #[test]
    fn a_perfect_part_goes_to_the_centre_and_then_clockwise() {
        let start_m = Vec2::new(0.05, -0.03);
        let (ends, cycles) = follow(PARAMS, start_m, |_, subgoal| subgoal);
        let reach = PARAMS.half_side_m - PARAMS.part_radius_m - PARAMS.edge_margin_m;
        let mut expected = Vec::new();
        for (x, y) in [(-1.0, 0.0), (0.0, 1.0), (1.0, 0.0), (0.0, -1.0)].repeat(2) {
            expected.extend([Vec2::new(x, y) * reach, Vec2::zeros()]);
        }
        assert_eq!(ends.len(), expected.len());
        for (end, expected) in ends.iter().zip(&expected) {
            assert!((end - expected).norm() <= PARAMS.arrive_m + 1e-12, "{end} for {expected}");
        }
        let strides = |length: f64| ((length - PARAMS.arrive_m) / PARAMS.stride_m).ceil() as usize;
        assert_eq!(cycles, strides(0.05) + strides(0.03) + 16 * strides(reach));
    }

    proptest! {
        #[test]
        fn noisy_part_reaches_every_branch_end(seed in 0u64..1000, x in -0.09..0.09f64, y in -0.09..0.09f64) {
            let mut rng = Streams::new(seed).stream("walk");
            let mut noise = |size: f64| Vec2::new(rng.random_range(-size..size), rng.random_range(-size..size));
            let clumsy = |part: Vec2, subgoal: Vec2| {
                let gain = 0.9 + 400.0 * noise(0.001).x;
                part + gain * (subgoal - part) + noise(0.0004)
            };
            let (ends, _) = follow(PARAMS, Vec2::new(x, y), clumsy);
            prop_assert_eq!(ends.len(), 16);
            for (i, end) in ends.iter().enumerate().step_by(2) {
                let way = BRANCHES[i / 2 % 4].0;
                prop_assert!(end.dot(&way) > PlusSign::new(PARAMS).reach_m() - PARAMS.arrive_m - 1e-12);
            }
        }

        #[test]
        fn subgoals_stay_on_the_branch_and_within_a_stride(positions in proptest::collection::vec(
            prop_oneof![(-0.1..0.1f64, -0.1..0.1f64), (Just(f64::NAN), Just(0.0)), (Just(0.0), Just(f64::INFINITY))], 1..60)) {
            let mut task = PlusSign::new(PARAMS);
            for (x, y) in positions {
                let wanted = task.next(PlateTime::ZERO, &[Vec2::new(x, y)]);
                let (subgoal, segment) = (wanted.subgoals_m[0], task.segment);
                let part = task.seen_m[0];
                let foot = segment.from_m + segment.direction() * segment.along_m(part).clamp(0.0, segment.length_m());
                prop_assert!((subgoal - foot).norm() <= PARAMS.stride_m + 1e-12);
                prop_assert!(cross(segment.direction(), subgoal - segment.from_m).abs() < 1e-12);
                prop_assert!((subgoal - segment.to_m).norm() <= segment.length_m() + 1e-12);
                prop_assert!(wanted.cross_track_m[0].is_finite());
                prop_assert!(subgoal.iter().chain(wanted.targets_m[0].iter()).all(|x| x.is_finite()) && wanted.progress.is_finite());
            }
        }
    }
}
