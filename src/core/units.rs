//! Unit conversions at the user interface. Inside the program every quantity is SI and its name has the unit.

use std::f64::consts::TAU;

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

/// A number without the last digits, in which a conversion of units and the conversion back differ.
pub fn without_rounding_error(number: f64) -> f64 {
    (number * 1e9).round() / 1e9
}

/// A module for `#[serde(with = ...)]`: how a value in a file becomes the quantity, and back.
#[macro_export]
macro_rules! file_form {
    ($(#[$doc:meta])* $name:ident: $value:ty => $quantity:ty, $quantity_of:expr, $value_of:expr) => {
        $(#[$doc])*
        pub mod $name {
            #[allow(unused_imports)]
            use super::*;
            use serde::{Deserialize, Deserializer, Serialize, Serializer};

            /// Reads the value in the file.
            pub fn deserialize<'de, D: Deserializer<'de>>(value: D) -> Result<$quantity, D::Error> {
                let quantity_of: fn($value) -> $quantity = $quantity_of;
                <$value>::deserialize(value).map(quantity_of)
            }

            /// Writes the value for the file.
            pub fn serialize<S: Serializer>(quantity: &$quantity, serializer: S) -> Result<S::Ok, S::Error> {
                let value_of: fn(&$quantity) -> $value = $value_of;
                value_of(quantity).serialize(serializer)
            }
        }
    };
}

pub use file_form;

file_form!(
    /// Metres, in a file millimetres.
    mm: f64 => f64, m_from_mm, |m| without_rounding_error(mm_from_m(*m))
);
file_form!(
    /// A point, m, in a file mm.
    mm_point: [f64; 2] => Vec2, |mm| mm.map(m_from_mm).into(),
    |m| [m.x, m.y].map(|m| without_rounding_error(mm_from_m(m)))
);
file_form!(
    /// Points, m, in a file mm, to the micrometre.
    mm_points: Vec<[f64; 2]> => Vec<Vec2>, |places| places.into_iter().map(|mm| mm.map(m_from_mm).into()).collect(),
    |places_m| places_mm(places_m)
);
file_form!(
    /// Radians a second, in a file hertz.
    hertz: f64 => f64, |hz| TAU * hz, |radps| without_rounding_error(radps / TAU)
);
file_form!(
    /// Radians, in a file degrees.
    degrees: f64 => f64, f64::to_radians, |rad| without_rounding_error(rad.to_degrees())
);

/// Positions in millimetres from positions in metres, rounded to the micrometre, which is finer than any measurement.
#[inline]
pub fn places_mm(places_m: &[Vec2]) -> Vec<[f64; 2]> {
    let rounded = |m: f64| (mm_from_m(m) * 1e3).round() / 1e3;
    places_m.iter().map(|p| [rounded(p.x), rounded(p.y)]).collect()
}
