use schemars::JsonSchema;
use serde::Serialize;

use super::job_file::TaskSection;
use super::kinds::part_ids;
use super::{JobSpec, TaskSpec};
use upm_core::geometry::Vec2;
use upm_core::job::{Bin, LayoutPart, LayoutPath};
use upm_core::units::mm_points;
use upm_planning::task::PathParams;

/// The layout of a job on its plate, from its file: parts, targets, bins and wanted paths. It never changes. Its JSON
/// has millimetres from the plate's centre.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct JobLayout {
    /// The parts, in the order of the job.
    pub parts: Vec<LayoutPart>,
    /// Target positions in the order of the parts that have one; empty for a task without.
    #[serde(rename = "targets_mm", with = "mm_points")]
    #[schemars(with = "Vec<[f64; 2]>")]
    pub targets_m: Vec<Vec2>,
    /// Bins to sort into; empty for every other task.
    pub bins: Vec<Bin>,
    /// Paths that parts shall follow.
    pub paths: Vec<LayoutPath>,
    /// True for a job that ends only at its plate time limit.
    pub endless: bool,
}

impl JobLayout {
    /// The layout of `job`.
    pub fn of(job: &JobSpec) -> Self {
        let kinds = job.kinds_of_parts().into_iter().filter_map(|kind| Some(&job.rig.kinds.get(kind)?.kind));
        let parts = kinds.zip(part_ids(&job.parts, &job.rig.kinds));
        let parts: Vec<LayoutPart> =
            parts.map(|(kind, id)| LayoutPart { id, kind: kind.name.clone(), radius_m: kind.radius_m }).collect();
        let mut layout = Self { endless: job.is_endless(), ..Self::default() };
        for (task, (_, section)) in job.each_task().zip(job.document.each_task()) {
            match task {
                TaskSpec::PlusSign { edge_margin_m, .. } => {
                    let radius_m = parts.first().map_or(0.0, |part| part.radius_m);
                    let reach_m = 0.5 * job.rig.model.plate_side_m - edge_margin_m - radius_m;
                    let part = Some(0).filter(|_| parts.len() == 1);
                    let bar = |along: Vec2| LayoutPath { part, waypoints_m: vec![-along, along], closed: false };
                    layout.paths.extend([Vec2::new(reach_m, 0.0), Vec2::new(0.0, reach_m)].map(bar));
                }
                TaskSpec::Trajectories { paths, .. } => {
                    let path = |(part, wanted): (usize, &PathParams)| LayoutPath {
                        part: Some(part).filter(|_| !wanted.exchange),
                        waypoints_m: wanted.waypoints_m.clone(),
                        closed: wanted.repeat != 1,
                    };
                    let moving = paths.iter().enumerate().filter(|(_, path)| !path.waypoints_m.is_empty());
                    layout.paths.extend(moving.map(path));
                }
                TaskSpec::Arrange { targets_m, .. } => layout.targets_m = targets_m.iter().flatten().copied().collect(),
                TaskSpec::Sort { .. } => {
                    if let TaskSection::Sort { bins } = section {
                        layout.bins.clone_from(bins);
                    }
                }
                TaskSpec::Hold { .. } => {}
            }
        }
        Self { parts, ..layout }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn layout(job: &str) -> JobLayout {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs")).join(job);
        JobLayout::of(&JobSpec::load(&path).unwrap())
    }

    #[test]
    fn sort_has_a_bin_for_every_kind_on_the_plate() {
        let sort = layout("sort-8.json");
        assert_eq!((sort.parts.len(), sort.paths.len(), sort.targets_m.len(), sort.endless), (8, 0, 0, false));
        for part in &sort.parts {
            let bins = sort.bins.iter().filter(|bin| bin.kinds.contains(&part.kind)).count();
            assert_eq!(bins, 1, "{}", part.kind);
            assert!(part.radius_m > 5e-3 && part.radius_m < 20e-3);
        }
        assert!(sort.bins.iter().all(|bin| bin.region.min_m < bin.region.max_m), "{:?}", sort.bins);
    }

    #[test]
    fn tasks_lay_out_their_targets_and_paths() {
        assert_eq!(layout("arrange-4.json").targets_m.len(), 4);
        let trajectories = layout("trajectories.json");
        assert_eq!(trajectories.paths.len(), trajectories.parts.len());
        assert!(trajectories.paths.iter().all(|path| path.waypoints_m.len() > 1), "{:?}", trajectories.paths);
        let plus = layout("plus-sign-endless.json");
        assert!(plus.endless && plus.paths.len() == 2);
        // half the side of the plate, less the margin and the radius of a penny
        let reach_m = 0.5 * 0.2032 - 0.008 - 0.009_525;
        assert!((plus.paths[0].waypoints_m[1] - Vec2::new(reach_m, 0.0)).norm() < 1e-12, "{:?}", plus.paths);
        assert!((plus.paths[1].waypoints_m[0] - Vec2::new(0.0, -reach_m)).norm() < 1e-12, "{:?}", plus.paths);
        let parts = |layout: &JobLayout| layout.paths.iter().map(|path| path.part).collect::<Vec<_>>();
        assert_eq!((parts(&plus), parts(&trajectories)), (vec![Some(0); 2], vec![Some(0), Some(1)]));
        assert_eq!(layout("hold-4.json").parts.len(), 4);
    }
}
