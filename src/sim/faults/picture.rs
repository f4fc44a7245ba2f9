//! Faults between the scene and the picture.

use rand_pcg::rand_core::Rng as _;

use upm_core::geometry::Vec2;
use upm_core::random::Rng;
use upm_core::signal::Frame;

/// Gray level of a hand.
const HAND: u8 = 120;

/// Covers `share` of the view with a hand, from the left.
pub(super) fn cover(frame: &mut Frame, share: f64) {
    let columns = ((share * frame.width as f64).round() as usize).min(frame.width);
    if let Some(positions) = &mut frame.positions {
        positions.hide(|at_px| at_px.x < columns as f64);
    }
    for (y, row) in frame.pixels.chunks_exact_mut(frame.width.max(1)).enumerate() {
        for (x, pixel) in row.iter_mut().take(columns).enumerate() {
            // skin is not uniform
            *pixel = HAND + ((x * 7 + y * 13) % 16) as u8;
        }
    }
}

/// A disc as the camera sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenDisc {
    pub center_px: Vec2,
    pub radius_px: f64,
    /// Its gray level.
    pub level: f64,
}

/// Paints a disc over the scene, with a rim as soft as one pixel.
pub(super) fn paint(frame: &mut Frame, disc: SeenDisc) {
    let reach = disc.radius_px + 1.0;
    let range = |middle: f64, size: usize| {
        let at = |value: f64| value.clamp(0.0, size as f64) as usize;
        at((middle - reach).floor())..at((middle + reach).ceil() + 1.0)
    };
    for y in range(disc.center_px.y, frame.height) {
        for x in range(disc.center_px.x, frame.width) {
            let away_px = (Vec2::new(x as f64, y as f64) - disc.center_px).norm();
            let covered = (disc.radius_px - away_px + 0.5).clamp(0.0, 1.0);
            if let Some(pixel) = frame.pixels.get_mut(y * frame.width + x) {
                *pixel = (f64::from(*pixel) * (1.0 - covered) + disc.level * covered).round() as u8;
            }
        }
    }
}

/// Shifts by `shift_px` and turns by `turn_rad` about the middle; pixels from outside take the nearest border's level.
pub(super) fn knock(frame: &mut Frame, shift_px: Vec2, turn_rad: f64) {
    let (width, height) = (frame.width, frame.height);
    if width < 2 || height < 2 {
        return;
    }
    let (sin, cos) = libm::sincos(turn_rad);
    let middle = Vec2::new(width as f64 - 1.0, height as f64 - 1.0) * 0.5;
    if let Some(positions) = &mut frame.positions {
        let turned = |from: Vec2| Vec2::new(cos * from.x - sin * from.y, cos * from.y + sin * from.x);
        positions.displace(|at_px| turned(at_px - middle) + middle + shift_px);
    }
    let before = frame.pixels.clone();
    let last = Vec2::new(width as f64 - 1.0, height as f64 - 1.0);
    for (i, pixel) in frame.pixels.iter_mut().enumerate() {
        let to = Vec2::new((i % width) as f64, (i / width) as f64) - shift_px - middle;
        let from = Vec2::new(cos * to.x + sin * to.y, cos * to.y - sin * to.x) + middle;
        let from = Vec2::new(from.x.clamp(0.0, last.x), from.y.clamp(0.0, last.y));
        let (x, y) = ((from.x as usize).min(width - 2), (from.y as usize).min(height - 2));
        let (u, v) = (from.x - x as f64, from.y - y as f64);
        let at = |x: usize, y: usize| f64::from(before[y * width + x]);
        let above = at(x, y) * (1.0 - u) + at(x + 1, y) * u;
        let below = at(x, y + 1) * (1.0 - u) + at(x + 1, y + 1) * u;
        *pixel = (above * (1.0 - v) + below * v).round() as u8;
    }
}

/// Exchanges left and right.
pub(super) fn mirror(frame: &mut Frame) {
    let last = frame.width as f64 - 1.0;
    if let Some(positions) = &mut frame.positions {
        positions.displace(|at_px| Vec2::new(last - at_px.x, at_px.y));
    }
    frame.pixels.chunks_exact_mut(frame.width.max(1)).for_each(<[u8]>::reverse);
}

/// Multiplies all levels by `gain`, up to white.
pub(super) fn light(frame: &mut Frame, gain: f64) {
    let table: [u8; 256] = std::array::from_fn(|level| (level as f64 * gain).round().clamp(0.0, 255.0) as u8);
    frame.pixels.iter_mut().for_each(|pixel| *pixel = table[usize::from(*pixel)]);
}

/// Replaces the whole picture by noise in the bits of `mask`; read noise has the lowest two.
pub(super) fn scatter(frame: &mut Frame, noise: &mut Rng, mask: u8) {
    if let Some(positions) = &mut frame.positions {
        positions.hide(|_| true);
    }
    for pixels in frame.pixels.chunks_mut(8) {
        let bytes = noise.next_u64().to_le_bytes();
        pixels.iter_mut().zip(bytes).for_each(|(pixel, byte)| *pixel = byte & mask);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::random::Streams;
    use upm_core::signal::{MeasuredDisc, MeasuredPositions};

    /// A picture with one white pixel at (12, 5).
    fn dot() -> Frame {
        let mut frame = Frame::new(20, 10);
        frame.pixels[5 * 20 + 12] = 200;
        frame
    }

    fn white(frame: &Frame) -> Vec<(usize, usize)> {
        let bright = frame.pixels.iter().enumerate().filter(|(_, level)| **level > 100);
        bright.map(|(i, _)| (i % frame.width, i / frame.width)).collect()
    }

    #[test]
    fn picture_goes_where_the_knock_takes_it() {
        let knocked = |shift, turn_rad| {
            let mut frame = dot();
            knock(&mut frame, shift, turn_rad);
            frame
        };
        assert_eq!(white(&knocked(Vec2::new(3.0, -2.0), 0.0)), [(15, 3)]);
        assert_eq!(white(&knocked(Vec2::zeros(), std::f64::consts::PI)), [(7, 4)]);
        let half = knocked(Vec2::new(0.5, 0.0), 0.0);
        assert_eq!((half.pixels[5 * 20 + 12], half.pixels[5 * 20 + 13]), (100, 100));
        let mut frame = dot();
        mirror(&mut frame);
        assert_eq!(white(&frame), [(7, 5)]);
    }

    #[test]
    fn positions_are_hidden_and_displaced_as_the_picture_is() {
        let disc = |x, y| MeasuredDisc { center_px: Vec2::new(x, y), sd_px: 0.01, radius_m: 0.01 };
        let seen = |change: &dyn Fn(&mut Frame)| {
            let corners_px = Some([(2.0, 1.0), (17.0, 1.0), (17.0, 8.0), (2.0, 8.0)].map(|(x, y)| Vec2::new(x, y)));
            let positions = Some(MeasuredPositions { corners_px, discs: vec![disc(4.0, 5.0), disc(12.0, 5.0)] });
            let mut frame = Frame { pixels: Vec::new(), positions, ..Frame::new(20, 10) };
            change(&mut frame);
            frame.positions.unwrap()
        };
        let hidden = seen(&|frame| cover(frame, 0.4));
        assert_eq!((hidden.corners_px, hidden.discs), (None, vec![disc(12.0, 5.0)]));
        assert_eq!(seen(&|frame| cover(frame, 0.05)), seen(&|_| ()), "beside the plate");
        let dark = seen(&|frame| scatter(frame, &mut Streams::new(1).stream("faults"), 0x03));
        assert_eq!(dark, MeasuredPositions::default());
        let knocked = seen(&|frame| knock(frame, Vec2::new(3.0, -2.0), 0.0));
        assert_eq!((knocked.discs[1], knocked.corners_px.unwrap()[0]), (disc(15.0, 3.0), Vec2::new(5.0, -1.0)));
        let turned = seen(&|frame| knock(frame, Vec2::zeros(), std::f64::consts::PI));
        assert!((turned.discs[1].center_px - Vec2::new(7.0, 4.0)).norm() < 1e-9, "{turned:?}");
        assert_eq!(seen(&mirror).discs[1], disc(7.0, 5.0));
    }

    #[test]
    fn covered_painted_and_lit_pixels_change_and_no_others() {
        let mut frame = dot();
        cover(&mut frame, 0.25);
        assert_eq!(frame.pixels.iter().filter(|level| (HAND..HAND + 16).contains(level)).count(), 50);
        paint(&mut frame, SeenDisc { center_px: Vec2::new(12.0, 5.0), radius_px: 2.0, level: 30.0 });
        assert_eq!((frame.pixels[5 * 20 + 12], frame.pixels[5 * 20 + 14]), (30, 15));
        paint(&mut frame, SeenDisc { center_px: Vec2::new(-9.0, 5.0), radius_px: 3.0, level: 30.0 });
        light(&mut frame, 10.0);
        assert_eq!(frame.pixels[5 * 20 + 12], 255);
        scatter(&mut frame, &mut Streams::new(1).stream("faults"), 0x03);
        assert!(frame.pixels.iter().all(|&level| level < 4));
        scatter(&mut frame, &mut Streams::new(1).stream("faults"), 0xff);
        assert!(frame.pixels.iter().filter(|&&level| level > 127).count() > 60);
    }
}
