mod assignment;
mod localizer;
mod motion;
#[cfg(test)]
mod sequences;

use self::assignment::assign;
use self::localizer::{Expected, Observation, PLAIN_RAYS, TrackingFrame};
use self::motion::MotionModel;
use super::classifier::overlap;
use super::coins::CoinFinder;
use super::sampling::Sampler;
use super::{Detection, Table, Track};
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_core::signal::Frame;

/// Frames between two searches of the whole frame for lost parts.
const FULL_SEARCH_EVERY: u64 = 8;
/// A detection farther than this from the expected position, radii, may be another part.
const FAR_RADII: f64 = 0.5;
/// Cost of an unseen part, far above that of any position: minus twice the logarithm of a likelihood.
const UNSEEN: f64 = 1e9;

/// Tracks parts from frame to frame. Each part keeps its index in the list, and no two share a place on the plate.
///
/// A part is searched where its motion predicts it: the disk kernel climbs over its neighbours to the peak, the rim
/// gives the rest. If it is not found there, the search extends over some radii around, and if not there either, to the
/// whole frame every few frames. Where it is ambiguous which part was seen, all detections are assigned to all parts at
/// once, by maximum likelihood.
pub struct Tracker {
    finder: CoinFinder,
    frame_size: [usize; 2],
    tracks: Vec<Track>,
    motions: Vec<MotionModel>,
    /// Gray levels of plate and part when last in plain view.
    levels: Vec<Option<[f32; 2]>>,
    observations: Vec<Option<Observation>>,
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
        let at_rest = |seen: &Detection| MotionModel::at_rest(seen.center_px, seen.radius_px, frame_size);
        Self {
            finder: CoinFinder::new(table, frame_size, kinds, dark_parts),
            frame_size,
            motions: start.iter().map(at_rest).collect(),
            levels: vec![None; start.len()],
            observations: vec![None; start.len()],
            tracks: start.into_iter().map(|seen| Track { seen, frames_unseen: 0 }).collect(),
            frames: 0,
            next_full_search: 0,
        }
    }

    /// Tracks the parts in the next frame. In a frame of another size nothing is seen.
    pub fn track(&mut self, frame: &Frame) {
        self.step();
        self.observations.fill(None);
        if let Some(found) = self.finder.classifier.measured(frame) {
            let observed = |part| Observation { part, agreeing: 0, levels: [0.0; 2] };
            self.assign_observations(found.into_iter().map(observed).collect());
        } else if let Some(sampler) = Sampler::new(frame).filter(|_| [frame.width, frame.height] == self.frame_size) {
            let view = TrackingFrame { frame, sampler, tracks: &self.tracks };
            for i in 0..self.tracks.len() {
                self.observations[i] = self.finder.classifier.near(&view, i, &self.expected(i));
            }
            if !self.is_plain() {
                self.resolve(frame, sampler);
            }
        }
        for i in 0..self.tracks.len() {
            match self.observations[i].take() {
                Some(look) => self.see(i, look),
                None => self.tracks[i].frames_unseen = self.tracks[i].frames_unseen.saturating_add(1),
            }
        }
    }

    /// Skips a frame that shows nothing current.
    pub fn miss(&mut self) {
        self.step();
        self.tracks.iter_mut().for_each(|track| track.frames_unseen = track.frames_unseen.saturating_add(1));
    }

    /// Predicts all parts one frame ahead.
    fn step(&mut self) {
        self.frames += 1;
        let last = Vec2::new(self.frame_size[0] as f64 - 1.0, self.frame_size[1] as f64 - 1.0);
        for motion in &mut self.motions {
            motion.step();
            motion.place_px = motion.place_px.sup(&Vec2::zeros()).inf(&last);
        }
    }

    /// One entry for each initial part, in that order.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    fn expected(&self, i: usize) -> Expected {
        let motion = &self.motions[i];
        Expected { place_px: motion.place_px, speed_px: motion.velocity_px.norm(), levels: self.levels[i] }
    }

    /// True when each part was seen near its expected position, and no two at one place.
    fn is_plain(&self) -> bool {
        let near = |(look, motion): (&Option<Observation>, &MotionModel)| {
            look.as_ref()
                .is_some_and(|look| (look.part.center_px - motion.place_px).norm() < FAR_RADII * look.part.radius_px)
        };
        let apart = |(i, look): (usize, &Option<Observation>)| {
            let free = |b: &Observation| self.observations[..i].iter().flatten().all(|a| !overlap(&a.part, &b.part));
            look.as_ref().is_none_or(free)
        };
        self.observations.iter().zip(&self.motions).all(near) && self.observations.iter().enumerate().all(apart)
    }

    /// Detects every visible part and assigns the detections to the tracks.
    fn resolve(&mut self, frame: &Frame, sampler: Sampler) {
        let mut pool = self.distinct_observations();
        let view = TrackingFrame { frame, sampler, tracks: &self.tracks };
        for i in 0..self.tracks.len() {
            let seen_by_itself = self.observations[i].as_ref().is_some_and(|look| pool.contains(look));
            if seen_by_itself {
                continue;
            }
            let expected = self.expected(i);
            let last = Expected { place_px: self.tracks[i].seen.center_px, ..expected };
            let wide = |expected: &Expected| self.finder.classifier.wide(&view, i, expected, &pool);
            let found = wide(&expected).or_else(|| wide(&last));
            if let Some(look) = found.filter(|look| is_free(&look.part, &pool)) {
                pool.push(look);
            }
        }
        // A part that returns may not be the one nearest to the detection: then all must be seen before any is named.
        let back = |(look, track): (&Option<Observation>, &Track)| look.is_some() && track.frames_unseen > 0;
        let due = self.frames >= self.next_full_search || self.observations.iter().zip(&self.tracks).any(back);
        if pool.len() < self.tracks.len() && due {
            self.next_full_search = self.frames + FULL_SEARCH_EVERY;
            for part in self.finder.find(frame) {
                if is_free(&part, &pool) {
                    pool.push(Observation { part, agreeing: 0, levels: [0.0; 2] });
                }
            }
        }
        self.assign_observations(pool);
    }

    /// The detections of this frame, the best of those at one place.
    fn distinct_observations(&self) -> Vec<Observation> {
        let mut looks: Vec<Observation> = self.observations.iter().flatten().cloned().collect();
        looks.sort_by(|a, b| b.agreeing.cmp(&a.agreeing).then(b.part.score.total_cmp(&a.part.score)));
        let mut pool: Vec<Observation> = Vec::with_capacity(self.tracks.len());
        for look in looks {
            if is_free(&look.part, &pool) {
                pool.push(look);
            }
        }
        pool
    }

    /// Assigns one detection to each track, by maximum likelihood: either all unseen parts continued to move as
    /// predicted, or they stopped when last seen.
    fn assign_observations(&mut self, pool: Vec<Observation>) {
        let own = self.own_observations(&pool);
        let cost = |place: Vec2, i: usize, k: usize| {
            let (part, variance) = (&pool[k].part, self.motions[i].place_variance());
            if part.kind != self.tracks[i].seen.kind || own[i].unwrap_or(k) != k {
                return f64::INFINITY;
            }
            if own[i].is_none() && own.contains(&Some(k)) {
                return f64::INFINITY;
            }
            (part.center_px - place).norm_squared() / variance + 2.0 * libm::log(variance)
        };
        let (rows, columns) = (self.tracks.len(), pool.len());
        let moved = assign(rows, columns, UNSEEN, |i, k| cost(self.motions[i].place_px, i, k));
        let stopped = assign(rows, columns, UNSEEN, |i, k| cost(self.tracks[i].seen.center_px, i, k));
        let choice = if stopped.1 < moved.1 { stopped.0 } else { moved.0 };
        let mut given: Vec<Option<Observation>> = pool.into_iter().map(Some).collect();
        for (look, choice) in self.observations.iter_mut().zip(choice) {
            *look = choice.and_then(|k| given.get_mut(k)?.take());
        }
    }

    /// For each part that was seen in the last frame, the detection at its expected position, if no other claims it.
    fn own_observations(&self, pool: &[Observation]) -> Vec<Option<usize>> {
        let gated_pair = |(track, motion): (&Track, &MotionModel)| {
            let off = |look: &Observation| (look.part.center_px - motion.place_px).norm() / look.part.radius_px;
            let fits = |(_, look): &(usize, &Observation)| look.part.kind == track.seen.kind && off(look) < FAR_RADII;
            pool.iter().enumerate().filter(|_| track.frames_unseen == 0).find(fits).map(|(k, _)| k)
        };
        let gated_pairs: Vec<Option<usize>> = self.tracks.iter().zip(&self.motions).map(gated_pair).collect();
        let alone = |gated_pair: &Option<usize>| gated_pairs.iter().filter(|other| *other == gated_pair).count() == 1;
        gated_pairs.iter().map(|gated_pair| gated_pair.filter(|_| alone(gated_pair))).collect()
    }

    fn see(&mut self, i: usize, look: Observation) {
        let (motion, part) = (&mut self.motions[i], look.part);
        if (part.center_px - motion.place_px).norm() < part.radius_px {
            motion.see(part.center_px, part.covariance_px2.trace() / 2.0);
        } else {
            *motion = MotionModel::at_rest(part.center_px, part.radius_px, self.frame_size);
        }
        if look.agreeing >= PLAIN_RAYS {
            self.levels[i] = Some(look.levels);
        }
        self.tracks[i] = Track { seen: part, frames_unseen: 0 };
    }
}

fn is_free(part: &Detection, pool: &[Observation]) -> bool {
    pool.iter().all(|other| !overlap(&other.part, part))
}
