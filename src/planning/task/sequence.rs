use super::{Setpoints, Task};
use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;

/// Tasks one after another: each begins where the parts rest once the one before is confirmed.
pub struct Sequence {
    make: Box<dyn FnMut(usize) -> Box<dyn Task>>,
    /// Number of tasks; `None` without end.
    of: Option<usize>,
    /// Index of the present task, and the task.
    at: usize,
    present: Box<dyn Task>,
    /// Laps of the tasks before it, and its own so far.
    laps: (u32, u32),
}

impl Sequence {
    /// A sequence of `of` tasks, or of tasks without end; `make` makes the one with an index.
    pub fn new(of: Option<usize>, mut make: Box<dyn FnMut(usize) -> Box<dyn Task>>) -> Self {
        let present = make(0);
        Self { make, of, at: 0, present, laps: (0, 0) }
    }
}

impl Task for Sequence {
    fn first_seen(&mut self, parts_in_table_m: &[Vec2]) {
        self.present.first_seen(parts_in_table_m);
    }

    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let wanted = self.present.next(now, parts_in_table_m);
        self.laps.1 = wanted.laps;
        let of = self.of.map_or_else(String::new, |of| format!(" of {of}"));
        Setpoints {
            task: self.at + 1,
            phase: format!("task {}{of}: {}", self.at + 1, wanted.phase),
            progress: self.of.map_or(0.0, |of| (self.at as f64 + wanted.progress) / of as f64),
            laps: self.laps.0.saturating_add(wanted.laps),
            ..wanted
        }
    }

    fn go_on(&mut self, parts_in_table_m: &[Vec2]) -> bool {
        if self.of.is_some_and(|of| self.at + 1 >= of) {
            return false;
        }
        self.at += 1;
        self.present = (self.make)(self.at);
        self.laps = (self.laps.0.saturating_add(self.laps.1), 0);
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
        let scene = PlateScene { half_side_m: 0.15, discs, ..PlateScene::default() };
        let (there, arrive_m) = (Vec2::new(0.05, 0.0), 0.0005);
        let hold = HoldParams { scene: scene.clone(), duration_s: 2.0, arrive_m };
        let arrange = ArrangeParams { scene, targets_m: vec![Some(there)], exchange: false, arrive_m };
        let make = move |index: usize| -> Box<dyn Task> {
            if index == 0 { Box::new(Arrange::new(arrange.clone())) } else { Box::new(Hold::new(hold.clone())) }
        };
        let mut task = Sequence::new(Some(2), Box::new(make));
        task.first_seen(&[Vec2::zeros()]);
        let next = |task: &mut Sequence, at_s, at_m| task.next(PlateTime::from_secs(at_s), &[at_m]);
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
