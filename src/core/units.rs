//! Unit conversions at the user interface. Inside the program every quantity is SI and its name has the unit.

use crate::geometry::Vec2;

/// Standard gravity, m/s² (CGPM 1901).
pub const GRAVITY_MPS2: f64 = 9.806_65;

/// Metres in one inch, exactly.
pub const INCH_M: f64 = 0.0254;

/// Metres from millimetres.
#[inline]
pub fn m_from_mm(mm: f64) -> f64 {
    mm / 1e3
}

/// Millimetres from metres.
#[inline]
pub fn mm_from_m(m: f64) -> f64 {
    m * 1e3
}

/// Positions in millimetres from positions in metres, rounded to the micrometre, which is finer than any measurement.
#[inline]
pub fn places_mm(places_m: &[Vec2]) -> Vec<[f64; 2]> {
    let rounded = |m: f64| (mm_from_m(m) * 1e3).round() / 1e3;
    places_m.iter().map(|p| [rounded(p.x), rounded(p.y)]).collect()
}
