//! Antialiased lines between subpixel positions; those of `imageproc` begin and end at whole pixels.

use image::{Rgb, RgbImage};
use imageproc::pixelops::interpolate;

use upm_core::geometry::Vec2;

/// Colour picture to draw on. The centre of its first pixel is (0, 0).
pub(super) struct Canvas {
    pub image: RgbImage,
    /// Line width, px.
    pub line_px: f64,
}

impl Canvas {
    /// Canvas whose line width grows with the picture, so that lines stay visible when it is shown scaled down.
    pub fn new(image: RgbImage) -> Self {
        let longest = f64::from(image.width().max(image.height()));
        Self { image, line_px: (longest / 600.0).max(1.2) }
    }

    pub fn circle(&mut self, center: Vec2, radius: f64, color: [u8; 3]) {
        self.stroke([center, center], radius, color, |p| ((p - center).norm() - radius).abs());
    }

    pub fn line(&mut self, a: Vec2, b: Vec2, color: [u8; 3]) {
        let along = b - a;
        let length_squared = along.norm_squared().max(f64::MIN_POSITIVE);
        self.stroke([a.inf(&b), a.sup(&b)], 0.0, color, |p| {
            let share = ((p - a).dot(&along) / length_squared).clamp(0.0, 1.0);
            (p - a - along * share).norm()
        });
    }

    /// Colours the pixels at most half a line's width away by `distance`, within `reach` of the box from `first` to
    /// `last`.
    fn stroke(&mut self, [first, last]: [Vec2; 2], reach: f64, color: [u8; 3], distance: impl Fn(Vec2) -> f64) {
        let reach = reach + self.line_px;
        let span = |from: f64, to: f64, size: u32| {
            let whole = |x: f64| (x.max(0.0) as u32).min(size);
            whole(from - reach)..whole(to + reach + 1.0)
        };
        for y in span(first.y, last.y, self.image.height()) {
            for x in span(first.x, last.x, self.image.width()) {
                let beyond = distance(Vec2::new(f64::from(x), f64::from(y))) - self.line_px / 2.0;
                let covered = (0.5 - beyond).clamp(0.0, 1.0) as f32;
                if covered > 0.0 {
                    let pixel = self.image.get_pixel_mut(x, y);
                    *pixel = interpolate(Rgb(color), *pixel, covered);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ink(canvas: &Canvas) -> f64 {
        canvas.image.pixels().map(|pixel| f64::from(pixel.0[0]) / 255.0).sum()
    }

    #[test]
    fn lines_have_their_length_and_circles_their_round() {
        for at in [Vec2::new(30.0, 30.0), Vec2::new(30.3, 29.6)] {
            let blank = || Canvas::new(RgbImage::new(64, 64));
            let mut canvas = blank();
            canvas.circle(at, 17.25, [255, 0, 0]);
            let round = std::f64::consts::TAU * 17.25 * canvas.line_px;
            assert!((ink(&canvas) / round - 1.0).abs() < 0.02, "{}", ink(&canvas));
            let mut canvas = blank();
            canvas.line(at, at + Vec2::new(21.5, -13.0), [255, 0, 0]);
            // round caps add the area of a disk
            let area = 21.5_f64.hypot(13.0) * canvas.line_px + 0.25 * std::f64::consts::PI * canvas.line_px.powi(2);
            assert!((ink(&canvas) / area - 1.0).abs() < 0.03, "{} {area}", ink(&canvas));
        }
    }

    #[test]
    fn shapes_outside_the_canvas_are_not_drawn() {
        let mut canvas = Canvas::new(RgbImage::new(8, 8));
        canvas.circle(Vec2::new(-1e9, 1e12), 3.0, [255, 0, 0]);
        canvas.line(Vec2::new(f64::NAN, 0.0), Vec2::new(1.0, f64::INFINITY), [255, 0, 0]);
        assert_eq!(ink(&canvas), 0.0);
    }
}
