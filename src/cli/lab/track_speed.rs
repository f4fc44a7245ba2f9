use std::time::Duration;

use upm_core::geometry::Vec2;
use upm_core::signal::Frame;
use upm_core::time::{Clock, MonotonicClock};
use upm_perception::vision::{CoinFinder, Tracker, locate_table};
use upm_scene::{Scene, SceneDisc, kinds};

/// Number of frames of the film, and displacement of the part between frames, m (3 px).
const FRAMES: usize = 48;
const STEP_M: f64 = 0.7e-3;

/// Frames at the film's end that are replayed back and forth, and how often, so that they stay in the processor's
/// cache.
const CACHED: usize = 4;
const ROUNDS: usize = 60;

/// Time to track one part, per frame.
pub(super) struct TrackTimes {
    /// In frames seen for the first time.
    pub(super) fresh: Duration,
    /// In frames that are in the processor's cache.
    pub(super) cached: Duration,
}

/// Median times over a film of 1280 × 1024 px in which a penny of 40 px radius moves by 3 px a frame under noise.
/// `None` if the tracker loses it.
pub(super) fn tracking() -> Option<TrackTimes> {
    let scene = Scene { noise_sd: 4.0, blur_px: 1.0, ..Scene::plain(1) };
    let kinds: Vec<_> = kinds().into_iter().take(1).collect();
    let penny = kinds.first()?;
    let film: Vec<_> = (0..FRAMES)
        .map(|i| Vec2::new(-0.016 + STEP_M * i as f64, 0.02))
        .map(|at_m| scene.frame_with(&[SceneDisc::new(at_m, penny.radius_m, penny.thickness_m)]))
        .collect();
    let first = film.first()?;
    let table = locate_table(first, &scene.lens, scene.side_m).ok()?;
    let start = CoinFinder::new(&table, scene.size_px, &kinds, true).find(first);
    let mut tracker = Tracker::new(&table, scene.size_px, &kinds, true, start);
    let clock = MonotonicClock::new();
    let mut median = |frames: &mut dyn Iterator<Item = &Frame>| {
        let timed = frames.map(|frame| {
            let begun = clock.elapsed();
            tracker.track(frame);
            clock.elapsed() - begun
        });
        let mut took: Vec<Duration> = timed.collect();
        took.sort_unstable();
        let followed = tracker.tracks().len() == 1 && tracker.tracks().iter().all(|track| track.frames_unseen == 0);
        took.get(took.len() / 2).copied().filter(|_| followed)
    };
    let fresh = median(&mut film.iter().skip(1))?;
    let last = film.get(FRAMES - CACHED..)?;
    let round = last.iter().rev().chain(last);
    let cached = median(&mut round.cycle().take(2 * CACHED * ROUNDS))?;
    Some(TrackTimes { fresh, cached })
}
