use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use parking_lot::Mutex;

use super::draw::{OverlayMark, draw};
use super::watchdog::ms;
use upm_core::signal::Frame;

/// Time for which one request keeps pictures coming, and least time between two pictures.
const WISH: Duration = Duration::from_secs(5);
const APART: Duration = Duration::from_millis(500);

/// Greatest age of a picture that is shown: an older one would pass for the present state.
const OLDEST: Duration = Duration::from_secs(2);

/// A camera frame with the observed parts drawn over it, encoded once for all viewers.
#[derive(Clone, Debug, PartialEq)]
pub struct PreviewPicture {
    /// The PNG file.
    pub png: Vec<u8>,
    /// Time of the frame on the daemon's clock.
    pub taken: Duration,
}

/// A frame that the plate handed over.
#[derive(Clone, Debug)]
struct Raw {
    frame: Frame,
    marks: Vec<OverlayMark>,
    taken: Duration,
    fresh: bool,
}

impl Default for Raw {
    fn default() -> Self {
        Self { frame: Frame::new(0, 0), marks: Vec::new(), taken: Duration::ZERO, fresh: false }
    }
}

/// Pictures of one plate for viewers. The plate hands over a frame only while a picture is requested and the lock is
/// free.
#[derive(Debug, Default)]
pub(super) struct FramePreview {
    /// Time until which pictures are requested, and time of the last frame handed over, ms of the daemon's clock.
    wanted_until_ms: AtomicU64,
    given_at_ms: AtomicU64,
    raw: Mutex<Raw>,
    newest: Mutex<Option<Arc<PreviewPicture>>>,
}

impl FramePreview {
    /// The newest picture, unless it is too old; requests further ones. Encodes a new frame, which takes some 10 ms.
    pub fn latest(&self, now: Duration) -> Option<Arc<PreviewPicture>> {
        self.wanted_until_ms.store(ms(now + WISH), Ordering::Relaxed);
        self.encode();
        let newest = self.newest.lock().clone();
        newest.filter(|picture| now.saturating_sub(picture.taken) <= OLDEST)
    }

    /// Takes a frame if one is due. Never waits; costs a copy of the frame when it takes it.
    pub fn offer(&self, frame: &Frame, marks: impl FnOnce() -> Vec<OverlayMark>, now: Duration) {
        let given_ms = self.given_at_ms.load(Ordering::Relaxed);
        let early = given_ms != 0 && ms(now) < given_ms + ms(APART);
        if early || ms(now) >= self.wanted_until_ms.load(Ordering::Relaxed) {
            return;
        }
        let Some(mut raw) = self.raw.try_lock() else { return };
        raw.frame.clone_from(frame);
        (raw.marks, raw.taken, raw.fresh) = (marks(), now, true);
        self.given_at_ms.store(ms(now).max(1), Ordering::Relaxed);
    }

    /// Encodes the frame handed over, if there is a new one.
    fn encode(&self) {
        let mut raw = self.raw.lock();
        if !std::mem::take(&mut raw.fresh) {
            return;
        }
        if let Some(png) = draw(&raw.frame, &raw.marks) {
            *self.newest.lock() = Some(Arc::new(PreviewPicture { png, taken: raw.taken }));
        }
    }

    /// Discards the previous job's picture.
    pub fn clear(&self) {
        *self.newest.lock() = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::time::PlateTime;

    fn frame(index: u64) -> Frame {
        Frame {
            width: 64,
            height: 48,
            pixels: vec![90; 64 * 48],
            positions: None,
            index,
            exposed_at: PlateTime::from_secs(index as f64),
        }
    }

    fn at(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn frames_are_copied_only_on_request_and_at_most_twice_a_second() {
        let window = FramePreview::default();
        let give = |index: u64, ms: u64| {
            let mut taken = false;
            let marks = || {
                taken = true;
                Vec::new()
            };
            window.offer(&frame(index), marks, at(ms));
            window.encode();
            taken
        };
        assert!(!give(1, 0), "nobody asked");
        assert_eq!(window.latest(at(10)), None);
        assert!(give(2, 20) && !give(3, 40) && !give(4, 519), "one in half a second");
        assert!(give(5, 520) && window.latest(at(530)).unwrap().taken == at(520));
        assert!(give(6, 5529) && !give(7, 6100), "a wish ends");
        window.clear();
        assert_eq!(window.latest(at(7000)), None);
    }

    #[test]
    fn too_old_picture_is_not_returned() {
        let window = FramePreview::default();
        window.latest(at(0));
        window.offer(&frame(1), Vec::new, at(10));
        window.encode();
        assert!(window.latest(at(2010)).is_some());
        assert_eq!(window.latest(at(2011)), None, "it is wished for anew");
        window.offer(&frame(2), Vec::new, at(2100));
        window.encode();
        assert_eq!(window.latest(at(2101)).unwrap().taken, at(2100));
    }

    #[test]
    fn a_busy_encoder_costs_the_plate_nothing() {
        let window = FramePreview::default();
        window.latest(at(0));
        let encoding = window.raw.lock();
        window.offer(&frame(1), || unreachable!("the frame is not taken"), at(0));
        drop(encoding);
        window.encode();
        assert_eq!(window.latest(at(1)), None);
    }
}
