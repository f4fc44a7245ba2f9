use std::collections::VecDeque;

use super::delay::{LATE, NOISE_PX};
use upm_core::job::Finding;
use upm_core::signal::Frame;
use upm_core::time::PlateTime;

/// Number of bands of a frame that are checked separately: one of them may freeze while the others go on.
const BANDS: usize = 4;
/// One row in this many is compared.
const ROW_STEP: usize = 8;
/// Number of pictures remembered: a camera may repeat the same few in turn.
const REMEMBERED: usize = 8;

/// Difference of displacements that noise does not explain, px.
const SWING_PX: f64 = 6.0 * NOISE_PX;

/// The finding that makes a frame unusable, and its reason for people.
pub type Unusable = (Finding, String);

/// Distinguishes frames of the present from old ones.
#[derive(Clone, Debug, Default)]
pub struct Freshness {
    frame_s: f64,
    exposure_s: f64,
    last: Option<(u64, PlateTime)>,
    /// For each band its last pictures, and whether noise is visible in it: they differed in the first two frames,
    /// which show the same scene, or as a whole later.
    bands: [(VecDeque<Vec<u8>>, bool); BANDS],
    /// True once a frame has differed from the first.
    pub changed: bool,
    /// Displacement of the corners that the last frames show exactly, px, and the least and the largest that the plate
    /// should have in them.
    still: (Option<f64>, [f64; 2]),
}

impl Freshness {
    /// A check for a camera of this frame rate and exposure.
    pub fn new(frame_hz: f64, exposure_s: f64) -> Self {
        Self { frame_s: frame_hz.recip(), exposure_s, ..Self::default() }
    }

    /// Checks `frame`, which arrived at `now`; `Some` where it does not show the present. `swing_px` is the largest
    /// displacement of a corner that it shows, and the one that the plate should have.
    pub fn check(&mut self, frame: &Frame, now: PlateTime, swing_px: (Option<f64>, f64)) -> Option<Unusable> {
        let before = self.last.replace((frame.index, frame.exposed_at));
        let older_s = now - frame.exposed_at;
        let is_next = before.is_none_or(|(index, at)| frame.index > index && frame.exposed_at > at);
        // the transfer of a picture that is not late yet, and the frame in which it is taken
        let oldest_s = (LATE + 1) as f64 * self.frame_s + self.exposure_s;
        let in_time = (-self.frame_s..=oldest_s).contains(&older_s);
        let is_old = self.stands_still(swing_px) | self.repeats(frame);
        if !is_next || !in_time {
            let reason = format!("a frame's number or stamp does not fit: it is {:.0} ms old", older_s * 1e3);
            return Some((Finding::CameraStale, reason));
        }
        is_old.then(|| (Finding::CameraFrozen, "the camera sends the same picture again".to_owned()))
    }

    /// True where noise makes pictures unique, and this one, or a band of it, repeats one of the last.
    fn repeats(&mut self, frame: &Frame) -> bool {
        let mut repeated = false;
        let height = frame.height.div_ceil(BANDS).max(1);
        for (band, (seen, is_noisy)) in self.bands.iter_mut().enumerate() {
            let mut pixels = Vec::new();
            for y in (band * height..((band + 1) * height).min(frame.height)).step_by(ROW_STEP) {
                let row = frame.pixels.get(y * frame.width..(y + 1) * frame.width);
                pixels.extend_from_slice(row.unwrap_or_default());
            }
            // positions in place of pixels have noise, too
            let discs = frame.positions.iter().flat_map(|positions| &positions.discs);
            pixels.extend(discs.flat_map(|disc| disc.center_px.iter()).flat_map(|px| px.to_le_bytes()));
            // black or white shows no noise
            let is_uniform = pixels.iter().all(|pixel| Some(pixel) == pixels.first());
            if let Some(last) = seen.front().filter(|_| !*is_noisy) {
                let differing = pixels.iter().zip(last).filter(|(pixel, before)| pixel != before).count();
                // noise differs in most pixels, a moving plate along its sides only
                let least = if seen.len() == 1 || frame.positions.is_some() { 0 } else { pixels.len() / 2 };
                *is_noisy = !is_uniform && differing > least;
                self.changed |= differing > 0;
            }
            repeated |= *is_noisy && !is_uniform && seen.contains(&pixels);
            seen.truncate(REMEMBERED - 1);
            seen.push_front(pixels);
        }
        repeated
    }

    /// True from the frame at which the picture counts as frozen, whether or not the camera is known to have noise,
    /// until it changes.
    fn stands_still(&mut self, (seen_px, expected_px): (Option<f64>, f64)) -> bool {
        let seen_px = seen_px.filter(|px| px.is_finite());
        if seen_px.is_none() || seen_px != self.still.0 {
            self.still = (seen_px, [expected_px; 2]);
        }
        let (_, [least_px, most_px]) = &mut self.still;
        (*least_px, *most_px) = (least_px.min(expected_px), most_px.max(expected_px));
        *most_px - *least_px > SWING_PX
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::Vec2;
    use upm_core::signal::{MeasuredDisc, MeasuredPositions};

    /// Frame `index` at 60 per second with noise of `seed`.
    fn frame(index: u64, seed: u64) -> Frame {
        let mut frame = Frame::new(40, 64);
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        for pixel in &mut frame.pixels {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            *pixel = 100 + (state >> 62) as u8;
        }
        (frame.index, frame.exposed_at) = (index, PlateTime::from_secs(index as f64 / 60.0));
        frame
    }

    fn check(of: &mut Freshness, frame: &Frame) -> Option<Finding> {
        of.check(frame, frame.exposed_at + 0.002, (None, 0.0)).map(|(finding, _)| finding)
    }

    #[test]
    fn picture_that_comes_again_is_stale_and_new_ones_are_not() {
        let mut fresh = Freshness::new(60.0, 0.004);
        assert!((1..50).all(|i| check(&mut fresh, &frame(i, i)).is_none()));
        assert_eq!(check(&mut fresh, &frame(50, 49)), Some(Finding::CameraFrozen));
        assert_eq!(check(&mut fresh, &frame(51, 47)), Some(Finding::CameraFrozen), "one of several");
        assert_eq!(check(&mut fresh, &frame(52, 52)), None);
        let mut torn = frame(53, 53);
        torn.pixels[..16 * 40].copy_from_slice(&frame(52, 52).pixels[..16 * 40]);
        assert_eq!(check(&mut fresh, &torn), Some(Finding::CameraFrozen), "a quarter of it stands still");
    }

    #[test]
    fn positions_that_come_again_are_stale_and_hidden_ones_are_not() {
        let mut fresh = Freshness::new(60.0, 0.004);
        let at = |index: u64, x_px: f64| {
            let disc = MeasuredDisc { center_px: Vec2::new(x_px, 5.0), sd_px: 0.01, radius_m: 0.01 };
            let positions = Some(MeasuredPositions { corners_px: None, discs: vec![disc] });
            Frame { pixels: Vec::new(), positions, ..frame(index, 1) }
        };
        let stale =
            [7.0, 7.01, 7.01, 7.02].into_iter().zip(1..).map(|(x_px, index)| check(&mut fresh, &at(index, x_px)));
        assert_eq!(stale.collect::<Vec<_>>(), [None, None, Some(Finding::CameraFrozen), None]);
        let hidden = |index| Frame { positions: Some(MeasuredPositions::default()), ..at(index, 0.0) };
        assert_eq!([5, 6].map(|index| check(&mut fresh, &hidden(index))), [None, None]);
    }

    #[test]
    fn noise_is_seen_after_a_first_picture_that_came_twice() {
        let mut fresh = Freshness::new(60.0, 0.004);
        let pictures = [1, 1, 2, 3, 4, 4];
        let stale = (1..).zip(pictures).map(|(i, seed)| check(&mut fresh, &frame(i, seed))).collect::<Vec<_>>();
        assert_eq!(stale, [None, None, None, None, None, Some(Finding::CameraFrozen)]);
    }

    #[test]
    fn camera_without_noise_may_show_the_same_picture() {
        let mut fresh = Freshness::new(60.0, 0.004);
        assert!((1..20).all(|i| check(&mut fresh, &frame(i, 7)).is_none()));
        let mut fresh = Freshness::new(60.0, 0.004);
        let black = |i| Frame { pixels: vec![0; 40 * 64], ..frame(i, 1) };
        assert!((1..20).all(|i| check(&mut fresh, &black(i)).is_none()));
    }

    #[test]
    fn stamp_that_does_not_fit_the_present_is_stale() {
        let mut fresh = Freshness::new(60.0, 0.004);
        assert_eq!(check(&mut fresh, &frame(1, 1)), None);
        assert_eq!(check(&mut fresh, &frame(1, 2)), Some(Finding::CameraStale), "the same number");
        let mut told = |frame: &Frame, now| fresh.check(frame, now, (None, 0.0)).map(|(_, reason)| reason).unwrap();
        let late = frame(9, 9);
        assert!(told(&late, late.exposed_at + 0.2).ends_with(" 200 ms old"));
        assert!(told(&frame(10, 10), PlateTime::from_secs(0.1)).ends_with(" -67 ms old"));
    }

    #[test]
    fn picture_that_does_not_follow_the_drive_is_frozen_until_it_changes() {
        let mut guard = Freshness::default();
        let still = [0.0, 0.2, 0.4, 0.6, 0.0, 0.0].map(|expected| guard.stands_still((Some(0.05), expected)));
        assert_eq!(still, [false, false, true, true, true, true]);
        assert!(!guard.stands_still((Some(0.06), 0.0)));
    }

    #[test]
    fn resting_unmeasured_or_noisy_plate_is_not_reported_frozen() {
        let mut guard = Freshness::default();
        assert!((0..20).all(|_| !guard.stands_still((Some(0.05), 0.0))), "nothing should move");
        assert!((0..20).all(|i| !guard.stands_still((Some(f64::INFINITY), f64::from(i)))));
        assert!((0..20).all(|i| !guard.stands_still((None, f64::from(i)))));
        assert!((0..20).all(|i| !guard.stands_still((Some(0.01 * f64::from(i)), f64::from(i)))), "noise");
    }
}
