//! Parts against their paths in every frame.

use super::lengths::{Lengths, mm, rounded};
use super::report::PathReport;
use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;
use upm_planning::task::{PathStretch, Setpoints};

/// Distances from the paths, phases, distances gone and speeds of all parts between the first and the last points of
/// their paths, over all tasks with paths.
#[derive(Debug, Default)]
pub(crate) struct PathStats {
    wanted_at: PlateTime,
    paths: Vec<Option<PathStretch>>,
    in_phase: bool,
    cross_track: Lengths,
    phase_error_max: Option<f64>,
    parts: Vec<PartOnPath>,
}

/// One part in the frames that show it on its path.
#[derive(Clone, Copy, Debug, Default)]
struct PartOnPath {
    /// The last such frame: time, place and arc length.
    last: Option<(PlateTime, Vec2, f64)>,
    travel_m: f64,
    along_m: f64,
    took_s: f64,
    /// Arc length at the speed asked, m.
    asked_m: f64,
}

impl PathStats {
    /// Takes the paths of the cycle that begins at `at`.
    pub fn setpoints(&mut self, at: PlateTime, wanted: &Setpoints) {
        (self.wanted_at, self.in_phase) = (at, !wanted.phase_error.is_empty());
        self.paths.clone_from(&wanted.paths);
        self.parts.resize(self.paths.len().max(self.parts.len()), PartOnPath::default());
        for (part, on_path) in self.parts.iter_mut().enumerate() {
            let is_on_path = self.paths.get(part).and_then(Option::as_ref).is_some_and(|path| !path.is_over);
            on_path.last = on_path.last.filter(|_| is_on_path);
        }
    }

    /// Takes the position of a part in a frame.
    pub fn frame(&mut self, at: PlateTime, part: usize, position_m: Vec2) {
        let Some(path) = self.paths.get(part).and_then(Option::as_ref).filter(|path| !path.is_over) else { return };
        let (along_m, off_m) = path.nearest(position_m);
        self.cross_track.push(off_m);
        if self.in_phase && path.lap_m > 0.0 {
            let reference_m = path.reference_m + path.speed_mps * at.secs_since(self.wanted_at);
            let error = (along_m - reference_m).abs() / path.lap_m;
            self.phase_error_max = Some(self.phase_error_max.unwrap_or(0.0).max(error));
        }
        let on_path = &mut self.parts[part];
        if let Some((last_at, last_m, last_along_m)) = on_path.last.replace((at, position_m, along_m)) {
            let took_s = at.secs_since(last_at);
            on_path.travel_m += (position_m - last_m).norm();
            on_path.along_m += along_m - last_along_m;
            on_path.took_s += took_s;
            on_path.asked_m += path.speed_mps * took_s;
        }
    }

    /// The figures; `None` where no frame has a part on its path.
    pub fn report(&self) -> PathReport {
        let travel_m: f64 = self.parts.iter().map(|part| part.travel_m).sum();
        let along_m: f64 = self.parts.iter().map(|part| part.along_m).sum();
        let paced = self.parts.iter().filter(|part| part.asked_m > 0.0);
        let slowest = paced.min_by(|a, b| (a.along_m / a.asked_m).total_cmp(&(b.along_m / b.asked_m)));
        PathReport {
            cross_track_rms_mm: self.cross_track.rms_mm(),
            cross_track_max_mm: self.cross_track.max_mm(),
            travel_ratio: (along_m > 0.0).then(|| rounded(travel_m / along_m)),
            phase_error_max: self.phase_error_max.map(rounded),
            speed_asked_mm_s: slowest.map(|part| mm(part.asked_m / part.took_s)),
            speed_held_mm_s: slowest.map(|part| mm(part.along_m / part.took_s)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::Polyline;

    /// A part that zigzags by 0.5 mm between observations at which it is on its path, at half the speed asked.
    #[test]
    fn deviation_between_observations_counts() {
        let line = Polyline::new(vec![Vec2::zeros(), Vec2::new(0.1, 0.0)]);
        let path = PathStretch {
            line,
            from_m: 0.2,
            reference_m: 0.2,
            speed_mps: 0.02,
            lap_m: 0.5,
            corridor_m: 0.001,
            is_over: false,
        };
        let mut stats = PathStats::default();
        assert_eq!(stats.report(), PathReport::default());
        let wanted = Setpoints { paths: vec![None, Some(path)], phase_error: vec![0.0; 2], ..Setpoints::default() };
        stats.setpoints(PlateTime::ZERO, &wanted);
        for k in 0..=100u32 {
            let off_m = [0.0, 0.0005, 0.0, -0.0005][k as usize % 4];
            let at = PlateTime::from_secs(0.1 * f64::from(k));
            stats.frame(at, 0, Vec2::new(0.5, 0.5));
            stats.frame(at, 1, Vec2::new(0.001 * f64::from(k), off_m));
        }
        let report = stats.report();
        assert_eq!((report.cross_track_rms_mm, report.cross_track_max_mm), (Some(0.3518), Some(0.5)));
        assert_eq!((report.travel_ratio, report.phase_error_max), (Some(1.118), Some(0.2)));
        assert_eq!((report.speed_asked_mm_s, report.speed_held_mm_s), (Some(20.0), Some(10.0)));
    }
}
