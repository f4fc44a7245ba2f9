use std::time::Duration;

use bytes::Bytes;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, Rgb, RgbImage};
use imageproc::drawing::{draw_cross_mut, draw_hollow_circle_mut};
use parking_lot::Mutex;

use upm_core::geometry::Vec2;
use upm_core::signal::Frame;

/// Time for which one request keeps pictures coming, and least time between two pictures.
const WISH: Duration = Duration::from_secs(5);
const APART: Duration = Duration::from_millis(500);

/// Greatest age of a picture of a job that runs: an older one would pass for the present state.
pub(super) const OLDEST: Duration = Duration::from_secs(2);

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
    /// The newest picture with its age, unless that is above `oldest`; requests further ones. Encodes a new frame,
    /// which takes some 10 ms.
    pub fn latest(&self, now: Duration, oldest: Duration) -> Option<(Bytes, Duration)> {
        let mut pictures = self.0.lock();
        pictures.wanted_until = now + WISH;
        let (taken, frame, marks) = pictures.taken.as_ref()?;
        let age = Some(now.saturating_sub(*taken)).filter(|age| *age <= oldest)?;
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

const SEEN: Rgb<u8> = Rgb([0, 220, 90]);
const UNSEEN: Rgb<u8> = Rgb([255, 60, 40]);
const TARGET: Rgb<u8> = Rgb([60, 160, 255]);

/// A mark drawn over a frame, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct OverlayMark {
    pub center_px: Vec2,
    /// Radius; 0 for a target.
    pub radius_px: f64,
    /// False for a part that the frame does not show at its expected position.
    pub seen: bool,
}

/// `frame` at half its size with `marks` drawn over it, as PNG; `None` for a frame without pixels.
fn draw(frame: &Frame, marks: &[OverlayMark]) -> Option<Vec<u8>> {
    let [width, height] = [frame.width / 2, frame.height / 2].map(u32::try_from);
    let mut picture = RgbImage::from_fn(width.ok()?, height.ok()?, |x, y| {
        let (x, y) = (2 * x as usize, 2 * y as usize);
        let levels = [y, y + 1].into_iter().flat_map(|y| frame.row(y).get(x..x + 2).unwrap_or(&[0; 2]));
        let sum: u16 = levels.map(|level| u16::from(*level)).sum();
        Rgb([((sum + 2) / 4) as u8; 3])
    });
    for mark in marks {
        mark_in(&mut picture, mark);
    }
    let mut png = Vec::new();
    PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Sub)
        .write_image(picture.as_raw(), picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .ok()?;
    Some(png)
}

fn mark_in(picture: &mut RgbImage, mark: &OverlayMark) {
    // the centre of a half-size pixel is midway between the centres of two full-size pixels
    let half = |px: f64| ((px - 0.5) / 2.0).round();
    let (x, y) = (half(mark.center_px.x), half(mark.center_px.y));
    let near = |v: f64, size: u32| v.is_finite() && v > -100.0 && v < f64::from(size) + 100.0;
    if !(near(x, picture.width()) && near(y, picture.height())) {
        return;
    }
    let center = (x as i32, y as i32);
    if mark.radius_px > 0.0 {
        let color = if mark.seen { SEEN } else { UNSEEN };
        let radius = (mark.radius_px / 2.0).round().min(1000.0) as i32;
        draw_hollow_circle_mut(picture, center, radius, color);
        draw_hollow_circle_mut(picture, center, radius + 1, color);
    } else {
        draw_cross_mut(picture, TARGET, center.0, center.1);
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
        let age = |ms: u64| preview.latest(at(ms), OLDEST).map(|(_, age)| age);
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

    #[test]
    fn parts_are_ringed_and_targets_crossed() {
        let frame = Frame::of_picture(200, 100, vec![100; 200 * 100]).unwrap();
        let mark = |x: f64, y: f64, radius_px: f64, seen| OverlayMark { center_px: Vec2::new(x, y), radius_px, seen };
        let marks = [
            mark(40.5, 40.5, 20.0, true),
            mark(140.5, 40.5, 20.0, false),
            mark(80.5, 80.5, 0.0, true),
            mark(f64::NAN, 0.0, 5.0, true),
            mark(1e9, 0.0, 5.0, true),
        ];
        let picture = image::load_from_memory(&draw(&frame, &marks).unwrap()).unwrap().into_rgb8();
        assert_eq!(picture.dimensions(), (100, 50));
        let at = |x, y| *picture.get_pixel(x, y);
        assert_eq!([at(30, 20), at(80, 20), at(40, 40)], [SEEN, UNSEEN, TARGET]);
        assert_eq!(at(20, 20), Rgb([100; 3]), "nothing within a ring");
    }

    #[test]
    fn odd_frame_sizes_are_encoded_without_a_fault() {
        let frame = |width, height| Frame::new(width, height);
        assert!(draw(&frame(0, 0), &[]).is_none_or(|png| !png.is_empty()));
        assert!(draw(&frame(3, 1), &[]).is_none_or(|png| !png.is_empty()));
        assert!(draw(&frame(33, 17), &[]).is_some());
    }
}
