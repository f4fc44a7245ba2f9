use upm_core::geometry::{Twist, Vec2};

/// Distance of the centre of rotation beyond which a motion is named by its direction, m: across a plate of 0.3 m such
/// a field turns by less than 3.5°.
const FAR_M: f64 = 5.0;

/// Motion of a library entry as described to people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionRecord {
    /// A rotation.
    About {
        /// Its centre, m.
        center_m: Vec2,
        /// True when a positive distance turns parts counter-clockwise.
        counter_clockwise: bool,
    },
    /// Approximately a translation.
    Along {
        /// Its direction at the plate's centre, of length 1.
        direction: Vec2,
    },
}

impl MotionRecord {
    /// The description of the flow along `pump`; `None` for zero motion.
    pub fn of(pump: &Twist) -> Option<Self> {
        match pump.center_of_rotation() {
            Some(center_m) if center_m.norm() <= FAR_M => {
                Some(Self::About { center_m, counter_clockwise: pump.spin_radps > 0.0 })
            }
            _ => {
                let direction = pump.direction_at(Vec2::zeros());
                (direction.norm() > 0.5).then_some(Self::Along { direction })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_centres_are_directions() {
        let near = Vec2::new(0.1, -0.05);
        let turn = MotionRecord::of(&Twist::about(near, -2.0));
        assert!(
            matches!(turn, Some(MotionRecord::About { center_m, counter_clockwise: false }) if (center_m - near).norm() < 1e-12)
        );
        let far = MotionRecord::of(&Twist::about(Vec2::new(0.0, -100.0), 1.0));
        assert!(
            matches!(far, Some(MotionRecord::Along { direction }) if (direction - Vec2::new(-1.0, 0.0)).norm() < 1e-12),
            "a counter-clockwise turn about a point far below moves things to the left"
        );
        assert_eq!(
            MotionRecord::of(&Twist::new(0.0, 3.0, 0.0)),
            Some(MotionRecord::Along { direction: Vec2::new(0.0, 1.0) })
        );
        assert_eq!(MotionRecord::of(&Twist::ZERO), None);
    }
}
