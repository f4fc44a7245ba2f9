use super::{Setpoints, Task};
use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;

/// Tasks one after another: each begins where the parts rest once the one before is complete.
pub struct Sequence {
    tasks: Vec<Box<dyn Task>>,
    /// Index of the present task.
    at: usize,
    /// Laps of the tasks before it, and its own so far.
    laps: (u32, u32),
}

impl Sequence {
    /// The sequence of `tasks`.
    pub fn new(tasks: Vec<Box<dyn Task>>) -> Self {
        Self { tasks, at: 0, laps: (0, 0) }
    }
}

impl Task for Sequence {
    fn first_seen(&mut self, parts_in_table_m: &[Vec2]) {
        if let Some(task) = self.tasks.get_mut(self.at) {
            task.first_seen(parts_in_table_m);
        }
    }

    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let of = self.tasks.len();
        let Some(task) = self.tasks.get_mut(self.at) else { return Setpoints { done: true, ..Setpoints::default() } };
        let wanted = task.next(now, parts_in_table_m);
        self.laps.1 = wanted.laps;
        Setpoints {
            phase: format!("task {} of {of}: {}", self.at + 1, wanted.phase),
            progress: (self.at as f64 + wanted.progress) / of as f64,
            laps: self.laps.0 + wanted.laps,
            ..wanted
        }
    }

    fn go_on(&mut self, parts_in_table_m: &[Vec2]) -> bool {
        if self.at + 1 >= self.tasks.len() {
            return false;
        }
        self.at += 1;
        self.laps = (self.laps.0 + self.laps.1, 0);
        self.first_seen(parts_in_table_m);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::{Arrange, ArrangeParams, Hold, HoldParams, PartOutline, PlateScene};

    #[test]
    fn each_task_begins_where_the_one_before_ended() {
        let discs = vec![PartOutline { kind: 0, radius_m: crate::task::PENNY_M }];
        let scene = PlateScene { half_side_m: 0.15, discs: discs.clone(), ..PlateScene::default() };
        let (there, arrive_m) = (Vec2::new(0.05, 0.0), 0.0005);
        let arrange = ArrangeParams { scene, targets_m: vec![there], exchange: false, arrive_m };
        let hold = HoldParams { half_side_m: 0.15, discs, duration_s: 2.0, arrive_m };
        let mut task = Sequence::new(vec![Box::new(Arrange::new(arrange)), Box::new(Hold::new(hold))]);
        task.first_seen(&[Vec2::zeros()]);
        let mut next = |task: &mut Sequence, at_s, at_m| task.next(PlateTime::from_secs(at_s), &[at_m]);
        let wanted = next(&mut task, 0.0, Vec2::zeros());
        assert_eq!((wanted.done, wanted.targets_m.as_slice(), wanted.progress), (false, &[there][..], 0.0));
        let wanted = next(&mut task, 1.0, there);
        assert_eq!((wanted.phase.as_str(), wanted.progress), ("task 1 of 2: every part is at its place", 0.5));
        assert!(wanted.done && task.go_on(&[there]));
        let wanted = next(&mut task, 1.0, there);
        assert_eq!((wanted.done, wanted.targets_m.as_slice()), (false, &[there][..]));
        let wanted = next(&mut task, 3.0, there);
        assert_eq!((wanted.phase.as_str(), wanted.progress), ("task 2 of 2: every part held for 2 s", 1.0));
        assert!(wanted.done && !task.go_on(&[there]));
    }
}
