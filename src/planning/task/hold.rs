use super::path_follower::{PathFollower, PlateScene};
use super::{Setpoints, Task};
use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;

/// A part that drifted is brought back to within this fraction of the tolerance.
const BROUGHT_BACK: f64 = 0.5;

/// Parameters of holding: every part stays where it was first seen.
#[derive(Clone, Debug)]
pub struct HoldParams {
    /// The plate and its parts, which move independently.
    pub scene: PlateScene,
    /// Duration in plate time, s.
    pub duration_s: f64,
    /// Distance from which a part is brought back, m.
    pub arrive_m: f64,
}

/// Task that holds parts by [`HoldParams`]. While no part has drifted, every subgoal equals the part's observed
/// position.
#[derive(Clone, Debug)]
pub struct Hold {
    params: HoldParams,
    steering: Option<PathFollower>,
    since: Option<PlateTime>,
    /// True while parts are being brought back.
    correcting: bool,
}

impl Hold {
    /// A new task with these parameters.
    pub fn new(params: HoldParams) -> Self {
        Self { params, steering: None, since: None, correcting: false }
    }
}

impl Task for Hold {
    fn first_seen(&mut self, parts_in_table_m: &[Vec2]) {
        self.steering = Some(PathFollower::new(&self.params.scene, &[], Vec::new(), parts_in_table_m));
    }

    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let of = parts_in_table_m.len();
        if self.steering.as_ref().is_none_or(|steering| steering.seen_m.len() != of) {
            self.first_seen(parts_in_table_m);
        }
        let Some(steering) = &mut self.steering else { return Setpoints::default() };
        let HoldParams { duration_s, arrive_m, .. } = &self.params;
        steering.observe(parts_in_table_m);

        let furthest_m = steering.distances_m().fold(0.0, f64::max);
        self.correcting = furthest_m > if self.correcting { BROUGHT_BACK * arrive_m } else { *arrive_m };
        let held_s = now.secs_since(*self.since.get_or_insert(now));
        let done = held_s >= *duration_s && !self.correcting;
        let phase = match self.correcting {
            _ if done => format!("every part held for {duration_s} s"),
            true => "bringing back what drifted".into(),
            false => "holding every part".into(),
        };
        Setpoints {
            subgoals_m: if self.correcting { steering.subgoals_m() } else { steering.seen_m.clone() },
            targets_m: steering.targets_m(),
            phase,
            progress: (held_s / duration_s).clamp(0.0, 1.0),
            cross_track_m: vec![0.0; of],
            done,
            ..Setpoints::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_left_alone_until_they_drift_and_then_brought_back() {
        let scene = PlateScene { half_side_m: 0.1524, ..PlateScene::default() };
        let mut task = Hold::new(HoldParams { scene, duration_s: 2.0, arrive_m: 0.0005 });
        let home = [Vec2::new(0.02, 0.0), Vec2::new(-0.02, 0.0)];
        let mut observe = |at_s: f64, drift_m: f64| {
            let parts = [home[0], home[1] + Vec2::new(drift_m, 0.0)];
            let wanted = task.next(PlateTime::from_secs(at_s), &parts);
            assert_eq!(wanted.targets_m, home);
            (wanted.subgoals_m == parts, wanted.subgoals_m == home, wanted.done, wanted.progress)
        };
        assert_eq!(observe(10.0, 0.0), (true, true, false, 0.0));
        assert_eq!(observe(10.5, 0.0004), (true, false, false, 0.25));
        assert_eq!(observe(11.0, 0.0006), (false, true, false, 0.5));
        assert_eq!(observe(11.5, 0.0004), (false, true, false, 0.75));
        assert_eq!(observe(12.0, 0.0003), (false, true, false, 1.0));
        assert_eq!(observe(12.5, 0.0002), (true, false, true, 1.0));
    }
}
