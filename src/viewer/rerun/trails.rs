use std::collections::VecDeque;

use upm_core::geometry::Vec2;

/// Number of points kept of each trail.
const POINTS: usize = 600;

/// Recent paths of several items.
#[derive(Clone, Debug)]
pub(super) struct Trails {
    paths: Vec<VecDeque<Vec2>>,
    /// Displacements shorter than this are not kept, in the unit of the points.
    step: f64,
}

impl Trails {
    /// Empty trails of `count` items, with a point every `step`.
    pub(super) fn new(count: usize, step: f64) -> Self {
        Self { paths: vec![VecDeque::with_capacity(POINTS); count], step }
    }

    /// Appends the newest position of each item.
    pub(super) fn push(&mut self, points: &[Vec2]) {
        for (path, &point) in self.paths.iter_mut().zip(points) {
            if path.back().is_none_or(|last| (point - last).norm() >= self.step) {
                if path.len() == POINTS {
                    path.pop_front();
                }
                path.push_back(point);
            }
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.paths.iter().all(VecDeque::is_empty)
    }

    /// Each trail, oldest point first, with every point mapped by `place`.
    pub(super) fn strips(&self, place: impl Fn(Vec2) -> [f32; 2]) -> Vec<Vec<[f32; 2]>> {
        self.paths.iter().map(|path| path.iter().map(|&point| place(point)).collect()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trails_stay_short_and_coarse() {
        let mut trails = Trails::new(1, 1.0);
        (0..4 * POINTS as i32).for_each(|i| trails.push(&[Vec2::new(f64::from(i) * 0.5, 0.0)]));
        let strips = trails.strips(|p| [p.x as f32, p.y as f32]);
        assert_eq!(strips[0].len(), POINTS);
        assert_eq!(strips[0].last(), Some(&[2.0 * POINTS as f32 - 1.0, 0.0]));
        assert!(strips[0].windows(2).all(|pair| pair[1][0] - pair[0][0] == 1.0));
    }
}
