//! Numbers of the journal, rounded to fixed decimals before they are written, so that the text is short and independent
//! of the last bits of a sum.

use schemars::JsonSchema;
use serde::{Serialize, Serializer};

use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;
use upm_core::units::mm_from_m;

/// A number with `DECIMALS` decimals; not-a-number is written as null.
#[derive(Clone, Copy, Debug, JsonSchema)]
#[schemars(inline)]
pub(super) struct Fixed<const DECIMALS: i32>(#[schemars(with = "Option<f64>")] pub(super) f64);

impl<const DECIMALS: i32> Serialize for Fixed<DECIMALS> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let scale = 10_f64.powi(DECIMALS);
        let rounded = (self.0 * scale).round() / scale;
        serializer.serialize_f64(if rounded.is_finite() { rounded + 0.0 } else { self.0 })
    }
}

pub(super) type Mm = Fixed<4>;
pub(super) type PointMm = [Mm; 2];
pub(super) type Seconds = Fixed<6>;

pub(super) fn mm(length_m: f64) -> Mm {
    Fixed(mm_from_m(length_m))
}

pub(super) fn point_mm(p_m: Vec2) -> PointMm {
    [mm(p_m.x), mm(p_m.y)]
}

pub(super) fn points_mm(points_m: &[Vec2]) -> Vec<PointMm> {
    points_m.iter().copied().map(point_mm).collect()
}

pub(super) fn fixed_pair<const DECIMALS: i32>(p: Vec2) -> [Fixed<DECIMALS>; 2] {
    [Fixed(p.x), Fixed(p.y)]
}

pub(super) fn seconds(at: PlateTime) -> Seconds {
    Fixed(at.secs())
}
