use super::path_follower::{PathFollower, PlateScene};
use super::room::places_beside;
use super::{PartOutline, Setpoints, Task};
use upm_core::geometry::{Polyline, Vec2};
use upm_core::time::PlateTime;

/// Parameters of an arrangement: every part goes to a target.
#[derive(Clone, Debug)]
pub struct ArrangeParams {
    /// The plate and its parts.
    pub scene: PlateScene,
    /// Target of each part, m. Parts without one stay where they were first seen, and make room where they lie on the
    /// target of another.
    pub targets_m: Vec<Option<Vec2>>,
    /// True when parts of one kind may exchange their targets.
    pub exchange: bool,
    /// Distance from its target within which a part has arrived, m.
    pub arrive_m: f64,
}

/// Task that arranges parts by [`ArrangeParams`]. It is done when every part is at its target at the same time.
#[derive(Clone, Debug)]
pub struct Arrange {
    params: ArrangeParams,
    steering: Option<PathFollower>,
}

impl Arrange {
    /// A new task with these parameters.
    pub fn new(params: ArrangeParams) -> Self {
        Self { params, steering: None }
    }
}

/// Group numbers: parts of one kind share one when they may exchange their targets, otherwise each part has its own.
fn groups(discs: &[PartOutline], targets_m: &[Option<Vec2>], exchange: bool) -> Vec<usize> {
    let may = |i: usize| exchange && targets_m.get(i).is_some_and(Option::is_some);
    discs.iter().enumerate().map(|(i, disc)| if may(i) { disc.kind } else { usize::MAX - i }).collect()
}

impl Task for Arrange {
    fn next(&mut self, _now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let ArrangeParams { scene, targets_m, exchange, arrive_m } = &self.params;
        let of = parts_in_table_m.len();
        let steering = self.steering.take().filter(|steering| steering.seen_m.len() == of);
        let begin = || {
            let wanted = targets_m.iter().map(|target_m| target_m.map(|target_m| Polyline::new(vec![target_m])));
            let places_m = places_beside(scene, &wanted.collect::<Vec<_>>(), 0.0, parts_in_table_m);
            PathFollower::new(scene, &places_m, groups(&scene.discs, targets_m, *exchange), parts_in_table_m)
        };
        let steering = self.steering.insert(steering.unwrap_or_else(begin));
        steering.observe(parts_in_table_m);
        let there = steering.distances_m().filter(|distance_m| distance_m <= arrive_m).count();
        let done = of > 0 && there == of;
        let wanted = steering.wanted("to the places", there);
        if !done {
            return wanted;
        }
        Setpoints { phase: "every part is at its place".into(), progress: 1.0, done, ..wanted }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrange(kinds: &[usize], targets_m: &[(f64, f64)], exchange: bool) -> Arrange {
        let discs = kinds.iter().map(|&kind| PartOutline { kind, radius_m: crate::task::PENNY_M }).collect();
        let targets_m = targets_m.iter().map(|&(x, y)| Some(Vec2::new(x, y))).collect();
        Arrange::new(ArrangeParams {
            scene: PlateScene { half_side_m: 0.1524, discs, ..PlateScene::default() },
            targets_m,
            exchange,
            arrive_m: 0.00045,
        })
    }

    const PLACES: [(f64, f64); 3] = [(-0.05, 0.0), (0.0, 0.0), (0.05, 0.0)];

    #[test]
    fn parts_of_one_kind_take_the_nearer_places() {
        let parts = [Vec2::new(0.05, 0.05), Vec2::new(-0.05, 0.05), Vec2::new(0.0, 0.05)];
        let targets = |mut task: Arrange| task.next(PlateTime::ZERO, &parts).targets_m;
        let xs = |task| targets(task).iter().map(|target_m| target_m.x).collect::<Vec<_>>();
        assert_eq!(xs(arrange(&[0, 0, 0], &PLACES, true)), [0.05, -0.05, 0.0]);
        assert_eq!(xs(arrange(&[0, 0, 0], &PLACES, false)), [-0.05, 0.0, 0.05]);
        assert_eq!(xs(arrange(&[0, 1, 0], &PLACES, true)), [0.05, 0.0, -0.05]);
    }

    #[test]
    fn parts_without_a_target_stay_or_make_room() {
        let mut task = arrange(&[0, 0, 0], &PLACES[..1], true);
        task.params.targets_m.extend([None, None]);
        let parts = [(0.05, 0.05), (-0.05, 0.0), (0.0, 0.05)].map(|(x, y)| Vec2::new(x, y));
        let targets_m = task.next(PlateTime::ZERO, &parts).targets_m;
        assert_eq!((targets_m[0], targets_m[2]), (Vec2::new(-0.05, 0.0), parts[2]));
        let room_mm = 1e3 * (targets_m[1] - targets_m[0]).norm();
        assert!((22.0..24.1).contains(&room_mm), "two radii, 3 mm and less than a step: {room_mm}");
    }

    #[test]
    fn it_is_done_when_all_are_there_at_once() {
        let mut task = arrange(&[0, 1], &PLACES[..2], true);
        let mut observe = |x: f64| task.next(PlateTime::ZERO, &[Vec2::new(-0.05, 0.0004), Vec2::new(x, 0.0)]);
        let wanted = observe(0.04);
        assert_eq!(
            (wanted.phase.as_str(), wanted.done, wanted.progress),
            ("to the places, straight: 1 of 2 there", false, 0.0)
        );
        let wanted = observe(0.02);
        // of 69.0 mm, 29.0 of them in the last steps of the two, 48.8 mm are left
        assert!(!wanted.done && (wanted.progress - 0.293).abs() < 0.001, "{wanted:?}");
        let wanted = observe(0.0004);
        assert_eq!((wanted.phase.as_str(), wanted.done, wanted.progress), ("every part is at its place", true, 1.0));
    }

    #[test]
    fn noise_exchanges_no_places() {
        let mut task = arrange(&[0, 0], &[(0.0, 0.05), (0.0, -0.05)], true);
        let parts = |tilt: f64| [Vec2::new(-0.05, tilt), Vec2::new(0.05, -tilt)];
        let first = task.next(PlateTime::ZERO, &parts(1e-4)).targets_m;
        assert_eq!(task.next(PlateTime::ZERO, &parts(-1e-4)).targets_m, first);
        assert_ne!(task.next(PlateTime::ZERO, &parts(-2e-2)).targets_m, first);
    }
}
