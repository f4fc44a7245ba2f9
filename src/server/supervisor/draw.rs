use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, Rgb, RgbImage};
use imageproc::drawing::{draw_cross_mut, draw_hollow_circle_mut};

use upm_core::geometry::Vec2;
use upm_core::signal::Frame;

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
pub(super) fn draw(frame: &Frame, marks: &[OverlayMark]) -> Option<Vec<u8>> {
    let (width, height) = (frame.width / 2, frame.height / 2);
    let mut picture = RgbImage::new(u32::try_from(width).ok()?, u32::try_from(height).ok()?);
    let rows = picture.as_flat_samples_mut().samples.chunks_exact_mut(3 * width.max(1));
    for (y, row) in rows.enumerate() {
        let (top, bottom) = (frame.row(2 * y), frame.row(2 * y + 1));
        let pairs = top.as_chunks::<2>().0.iter().zip(bottom.as_chunks::<2>().0);
        for (pixel, ([a, b], [c, d])) in row.as_chunks_mut::<3>().0.iter_mut().zip(pairs) {
            let mean = (u16::from(*a) + u16::from(*b) + u16::from(*c) + u16::from(*d) + 2) / 4;
            *pixel = [mean as u8; 3];
        }
    }
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
    use upm_core::geometry::Vec2;

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
