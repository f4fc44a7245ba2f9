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

/// A whole number as the default of one in a file: `#[serde(default = "whole::<f64, 5>")]`.
pub fn whole<T: From<u16>, const NUMBER: u16>() -> T {
    NUMBER.into()
}

/// The same in thousandths: `#[serde(default = "thousandths::<20>")]` is 0.02.
pub fn thousandths<const NUMBER: u32>() -> f64 {
    f64::from(NUMBER) / 1e3
}

/// A length, m, as the default of one in a file: `#[serde(default = "micrometres::<500>")]` is half a millimetre.
pub fn micrometres<const NUMBER: u32>() -> f64 {
    m_from_mm(thousandths::<NUMBER>())
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

/// The number for a file from which `quantity_of` gives exactly `quantity`: `value` without its rounding error where
/// that will do, else with it, or the next number.
fn written(quantity: f64, value: f64, quantity_of: fn(f64) -> f64) -> f64 {
    let numbers = [(value * 1e9).round() / 1e9, value, value.next_up(), value.next_down()];
    numbers.into_iter().find(|number| quantity_of(*number) == quantity).unwrap_or(value)
}

/// Millimetres in a file for a length, m, that a file gave.
pub fn written_mm(m: f64) -> f64 {
    written(m, mm_from_m(m), m_from_mm)
}

/// Degrees in a file for an angle, rad, that a file gave.
pub fn written_degrees(rad: f64) -> f64 {
    written(rad, rad.to_degrees(), f64::to_radians)
}

/// Hertz in a file for an angular frequency, rad/s, that a file gave.
pub fn written_hertz(radps: f64) -> f64 {
    written(radps, radps / TAU, |hz| TAU * hz)
}

file_form!(
    /// Metres, in a file millimetres.
    mm: f64 => f64, m_from_mm, |m| written_mm(*m)
);
file_form!(
    /// Kilograms, in a file grams.
    grams: f64 => f64, |g| g * 1e-3, |kg| written(*kg, kg * 1e3, |g| g * 1e-3)
);
file_form!(
    /// A point, m, in a file mm.
    mm_point: [f64; 2] => Vec2, |mm| mm.map(m_from_mm).into(), |m| [m.x, m.y].map(written_mm)
);
file_form!(
    /// Points, m, in a file mm, to the micrometre.
    mm_points: Vec<[f64; 2]> => Vec<Vec2>, |places| places.into_iter().map(|mm| mm.map(m_from_mm).into()).collect(),
    |places_m| places_mm(places_m)
);
file_form!(
    /// Radians a second, in a file hertz.
    hertz: f64 => f64, |hz| TAU * hz, |radps| written_hertz(*radps)
);
file_form!(
    /// Radians, in a file degrees.
    degrees: f64 => f64, f64::to_radians, |rad| written_degrees(*rad)
);

/// Positions in millimetres from positions in metres, rounded to the micrometre, which is finer than any measurement.
#[inline]
pub fn places_mm(places_m: &[Vec2]) -> Vec<[f64; 2]> {
    let rounded = |m: f64| (mm_from_m(m) * 1e3).round() / 1e3;
    places_m.iter().map(|p| [rounded(p.x), rounded(p.y)]).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// A rig that is written and read again is the same to the last bit: runs are repeated from what was written.
        #[test]
        fn written_numbers_read_back_exactly(number in -1000.0..1000.0f64, digits in 0..12) {
            let decimal = format!("{number:.*}", digits as usize).parse::<f64>().unwrap();
            for value in [number, decimal] {
                prop_assert_eq!(m_from_mm(written_mm(m_from_mm(value))), m_from_mm(value));
                prop_assert_eq!(written_degrees(value.to_radians()).to_radians(), value.to_radians());
                prop_assert_eq!(TAU * written_hertz(TAU * value), TAU * value);
            }
            if digits < 8 {
                prop_assert_eq!(written_mm(m_from_mm(decimal)), decimal);
            }
        }
    }
}
