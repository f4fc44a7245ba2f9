use std::ops::Neg;

use crate::coded_enum;

/// Number of voice coils.
pub const MOTORS: usize = 4;

/// The voice coils, in the order of every array of motors, with the signs of Fig. 4(a) of the UPM paper; see
/// [`MotorArrangement`] for those of Fig. 4(b).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motor {
    /// Pushes along +x; its line passes on the +y side of the centre, so that a push turns the plate clockwise.
    X1,
    /// Pushes along -x from the other side; a push turns the plate clockwise.
    X2,
    /// Pushes along +y; a push turns the plate counter-clockwise.
    Y1,
    /// Pushes along -y from the other side; a push turns the plate counter-clockwise.
    Y2,
}

impl Motor {
    /// All four coils, in order.
    pub const ALL: [Self; MOTORS] = [Self::X1, Self::X2, Self::Y1, Self::Y2];
}

coded_enum! {
    /// Where the coils stand around the plate (UPM paper, Fig. 4).
    #[derive(Default, schemars::JsonSchema)]
    pub enum MotorArrangement {
        /// One coil on each side of the plate (Fig. 4a): `f_x = X1 - X2`, `f_y = Y1 - Y2` and
        /// `S = (Y1 + Y2) - (X1 + X2)`, the torque over the lever arm (Eq. 7).
        #[default]
        Around = "around",
        /// Both coils of an axis on one side, which takes less room (Fig. 4b). X2 and Y2 push the other way along the
        /// same lines: `f_x = X1 + X2`, `f_y = Y1 + Y2` and `S = (Y1 - Y2) - (X1 - X2)`.
        Beside = "beside",
    }
}

impl MotorArrangement {
    /// True for the default, which files leave out: those written before there was another stay as they are.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Values of the motors of this arrangement that act as `of_around` does on [`Self::Around`], where every equation
    /// of the paper holds; and the other way round, as both differ in the signs of X2 and Y2 alone.
    #[inline]
    pub fn turned<T: Neg<Output = T>>(self, of_around: [T; MOTORS]) -> [T; MOTORS] {
        let [x1, x2, y1, y2] = of_around;
        match self {
            Self::Around => [x1, x2, y1, y2],
            Self::Beside => [x1, -x2, y1, -y2],
        }
    }
}
