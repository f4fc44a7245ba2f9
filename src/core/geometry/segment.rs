use super::Vec2;

/// A straight line segment between two points.
///
/// Two points that move straight and in step have their least distance where the segment from their first to their last
/// difference is nearest to the origin.
///
/// ```
/// use upm_core::geometry::{Segment, Vec2};
/// let segment = Segment { from: Vec2::new(-1.0, 2.0), to: Vec2::new(3.0, 2.0) };
/// assert_eq!(segment.nearest_share(Vec2::zeros()), 0.25);
/// assert_eq!(segment.distance(Vec2::zeros()), 2.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Start point.
    pub from: Vec2,
    /// End point.
    pub to: Vec2,
}

impl Segment {
    /// Position of the point nearest to `p` as a share of the length, from 0 at the start to 1 at the end; 0 where both
    /// ends are one point.
    #[inline]
    pub fn nearest_share(&self, p: Vec2) -> f64 {
        let along = self.to - self.from;
        let length_sq = along.norm_squared();
        if length_sq > 0.0 { ((p - self.from).dot(&along) / length_sq).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// The point of the segment nearest to `p`.
    #[inline]
    pub fn nearest(&self, p: Vec2) -> Vec2 {
        self.from + (self.to - self.from) * self.nearest_share(p)
    }

    /// Distance of `p` from the segment.
    #[inline]
    pub fn distance(&self, p: Vec2) -> f64 {
        (self.nearest(p) - p).norm()
    }
}
