use super::assignment::assign;
use super::path_follower::{PathFollower, PlateScene};
use super::slots::Slots;
use super::{PartOutline, Setpoints, Task};
use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;

/// Gap between rims in a bin that lets parts enter and pass each other, m.
const COMFORT_M: f64 = 4e-3;

/// Extra slots tried so that parts already in their bin may stay.
const SPARE_SLOTS: usize = 4;

/// A rectangle for some parts, rims included.
#[derive(Clone, Debug, PartialEq)]
pub struct BinParams {
    /// Indices of the parts that belong in this bin.
    pub parts: Vec<usize>,
    /// Lower left corner, m.
    pub min_m: Vec2,
    /// Upper right corner, m.
    pub max_m: Vec2,
}

impl BinParams {
    /// Gap between a part's rim and the nearest side, m; negative where the part is not inside.
    pub fn inside_m(&self, center_m: Vec2, radius_m: f64) -> f64 {
        (center_m - self.min_m).min().min((self.max_m - center_m).min()) - radius_m
    }

    fn slots(&self, radii_m: &[f64]) -> Slots {
        let mut slots = Slots::new(self.max_m - self.min_m, radii_m);
        let middle_m = 0.5 * (self.min_m + self.max_m);
        slots.centers_m.iter_mut().for_each(|center_m| *center_m += middle_m);
        slots
    }
}

/// Parameters of sorting: every part goes into its kind's bin.
#[derive(Clone, Debug)]
pub struct SortParams {
    /// The plate and its parts.
    pub scene: PlateScene,
    /// The bins. A part without a bin stays where it was first seen.
    pub bins: Vec<BinParams>,
    /// Required distance of a part's observed rim inside its bin, m.
    pub margin_m: f64,
}

impl SortParams {
    /// Gap left by the slots of each bin, m: the least between rims, or twice that between a rim and a side where it is
    /// less; negative where no slots were found for its parts.
    pub fn gaps_m(&self) -> Vec<f64> {
        let gap_m = |bin: &BinParams| {
            let discs = bin.parts.iter().filter_map(|&part| self.scene.discs.get(part));
            let radii_m: Vec<f64> = discs.map(|disc| disc.radius_m).collect();
            let largest_m = radii_m.iter().copied().fold(0.0, f64::max);
            bin.slots(&radii_m).gap_m.max(bin.slots(&vec![largest_m; radii_m.len()]).gap_m)
        };
        self.bins.iter().map(gap_m).collect()
    }

    /// Distance of a part's rim inside its bin, m; `None` when it has no bin.
    fn inside_m(&self, part: usize, center_m: Vec2) -> Option<f64> {
        let bin = self.bins.iter().find(|bin| bin.parts.contains(&part))?;
        Some(bin.inside_m(center_m, self.scene.discs.get(part)?.radius_m))
    }
}

/// Task that sorts parts by [`SortParams`]. It is done as soon as every part's rim is inside its bin.
#[derive(Clone, Debug)]
pub struct Sort {
    params: SortParams,
    steering: Option<PathFollower>,
}

impl Sort {
    /// A new task with these parameters.
    pub fn new(params: SortParams) -> Self {
        Self { params, steering: None }
    }

    fn steering(&self, parts_in_table_m: &[Vec2]) -> PathFollower {
        let SortParams { scene, bins, .. } = &self.params;
        let mut places = TargetSet::new(parts_in_table_m);
        for bin in bins {
            let parts = bin.parts.iter().copied().filter(|&part| part < parts_in_table_m.len());
            places.fill(bin, parts.collect(), &scene.discs, parts_in_table_m);
        }
        PathFollower::new(scene, &places.at_m, places.groups, parts_in_table_m).arriving_about()
    }
}

/// Place of each part, and the groups within which places may be exchanged.
struct TargetSet {
    at_m: Vec<Vec2>,
    groups: Vec<usize>,
    /// Smallest unused group number.
    next_group: usize,
}

impl TargetSet {
    /// Every part's place is its present position.
    fn new(parts_in_table_m: &[Vec2]) -> Self {
        let parts = parts_in_table_m.len();
        Self { at_m: parts_in_table_m.to_vec(), groups: (0..parts).collect(), next_group: parts }
    }

    /// Assigns `parts` places in `bin`; those well inside stay if that leaves room for the others.
    fn fill(&mut self, bin: &BinParams, parts: Vec<usize>, discs: &[PartOutline], seen_m: &[Vec2]) {
        let radius_m = |part: &usize| discs[*part].radius_m;
        let largest_m = parts.iter().map(radius_m).fold(0.0, f64::max);
        let mut settled: Vec<usize> = parts
            .iter()
            .copied()
            .filter(|part| bin.inside_m(seen_m[*part], radius_m(part)) >= 0.5 * COMFORT_M)
            .collect();
        while !settled.is_empty() {
            for spare in 0..=SPARE_SLOTS {
                let slots = bin.slots(&vec![largest_m; parts.len() + spare]);
                let clear = |slot_m: &Vec2| {
                    settled.iter().all(|part| (seen_m[*part] - slot_m).norm() >= radius_m(part) + largest_m + COMFORT_M)
                };
                let free_m: Vec<Vec2> = slots.centers_m.iter().copied().filter(clear).collect();
                if slots.gap_m >= COMFORT_M && free_m.len() + settled.len() >= parts.len() {
                    let movers: Vec<usize> = parts.iter().copied().filter(|part| !settled.contains(part)).collect();
                    return self.take(&movers, &free_m, seen_m, |_, _| true);
                }
            }
            settled.pop();
        }
        let roomy = bin.slots(&vec![largest_m; parts.len()]);
        if roomy.gap_m >= COMFORT_M {
            return self.take(&parts, &roomy.centers_m, seen_m, |_, _| true);
        }
        let mut by_size = parts;
        by_size.sort_by(|a, b| radius_m(b).total_cmp(&radius_m(a)));
        let fitted = bin.slots(&by_size.iter().map(radius_m).collect::<Vec<_>>());
        let (slots, equal) = if fitted.gap_m > roomy.gap_m { (fitted, false) } else { (roomy, true) };
        let may = |part: usize, slot: usize| equal || discs[by_size[part]].radius_m == discs[by_size[slot]].radius_m;
        self.take(&by_size, &slots.centers_m, seen_m, may);
    }

    /// Assigns each of `parts` a slot that it may have, with short displacements; parts that may have each other's
    /// slots may exchange them.
    fn take(&mut self, parts: &[usize], slots_m: &[Vec2], seen_m: &[Vec2], may: impl Fn(usize, usize) -> bool) {
        let cost_m2 = |part: usize, slot: usize| {
            if may(part, slot) { (seen_m[parts[part]] - slots_m[slot]).norm_squared() } else { f64::INFINITY }
        };
        for (i, slot) in assign(parts.len(), slots_m.len(), cost_m2).into_iter().enumerate() {
            self.at_m[parts[i]] = slots_m[slot];
            let like = (0..i).find(|&other| may(i, other));
            self.groups[parts[i]] = like.map_or(self.next_group, |other| self.groups[parts[other]]);
            self.next_group += usize::from(like.is_none());
        }
    }
}

impl Task for Sort {
    fn next(&mut self, _now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let of = parts_in_table_m.len();
        let kept = self.steering.take().filter(|steering| steering.seen_m.len() == of);
        let steering = kept.unwrap_or_else(|| self.steering(parts_in_table_m));
        let steering = self.steering.insert(steering);
        steering.observe(parts_in_table_m);
        let inside = |(part, seen_m): (usize, &Vec2)| {
            self.params.inside_m(part, *seen_m).is_none_or(|inside_m| inside_m >= self.params.margin_m)
        };
        let there = steering.seen_m.iter().enumerate().filter(|part| inside(*part)).count();
        let done = of > 0 && there == of;
        let wanted = steering.wanted("into the bins", there);
        if !done {
            return wanted;
        }
        let phase = "every part is in its bin".into();
        Setpoints { targets_m: steering.seen_m.clone(), phase, progress: 1.0, done, ..wanted }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::PENNY_M;

    fn penny_bin(min: (f64, f64), max: (f64, f64), pennies: usize) -> SortParams {
        let bin = BinParams { parts: (0..8).collect(), min_m: Vec2::new(min.0, min.1), max_m: Vec2::new(max.0, max.1) };
        let discs = vec![PartOutline { kind: 0, radius_m: PENNY_M }; pennies];
        let scene = PlateScene { half_side_m: 0.1524, discs, ..PlateScene::default() };
        SortParams { scene, bins: vec![bin], margin_m: 5e-5 }
    }

    #[test]
    fn parts_well_inside_stay_where_they_leave_room() {
        let params = penny_bin((0.0, -0.05), (0.1, 0.05), 4);
        let inside = [Vec2::new(0.02, 0.02), Vec2::new(0.08, -0.03)];
        let outside = [Vec2::new(-0.05, 0.0), Vec2::new(-0.08, 0.04)];
        let starts = [inside[0], outside[0], inside[1], outside[1]];
        let wanted = Sort::new(params.clone()).next(PlateTime::ZERO, &starts);
        assert_eq!([wanted.targets_m[0], wanted.targets_m[2]], inside);
        for (i, target) in wanted.targets_m.iter().enumerate() {
            assert!(params.inside_m(i, *target) > Some(0.002));
            for other in &wanted.targets_m[..i] {
                assert!((target - other).norm() > 2.0 * PENNY_M + 0.0039);
            }
        }
    }

    #[test]
    fn it_is_done_when_every_rim_is_inside_wherever_the_slots_are() {
        let mut task = Sort::new(penny_bin((0.0, -0.05), (0.1, 0.05), 2));
        let first = Vec2::new(0.06, 0.03);
        let at = |x: f64| [first, Vec2::new(x, 0.0)];
        let wanted = task.next(PlateTime::ZERO, &at(-0.05));
        assert_eq!((wanted.done, wanted.phase.as_str()), (false, "into the bins, straight: 1 of 2 there"));
        assert!(!task.next(PlateTime::ZERO, &at(PENNY_M)).done);
        let wanted = task.next(PlateTime::ZERO, &at(PENNY_M + 1e-4));
        assert_eq!((wanted.done, wanted.targets_m, wanted.progress), (true, at(PENNY_M + 1e-4).to_vec(), 1.0));
        assert!(!task.next(PlateTime::ZERO, &[]).done);
    }

    #[test]
    fn kinds_share_a_bin_by_size_where_it_is_crowded() {
        // two quarters and three dimes in one row: as wide as all of them and 2 mm for each
        let radii = [0.008955, 0.01213, 0.008955, 0.01213, 0.008955];
        let width = 2.0 * radii.iter().sum::<f64>() + 5.0 * 0.002;
        let discs =
            radii.iter().map(|&radius_m| PartOutline { kind: usize::from(radius_m > 0.01), radius_m }).collect();
        let scene = PlateScene { half_side_m: 0.1524, discs, ..PlateScene::default() };
        let params = SortParams { scene, ..penny_bin((-0.5 * width, 0.0), (0.5 * width, 0.027), 0) };
        assert!((params.gaps_m()[0] - 0.002).abs() < 1e-5, "{:?}", params.gaps_m());
        let starts: Vec<Vec2> = (0..5).map(|i| Vec2::new(0.05 - 0.025 * f64::from(i), -0.06)).collect();
        let wanted = Sort::new(params.clone()).next(PlateTime::ZERO, &starts);
        for (i, target) in wanted.targets_m.iter().enumerate() {
            assert!(params.inside_m(i, *target) > Some(0.0009));
            for (other, radius) in wanted.targets_m.iter().zip(radii).take(i) {
                assert!((target - other).norm() > radii[i] + radius + 0.0019);
            }
        }
        assert!(penny_bin((0.0, 0.0), (0.03, 0.03), 4).gaps_m()[0] < 0.0);
    }
}
