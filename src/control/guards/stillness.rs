/// Frames in a row, after the first, that show the plate at exactly the same place.
const FRAMES: u32 = 3;
/// Difference of the displacements that the plate should have in them, px.
const SWING_PX: f64 = 0.3;

/// Notices a picture that stands still while the plate is swung, whether or not the camera is known to have noise.
#[derive(Clone, Debug, Default)]
pub struct StillnessGuard {
    seen: Option<f64>,
    frames: u32,
    /// Least and largest displacement that was expected in these frames, px.
    expected: (f64, f64),
    is_still: bool,
}

impl StillnessGuard {
    /// Takes the largest displacement of a corner as seen and as expected, px; true from where the picture stands still on,
    /// until it changes.
    pub fn check(&mut self, seen: Option<f64>, expected: f64) -> bool {
        let seen = seen.filter(|px| px.is_finite());
        if seen.is_none() || seen != self.seen {
            *self = Self { seen, frames: 0, expected: (expected, expected), is_still: false };
            return false;
        }
        self.frames += 1;
        self.expected = (self.expected.0.min(expected), self.expected.1.max(expected));
        self.is_still |= self.frames >= FRAMES && self.expected.1 - self.expected.0 > SWING_PX;
        self.is_still
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picture_that_does_not_follow_the_drive_stands_still_until_it_changes() {
        let mut guard = StillnessGuard::default();
        let still = [0.0, 0.2, 0.4, 0.6, 0.0, 0.0].map(|expected| guard.check(Some(0.05), expected));
        assert_eq!(still, [false, false, false, true, true, true]);
        assert!(!guard.check(Some(0.06), 0.0));
    }

    #[test]
    fn plate_at_rest_and_plate_out_of_reach_tell_nothing() {
        let mut guard = StillnessGuard::default();
        assert!((0..20).all(|_| !guard.check(Some(0.05), 0.0)), "nothing should move");
        assert!((0..20).all(|i| !guard.check(Some(f64::INFINITY), f64::from(i))));
        assert!((0..20).all(|i| !guard.check(None, f64::from(i))));
        assert!((0..20).all(|i| !guard.check(Some(0.01 * f64::from(i)), f64::from(i))), "noise");
    }
}
