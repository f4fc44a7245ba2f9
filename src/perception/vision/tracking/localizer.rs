use super::super::classifier::{APART, LEAST_SCORE, PartClassifier, reach_px};
use super::super::disk::{DiskKernel, hill_climb};
use super::super::rim::ring::direction;
use super::super::rim::{RAYS, RimFit};
use super::super::sampling::Sampler;
use super::super::{Detection, Track};
use upm_core::geometry::Vec2;
use upm_core::signal::Frame;

/// A rim fitted from rays that start farther than this from its middle, px, is fitted again from that middle.
const RECENTER_PX: f64 = 0.6;
const MOST_RECENTERS: usize = 3;
/// Rays that agree on a part in plain view.
pub(super) const PLAIN_RAYS: usize = RAYS * 7 / 9;
/// Least share of agreeing rays for a partly hidden part, of the rays that no known object hides.
const HIDDEN_SHARE: f64 = 0.44;
/// Least score of a partly hidden part.
const HIDDEN_SCORE: f64 = 0.3;
/// Largest deviation of its levels from those it had in plain view, as a fraction of the contrast.
const HIDDEN_STRAY: f32 = 0.25;
/// Largest motion per frame, px, whose motion blur the close search tolerates.
const SLOW_PX: f64 = 6.0;
/// Half the side of the wider search, radii, and its first step.
const WIDE_RADII: f64 = 3.5;
const WIDE_STEP: f64 = 0.4;
/// Best places of the wider search that are examined.
const WIDE_PLACES: usize = 6;

/// A detection of a part in one frame, and its quality.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Observation {
    pub(super) part: Detection,
    /// Rays that agree on its rim.
    pub(super) agreeing: usize,
    /// Gray levels of plate and part at the rim.
    pub(super) levels: [f32; 2],
}

/// Prior knowledge of a part in a frame.
#[derive(Clone, Copy)]
pub(super) struct Expected {
    pub(super) place_px: Vec2,
    /// Its motion per frame, px.
    pub(super) speed_px: f64,
    /// Gray levels of plate and part when it was last in plain view.
    pub(super) levels: Option<[f32; 2]>,
}

/// One frame, and the last detections of all parts.
#[derive(Clone, Copy)]
pub(super) struct TrackingFrame<'a> {
    pub(super) frame: &'a Frame,
    pub(super) sampler: Sampler<'a>,
    pub(super) tracks: &'a [Track],
}

/// Detection of one part at a time.
impl PartClassifier {
    /// Regular search in every frame: the disk climbs from the expected position of part `i`, the rim gives the rest. A
    /// partly hidden part pulls the disk away: then only the rim is searched, at the expected and at the last position.
    pub(super) fn near(&self, view: &TrackingFrame, i: usize, expected: &Expected) -> Option<Observation> {
        let seen = &view.tracks.get(i)?.seen;
        let disk = self.disks.get(seen.kind)?;
        let [x, y] = [expected.place_px.x, expected.place_px.y].map(|v| v.round() as i64);
        let peak_px = hill_climb(disk, view.frame, x, y, self.dark_parts, disk.reach())?;
        let climbed = self.recognise(view, i, peak_px, expected);
        if climbed.as_ref().is_some_and(|detection| detection.agreeing >= PLAIN_RAYS) {
            return climbed;
        }
        let still = Expected { speed_px: 0.0, ..*expected };
        let by_rim = [expected.place_px, seen.center_px].map(|place_px| {
            // First over a longer reach than in plain view.
            let far = self.wide_rim(&view.sampler, seen.kind, self.foot_below(seen.kind, place_px));
            let from_far = far.and_then(|fit| self.recognise(view, i, fit.center_px, &still));
            let close = self.recognise(view, i, place_px, &still);
            from_far.into_iter().chain(close).max_by_key(|detection| detection.agreeing)
        });
        // Of equally good detections the first.
        climbed.into_iter().chain(by_rim.into_iter().flatten()).rev().max_by_key(|detection| detection.agreeing)
    }

    /// Detection of a part of the kind of part `i` whose rim is near `place_px`.
    fn recognise(&self, view: &TrackingFrame, i: usize, place_px: Vec2, expected: &Expected) -> Option<Observation> {
        let kind = view.tracks.get(i)?.seen.kind;
        let rim = |foot_m| {
            if expected.speed_px < SLOW_PX {
                return self.close_rim(&view.sampler, kind, foot_m);
            }
            let reach = reach_px(self.radius_px(kind));
            self.rim::<17>(&view.sampler, kind, foot_m, (reach + 0.5 * expected.speed_px).min(2.0 * reach))
        };
        let mut fit = rim(self.foot_below(kind, place_px))?;
        let mut moved_px = (fit.center_px - place_px).norm();
        for _ in 0..MOST_RECENTERS {
            if moved_px < RECENTER_PX {
                break;
            }
            let again = rim(fit.foot_m)?;
            moved_px = (again.center_px - fit.center_px).norm();
            fit = again;
        }
        self.observation(view, i, &fit, expected)
    }

    /// Detection of part `i` from a rim, if it is one.
    fn observation(&self, view: &TrackingFrame, i: usize, fit: &RimFit, expected: &Expected) -> Option<Observation> {
        let kind = view.tracks.get(i)?.seen.kind;
        let radius_m = self.kinds.get(kind)?.radius_m;
        if self.nearest_kind(fit.radius_m) != Some(kind) || !self.table.holds(fit.foot_m, 0.5 * radius_m) {
            return None;
        }
        let part = self.detection(view.frame, fit, kind)?;
        let score = part.score;
        let plain = fit.agreeing >= PLAIN_RAYS && score >= LEAST_SCORE;
        let believed = plain || score >= HIDDEN_SCORE && self.is_believed(view, i, fit, expected);
        if !believed {
            return None;
        }
        Some(Observation { part, agreeing: fit.agreeing, levels: [fit.plate_level, fit.part_level] })
    }

    /// Accepts a partly hidden rim when it is long enough for the visible part of it past the other parts and the
    /// plate's edge, and when it has the levels of the part in plain view.
    fn is_believed(&self, view: &TrackingFrame, i: usize, fit: &RimFit, expected: &Expected) -> bool {
        let others = || view.tracks.iter().enumerate().filter(|(k, t)| *k != i && t.frames_unseen == 0);
        let open = (0..RAYS).filter(|&k| {
            let outside = fit.center_px + direction(k) * (fit.radius_px + reach_px(fit.radius_px));
            let free = |(_, other): (usize, &Track)| {
                (other.seen.center_px - outside).norm() > other.seen.radius_px + reach_px(fit.radius_px)
            };
            self.table.holds(self.table.table_from_image(outside), 0.0) && others().all(free)
        });
        let enough = fit.agreeing as f64 >= HIDDEN_SHARE * open.count() as f64;
        enough
            && expected.levels.is_none_or(|[plate, part]| {
                let most = HIDDEN_STRAY * (plate - part).abs();
                (fit.plate_level - plate).abs() < most && (fit.part_level - part).abs() < most
            })
    }

    /// Coarse to fine search over some radii around a place: the disk at every few pixels, climbs from the best. Places
    /// of `taken` parts are excluded.
    pub(super) fn wide(
        &self,
        view: &TrackingFrame,
        i: usize,
        expected: &Expected,
        taken: &[Observation],
    ) -> Option<Observation> {
        let kind = view.tracks.get(i)?.seen.kind;
        let disk = self.disks.get(kind)?;
        let still = Expected { speed_px: 0.0, ..*expected };
        let mut tried: Vec<Vec2> = Vec::with_capacity(WIDE_PLACES);
        for (_, x, y) in self.dark_places(view.frame, disk, expected.place_px) {
            let place = Vec2::new(x as f64, y as f64);
            if tried.len() == WIDE_PLACES {
                break;
            }
            if tried.iter().any(|other| (other - place).amax() <= self.radius_px(kind))
                || self.is_taken(place, kind, taken)
            {
                continue;
            }
            tried.push(place);
            let peak_px = hill_climb(disk, view.frame, x as i64, y as i64, self.dark_parts, 4 * disk.reach())?;
            let found = self.recognise(view, i, peak_px, &still);
            if let Some(detection) = found.filter(|detection| !self.is_taken(detection.part.center_px, kind, taken)) {
                return Some(detection);
            }
        }
        None
    }

    /// Places around `center_px` on the plate, sorted by the level under the disk, darkest first (lightest for light
    /// parts).
    fn dark_places(&self, frame: &Frame, disk: &DiskKernel, center_px: Vec2) -> Vec<(f64, usize, usize)> {
        let step = (WIDE_STEP * disk.reach() as f64).max(1.0);
        let half = (WIDE_RADII / WIDE_STEP).round() as i64;
        let sign = if self.dark_parts { 1.0 } else { -1.0 };
        let mut places = Vec::with_capacity((2 * half as usize + 1).pow(2));
        for row in -half..=half {
            for column in -half..=half {
                let at = center_px + Vec2::new(column as f64, row as f64) * step;
                let (x, y) = (at.x.round() as i64, at.y.round() as i64);
                if let Some((x, y)) = disk.fitted(frame, x, y).filter(|&(fx, fy)| (fx as i64, fy as i64) == (x, y))
                    && self.table.holds(self.table.table_from_image(at), 0.0)
                {
                    places.push((sign * disk.mean(frame, x, y), x, y));
                }
            }
        }
        places.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.2, a.1).cmp(&(b.2, b.1))));
        places
    }

    /// True where parts just seen leave no room for another of `kind`.
    fn is_taken(&self, place_px: Vec2, kind: usize, taken: &[Observation]) -> bool {
        let radius_px = self.radius_px(kind);
        let too_near =
            |part: &Detection| (part.center_px - place_px).norm() < APART * 0.5 * (part.radius_px + radius_px);
        taken.iter().any(|detection| too_near(&detection.part))
    }
}
