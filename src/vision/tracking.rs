use super::coins::CoinFinder;
use super::disk::{Disk, Rest, climb};
use super::judge::{APART, PartJudge, kernel_radius_px, overlap, reach_px};
use super::sampling::Sampler;
use super::{Detection, Table, Track};
use crate::geometry::Vec2;
use crate::rig::PartKind;
use crate::signal::Frame;

/// Frames between two searches of the whole frame for lost parts.
const FULL_SEARCH_EVERY: u64 = 8;
/// A rim fitted from rays that start farther than this from its middle, px, is fitted once more from there.
const RECENTER_PX: f64 = 0.8;
/// Half the side of the wider search, radii, and its first step.
const WIDE_RADII: f64 = 3.5;
const WIDE_STEP: f64 = 0.4;
/// Best places of the wider search that are looked at closely.
const WIDE_PLACES: usize = 6;

/// Follows parts from frame to frame. Each part keeps its place in the list, and no two share a place on the plate.
///
/// A part is looked for where its motion leads: the disk kernel climbs over its neighbours to the peak, the rim gives the
/// rest. Not there, it is looked for over some radii around; not there either, in the whole frame, now and then.
pub struct Tracker {
    table: Table,
    frame_size: [usize; 2],
    judge: PartJudge,
    disks: Vec<Disk>,
    finder: CoinFinder,
    tracks: Vec<Track>,
    /// Motion of the outline from the last frame to this, px.
    motion_px: Vec<Vec2>,
    looks: Vec<Option<Detection>>,
    places: Vec<(i64, Rest)>,
    frames: u64,
    next_full_search: u64,
}

impl Tracker {
    /// Starts from parts as found by [`CoinFinder::find`].
    pub fn new(
        table: &Table,
        frame_size: [usize; 2],
        kinds: &[PartKind],
        dark_parts: bool,
        start: Vec<Detection>,
    ) -> Self {
        let scale = table.mean_px_per_m();
        let count = start.len();
        Self {
            table: table.clone(),
            frame_size,
            judge: PartJudge::new(kinds, dark_parts),
            disks: kinds.iter().map(|kind| Disk::new(kernel_radius_px(table, kind, scale))).collect(),
            finder: CoinFinder::new(table, frame_size, kinds, dark_parts),
            tracks: start.into_iter().map(|seen| Track { seen, frames_unseen: 0 }).collect(),
            motion_px: vec![Vec2::zeros(); count],
            looks: vec![None; count],
            places: Vec::with_capacity(512),
            frames: 0,
            next_full_search: 0,
        }
    }

    /// Looks at the next frame. In a frame of another size nothing is seen.
    pub fn track(&mut self, frame: &Frame) {
        self.frames += 1;
        self.looks.fill(None);
        let sampler = Sampler::new(frame).filter(|_| [frame.width, frame.height] == self.frame_size);
        if let Some(sampler) = sampler {
            for i in 0..self.tracks.len() {
                self.looks[i] = self.look_near(frame, &sampler, i);
            }
            self.settle_claims();
            for i in 0..self.tracks.len() {
                if self.looks[i].is_none() {
                    self.looks[i] = self.look_wide(frame, &sampler, i);
                }
            }
            if self.looks.contains(&None) && self.frames >= self.next_full_search {
                self.next_full_search = self.frames + FULL_SEARCH_EVERY;
                self.look_everywhere(frame);
            }
        }
        for ((track, look), motion) in self.tracks.iter_mut().zip(&mut self.looks).zip(&mut self.motion_px) {
            if let Some(seen) = look.take() {
                *motion = if track.frames_unseen == 0 { seen.center_px - track.seen.center_px } else { Vec2::zeros() };
                *track = Track { seen, frames_unseen: 0 };
            } else {
                *motion = Vec2::zeros();
                track.frames_unseen = track.frames_unseen.saturating_add(1);
            }
        }
    }

    /// One entry for each part of the start, in that order.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// The step of every frame: climb from where the part should be, then its rim.
    fn look_near(&self, frame: &Frame, sampler: &Sampler, i: usize) -> Option<Detection> {
        let seen = &self.tracks[i].seen;
        let disk = self.disks.get(seen.kind)?;
        let reach = disk.reach() as f64;
        let motion = self.motion_px[i];
        let start = seen.center_px + if motion.norm() < reach { motion } else { Vec2::zeros() };
        let rest =
            climb(disk, frame, start.x.round() as i64, start.y.round() as i64, self.judge.dark_parts, disk.reach())?;
        self.recognise(sampler, seen.kind, rest)
    }

    /// A part of `kind` where its disk has come to rest.
    fn recognise(&self, sampler: &Sampler, kind: usize, rest: Rest) -> Option<Detection> {
        let disk = self.disks.get(kind)?;
        let place = Vec2::new(rest.x as f64, rest.y as f64);
        let foot_m = self.judge.foot_below(&self.table, kind, place);
        let rim = |foot_m| self.judge.rim::<9>(sampler, &self.table, kind, foot_m, reach_px(disk.reach() as f64));
        let mut fit = rim(foot_m)?;
        if (fit.center_px - place).norm() > RECENTER_PX {
            fit = rim(fit.foot_m)?;
        }
        let part = self.judge.detection(&fit, rest, disk)?;
        let on_plate = self.table.holds(part.position_m, 0.5 * self.judge.kinds.get(kind)?.radius_m);
        (part.kind == kind && on_plate).then_some(part)
    }

    /// Where two parts claim one place, the one that jumped farther gives way.
    fn settle_claims(&mut self) {
        let jump = |track: &Track, look: &Detection| (look.center_px - track.seen.center_px).norm();
        for i in 0..self.looks.len() {
            for j in i + 1..self.looks.len() {
                if let (Some(a), Some(b)) = (&self.looks[i], &self.looks[j])
                    && overlap(a, b)
                {
                    let loser = if jump(&self.tracks[i], a) > jump(&self.tracks[j], b) { i } else { j };
                    self.looks[loser] = None;
                }
            }
        }
    }

    fn is_free(&self, part: &Detection) -> bool {
        self.looks.iter().flatten().all(|other| !overlap(other, part))
    }

    /// True where a part just seen leaves no room for another of `kind`.
    fn is_taken(&self, center_px: Vec2, kind: usize) -> bool {
        let radius_px = self.disks.get(kind).map_or(0.0, |disk| disk.reach() as f64);
        let too_near =
            |other: &Detection| (other.center_px - center_px).norm() < APART * 0.5 * (other.radius_px + radius_px);
        self.looks.iter().flatten().any(too_near)
    }

    /// Coarse to fine over some radii around the last place: the kernel at every few pixels, climbs from the best.
    fn look_wide(&mut self, frame: &Frame, sampler: &Sampler, i: usize) -> Option<Detection> {
        let (kind, center) = (self.tracks[i].seen.kind, self.tracks[i].seen.center_px);
        let disk = self.disks.get(kind)?;
        let step = (WIDE_STEP * disk.reach() as f64).max(1.0);
        let half = (WIDE_RADII / WIDE_STEP).round() as i64;
        let sign = if self.judge.dark_parts { 1 } else { -1 };
        self.places.clear();
        for row in -half..=half {
            for column in -half..=half {
                let at = center + Vec2::new(column as f64, row as f64) * step;
                let (x, y) = (at.x.round() as i64, at.y.round() as i64);
                if disk.fitted(frame, x, y) == Some((x as usize, y as usize))
                    && self.table.holds(self.table.table_from_image(at), 0.0)
                {
                    let (x, y) = (x as usize, y as usize);
                    let sum = disk.sum(frame, x, y);
                    self.places.push((sign * sum, Rest { x, y, sum }));
                }
            }
        }
        self.places.sort_unstable_by_key(|(darkness, rest)| (*darkness, rest.y, rest.x));
        let mut tried = [(0usize, 0usize); WIDE_PLACES];
        let mut tries = 0;
        for &(_, place) in &self.places {
            let apart = |&(x, y): &(usize, usize)| x.abs_diff(place.x).max(y.abs_diff(place.y)) > disk.reach();
            if tries == WIDE_PLACES {
                break;
            }
            if !tried[..tries].iter().all(apart) || self.is_taken(Vec2::new(place.x as f64, place.y as f64), kind) {
                continue;
            }
            tried[tries] = (place.x, place.y);
            tries += 1;
            let rest = climb(disk, frame, place.x as i64, place.y as i64, self.judge.dark_parts, 4 * disk.reach())?;
            let found = self.recognise(sampler, kind, rest).filter(|part| self.is_free(part));
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// The whole frame: unseen parts take free detections of their kind, nearest pairs first.
    fn look_everywhere(&mut self, frame: &Frame) {
        let mut free = self.finder.find(frame);
        free.retain(|part| self.is_free(part));
        while let Some((i, k)) = self.nearest_pair(&free) {
            let part = free.swap_remove(k);
            self.looks[i] = Some(part);
        }
    }

    fn nearest_pair(&self, free: &[Detection]) -> Option<(usize, usize)> {
        let mut best = (f64::INFINITY, None);
        for (i, track) in self.tracks.iter().enumerate().filter(|(i, _)| self.looks[*i].is_none()) {
            for (k, part) in free.iter().enumerate().filter(|(_, part)| part.kind == track.seen.kind) {
                let distance = (part.center_px - track.seen.center_px).norm();
                if distance < best.0 {
                    best = (distance, Some((i, k)));
                }
            }
        }
        best.1
    }
}
