//! Checks whether parts can follow their paths in phase, or several of them one path.

use super::clearance::{REST_GAP_M, ROUNDING_M, apart_allowed};
use super::fit::{Pair, TIGHTER};
use super::part_path::PartPath;
use upm_core::document::{Diagnostics, Path};
use upm_core::geometry::{Segment, Vec2};
use upm_core::units::mm_from_m;
use upm_planning::task::PathParams;

/// Relative difference in time up to which laps count as equal.
const SAME_TIME: f64 = 0.01;

/// Reports paths that differ in the time of a lap or in repeat, and parts in phase that would touch.
pub(super) fn check_in_phase(paths: &[PartPath], radii_m: &[f64], ids: &[String], faults: &mut Diagnostics) {
    let laps: Vec<LoopLap> = paths.iter().map(|path| LoopLap::of(&path.params)).collect();
    let (Some(first), Some(first_lap)) = (paths.first(), laps.first()) else { return };
    let before = faults.len();
    let allowed = "a lap above 0 mm (in_phase)";
    faults.require(first_lap.length_m > 0.0, &first.shape_at, "a lap of 0 mm", allowed);
    let first_s = first_lap.length_m / first.params.speed_mps;
    let mut last = &first.at;
    for (PartPath { at, shape_at, params, .. }, lap) in paths.iter().zip(&laps) {
        if std::mem::replace(&mut last, at) == at {
            continue;
        }
        if lap.length_m == 0.0 {
            faults.require(first_lap.length_m == 0.0, shape_at, "a lap of 0 mm", allowed);
            continue;
        }
        let named = format!("of {}, in_phase", first.at);
        let same = (lap.length_m / params.speed_mps - first_s).abs() <= SAME_TIME * first_s;
        let [found, wanted] = [params.speed_mps, lap.length_m / first_s].map(mm_from_m);
        let allowed = format!("{wanted:.3} within 1 %, for a lap in {first_s:.3} s (that {named})");
        faults.require(same || first_s == 0.0, at.key("speed_mm_s"), found, allowed);
        let (found, allowed) = (params.repeat, first.params.repeat);
        faults.require(found == allowed, at.key("repeat"), found, format!("{allowed} (that {named})"));
    }
    if faults.len() == before {
        let (own, others) = meetings(paths, &laps, radii_m, |_| true);
        report_own(&own, paths, ids, faults);
        for of_path in others.chunk_by(|a, b| path_of(a, paths) == path_of(b, paths)) {
            if let Some(meeting) = of_path.first() {
                meeting.report(paths, ids, faults);
            }
        }
    }
}

/// Reports every path on which two of its parts come too close to each other while all of its parts hold their speed.
pub(super) fn check_apart_on_each(paths: &[PartPath], radii_m: &[f64], ids: &[String], faults: &mut Diagnostics) {
    let laps: Vec<LoopLap> = paths.iter().map(|path| LoopLap::of(&path.params)).collect();
    let (own, _) = meetings(paths, &laps, radii_m, |[path, other]| path.at == other.at);
    report_own(&own, paths, ids, faults);
}

/// Place in the file of the path of a meeting's later part.
fn path_of<'a>(meeting: &LoopMeeting, paths: &'a [PartPath]) -> Option<&'a Path> {
    paths.get(meeting.pair.parts[1]).map(|path| &path.at)
}

/// Reports the tightest of the meetings on each path.
fn report_own(own: &[LoopMeeting], paths: &[PartPath], ids: &[String], faults: &mut Diagnostics) {
    for on_one in own.chunk_by(|a, b| path_of(a, paths) == path_of(b, paths)) {
        let tightest = on_one.iter().reduce(|a, b| if b.pair.scale() > a.pair.scale() * TIGHTER { b } else { a });
        if let Some(meeting) = tightest {
            meeting.report(paths, ids, faults);
        }
    }
}

/// Those pairs of parts on paths that are `asked` for which come too close, in the order of the later part: on one
/// path, and on two.
fn meetings(
    paths: &[PartPath],
    laps: &[LoopLap],
    radii_m: &[f64],
    asked: impl Fn([&PartPath; 2]) -> bool,
) -> (Vec<LoopMeeting>, Vec<LoopMeeting>) {
    let discs: Vec<_> = paths.iter().zip(laps).zip(radii_m).collect();
    let (mut own, mut others) = (Vec::new(), Vec::new());
    for (i, ((path, lap), radius_m)) in discs.iter().enumerate() {
        let before = discs.iter().enumerate().take(i);
        for (k, ((other, other_lap), other_radius_m)) in before.filter(|(_, ((other, _), _))| asked([path, other])) {
            let least_m = *radius_m + *other_radius_m + REST_GAP_M;
            let (distance_m, share) = lap.nearest_to(other_lap);
            if distance_m < least_m - ROUNDING_M {
                let found = if path.at == other.at { &mut own } else { &mut others };
                found.push(LoopMeeting { pair: Pair { parts: [k, i], distance_m, least_m }, share });
            }
        }
    }
    (own, others)
}

/// Closest approach of two parts in phase.
struct LoopMeeting {
    pair: Pair,
    /// Share of the lap at the closest approach.
    share: f64,
}

impl LoopMeeting {
    fn report(&self, paths: &[PartPath], ids: &[String], faults: &mut Diagnostics) {
        let Pair { parts, distance_m, least_m } = self.pair;
        let [Some(other), Some(path)] = parts.map(|part| paths.get(part)) else { return };
        let (apart_mm, part) = (mm_from_m(distance_m), 100.0 * self.share);
        let allowed = apart_allowed(least_m, REST_GAP_M);
        if path.at != other.at {
            let found = format!("{apart_mm:.3} mm from the part of {} at {part:.1} % of the lap", other.at);
            return faults.push(&path.shape_at, found, allowed);
        }
        let [a, b] = parts.map(|part| ids.get(part).map_or("part", String::as_str));
        let found = format!("{a} and {b} {apart_mm:.3} mm apart at {part:.1} % of the lap");
        let scale = self.pair.scale();
        let larger = path.growth.as_ref().filter(|_| scale.is_finite()).map(|growth| growth.at_least(scale));
        let remedy = larger.map_or("fewer parts".to_owned(), |larger| format!("{larger}, or fewer parts"));
        faults.push(&path.shape_at, found, format!("{allowed}; {remedy}"));
    }
}

/// One lap of a path.
struct LoopLap {
    /// Corners from the first to the end of the lap, m.
    corners_m: Vec<Vec2>,
    /// Share of the lap at each corner.
    shares: Vec<f64>,
    /// Length of the lap, back to the first corner, m.
    length_m: f64,
}

impl LoopLap {
    /// The segment back to the first corner counts in the length, although parts follow it only if the path is
    /// repeated.
    fn of(path: &PathParams) -> Self {
        let mut corners_m = path.waypoints_m.clone();
        corners_m.extend(path.waypoints_m.first());
        let mut gone_m = vec![0.0];
        let mut length_m = 0.0;
        for [a, b] in corners_m.array_windows() {
            length_m += (b - a).norm();
            gone_m.push(length_m);
        }
        if path.repeat == 1 {
            corners_m.pop();
            gone_m.pop();
        }
        let shares = gone_m.iter().map(|gone_m| if length_m > 0.0 { gone_m / length_m } else { 0.0 }).collect();
        Self { corners_m, shares, length_m }
    }

    /// Position of the part at `share` of its lap, m.
    fn at(&self, share: f64) -> Vec2 {
        let next = self.shares.partition_point(|&passed| passed <= share);
        let (before, after) = (next.saturating_sub(1), next.min(self.shares.len().saturating_sub(1)));
        let corner = |i: usize| self.corners_m.get(i).copied().unwrap_or_default();
        let passed = |i: usize| self.shares.get(i).copied().unwrap_or_default();
        let way = passed(after) - passed(before);
        let part = if way > 0.0 { (share - passed(before)) / way } else { 0.0 };
        corner(before).lerp(&corner(after), part)
    }

    /// Least distance to the part on another lap in phase with this one, m, and the share of the lap at which it
    /// occurs. Between consecutive corners of either path both move linearly, hence so does their relative position.
    fn nearest_to(&self, other: &Self) -> (f64, f64) {
        let mut shares: Vec<f64> = self.shares.iter().chain(&other.shares).copied().collect();
        shares.sort_by(f64::total_cmp);
        let apart = |share: f64| self.at(share) - other.at(share);
        let nearest = |&[from, to]: &[f64; 2]| {
            let apart = Segment { from: apart(from), to: apart(to) };
            (apart.distance(Vec2::zeros()), from + apart.nearest_share(Vec2::zeros()) * (to - from))
        };
        let nearer = |best: (f64, f64), next: (f64, f64)| if next.0 < best.0 { next } else { best };
        shares.array_windows().map(nearest).fold((f64::INFINITY, 0.0), nearer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(corners: &[[f64; 2]], repeat: u32) -> PathParams {
        let waypoints_m = corners.iter().copied().map(Vec2::from).collect();
        PathParams { waypoints_m, speed_mps: 0.01, repeat, exchange: false }
    }

    #[test]
    fn a_lap_goes_back_to_its_start() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let lap = LoopLap::of(&path(&square, 2));
        assert_eq!(lap.length_m, 4.0);
        for (share, x, y) in [(0.0, 0.0, 0.0), (0.125, 0.5, 0.0), (0.5, 1.0, 1.0), (0.875, 0.0, 0.5), (1.0, 0.0, 0.0)] {
            assert!((lap.at(share) - Vec2::new(x, y)).norm() < 1e-12, "{share}");
        }
        let once = LoopLap::of(&path(&square, 1));
        assert_eq!((once.length_m, once.at(0.9)), (4.0, Vec2::new(0.0, 1.0)), "it waits at the last corner");
    }

    #[test]
    fn the_nearest_is_found_between_corners() {
        // one goes right while the other goes left, 1 below: they meet in the middle of the first side
        let there = LoopLap::of(&path(&[[0.0, 0.0], [4.0, 0.0]], 2));
        let back = LoopLap::of(&path(&[[4.0, -1.0], [0.0, -1.0]], 2));
        let (distance, share) = there.nearest_to(&back);
        assert!((distance - 1.0).abs() < 1e-12 && (share - 0.25).abs() < 1e-12, "{distance} {share}");
        let still = LoopLap::of(&path(&[[1.0, 3.0]], 2));
        assert_eq!(there.nearest_to(&still).0, 3.0);
    }
}
