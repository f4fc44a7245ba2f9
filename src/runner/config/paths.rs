//! Paths that parts follow, typed corner by corner or made by a rule.

use super::in_phase::check_in_phase;
use super::part_path::PartPath;
use super::raw_job::RawPath;
use super::room::{REST_GAP_M, REST_MARGIN_M, check_apart, check_inside};
use super::task::{Scene, TaskSpec};
use upm_document::Faults;

impl Scene<'_> {
    /// The paths in SI; faults where a part would leave the plate, or begin or end in another.
    pub(super) fn trajectories(&self, raw: &[RawPath], in_phase: bool, faults: &mut Faults) -> Option<TaskSpec> {
        let at = self.at.key("paths");
        let total = raw.iter().map(|path| path.count as usize).sum();
        self.demand_one_each(total, "path", &at, faults);
        if total > self.kinds.len().max(raw.len()) {
            return None;
        }
        let before = faults.len();
        let mut paths: Vec<PartPath> = Vec::with_capacity(total);
        for (i, raw) in raw.iter().enumerate() {
            let at = at.index(i);
            let alone = in_phase || raw.count == 1;
            faults.demand(alone, at.key("count"), raw.count, "1 (more parts on one path only with in_phase)");
            paths.extend(PartPath::each(raw, &at, faults));
        }
        if faults.len() > before {
            return None;
        }
        self.check_on_plate(&paths, faults);
        let before = faults.len();
        check_ends(&paths, &self.radii_m, in_phase, faults);
        if in_phase && faults.len() == before {
            check_in_phase(&paths, &self.radii_m, &self.ids, faults);
        }
        Some(TaskSpec::Trajectories { paths: paths.into_iter().map(|path| path.params).collect(), in_phase })
    }

    fn check_on_plate(&self, paths: &[PartPath], faults: &mut Faults) {
        for (PartPath { shape_at, growth, params, .. }, &radius_m) in paths.iter().zip(&self.radii_m) {
            match growth {
                Some(growth) => self.check_way(&params.waypoints_m, radius_m, growth, shape_at, faults),
                None => {
                    for (k, &waypoint_m) in params.waypoints_m.iter().enumerate() {
                        check_inside(waypoint_m, radius_m, self.half_m, REST_MARGIN_M, &shape_at.index(k), faults);
                    }
                }
            }
        }
    }
}

/// Faults where two parts would begin, or end, too near to each other. The starts and ends of made paths in phase are
/// checked with the rest of their laps.
fn check_ends(paths: &[PartPath], radii_m: &[f64], in_phase: bool, faults: &mut Faults) {
    let (mut starts, mut ends) = (Vec::with_capacity(paths.len()), Vec::with_capacity(paths.len()));
    for (PartPath { shape_at, growth, params, .. }, &radius_m) in paths.iter().zip(radii_m) {
        let is_made = growth.is_some();
        if is_made && in_phase {
            continue;
        }
        let at = |k: usize| if is_made { shape_at.clone() } else { shape_at.index(k) };
        starts.extend(params.waypoints_m.first().map(|&start_m| (start_m, radius_m, at(0))));
        let last = params.waypoints_m.iter().enumerate().skip(1).next_back().filter(|_| params.repeat > 0);
        ends.extend(last.map(|(k, &end_m)| (end_m, radius_m, at(k))));
    }
    check_apart(&starts, REST_GAP_M, faults);
    check_apart(&ends, REST_GAP_M, faults);
}
