use std::time::Duration;

use bytes::Bytes;
use parking_lot::Mutex;

use super::draw::{OverlayMark, draw};
use upm_core::signal::Frame;

/// Time for which one request keeps pictures coming, and least time between two pictures.
const WISH: Duration = Duration::from_secs(5);
const APART: Duration = Duration::from_millis(500);

/// Greatest age of a picture that is shown: an older one would pass for the present state.
const OLDEST: Duration = Duration::from_secs(2);

/// Pictures of one plate for viewers. The plate hands over a frame only while a picture is requested and the lock is
/// free: not while one is encoded.
#[derive(Debug, Default)]
pub(super) struct FramePreview(Mutex<Pictures>);

#[derive(Debug, Default)]
struct Pictures {
    /// Time until which pictures are requested.
    wanted_until: Duration,
    /// The last frame handed over, and when. Encoded once for all viewers.
    taken: Option<(Duration, Frame, Vec<OverlayMark>)>,
    /// The picture of that frame.
    png: Option<Bytes>,
}

impl FramePreview {
    /// The newest picture with its age, unless it is too old; requests further ones. Encodes a new frame, which takes
    /// some 10 ms.
    pub fn latest(&self, now: Duration) -> Option<(Bytes, Duration)> {
        let mut pictures = self.0.lock();
        pictures.wanted_until = now + WISH;
        let (taken, frame, marks) = pictures.taken.as_ref()?;
        let age = Some(now.saturating_sub(*taken)).filter(|age| *age <= OLDEST)?;
        let png = pictures.png.clone().or_else(|| draw(frame, marks).map(Bytes::from))?;
        pictures.png = Some(png.clone());
        Some((png, age))
    }

    /// Takes a frame if one is due. Never waits; costs a copy of the frame when it takes it.
    pub fn offer(&self, frame: &Frame, marks: impl FnOnce() -> Vec<OverlayMark>, now: Duration) {
        let Some(mut pictures) = self.0.try_lock() else { return };
        let is_early = pictures.taken.as_ref().is_some_and(|(taken, ..)| now < *taken + APART);
        if !is_early && now < pictures.wanted_until {
            pictures.taken = Some((now, frame.clone(), marks()));
            pictures.png = None;
        }
    }

    /// Discards the previous job's picture.
    pub fn clear(&self) {
        self.0.lock().taken = None;
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
        let preview = FramePreview::default();
        let give = |index: u64, ms: u64| {
            let mut taken = false;
            let marks = || {
                taken = true;
                Vec::new()
            };
            preview.offer(&frame(index), marks, at(ms));
            taken
        };
        let age = |ms: u64| preview.latest(at(ms)).map(|(_, age)| age);
        assert!(!give(1, 0), "nobody asked");
        assert_eq!(age(10), None);
        assert!(give(2, 20) && !give(3, 40) && !give(4, 519), "one in half a second");
        assert!(give(5, 520) && age(530) == Some(at(10)));
        assert!(give(6, 5529) && !give(7, 6100), "a wish ends");
        assert_eq!(age(7529), Some(at(2000)));
        assert_eq!(age(7530), None, "too old to be shown");
        assert!(give(8, 7600) && age(7601) == Some(at(1)), "it is wished for anew");
        preview.clear();
        assert_eq!(age(7602), None);
        let encoding = preview.0.lock();
        preview.offer(&frame(9), || unreachable!("the frame is not taken"), at(9000));
        drop(encoding);
    }
}
