//! Serde forms of quantities: in a file a number in the unit of its key, in the program SI or whole bytes.

/// A module for `#[serde(with = ...)]`: how the number in a file becomes the quantity, and back.
macro_rules! unit {
    ($unit:ident, $quantity:ty, $quantity_of:expr, $number_of:expr) => {
        pub(super) mod $unit {
            use serde::{Deserialize, Deserializer, Serialize, Serializer};

            pub fn deserialize<'de, D: Deserializer<'de>>(number: D) -> Result<$quantity, D::Error> {
                f64::deserialize(number).map($quantity_of)
            }

            pub fn serialize<S: Serializer>(quantity: &$quantity, serializer: S) -> Result<S::Ok, S::Error> {
                let number: fn(&$quantity) -> f64 = $number_of;
                number(quantity).serialize(serializer)
            }
        }
    };
}

unit!(millimetres, f64, upm_core::units::m_from_mm, |length_m| upm_core::units::mm_from_m(*length_m));
unit!(gigabytes, u64, |gb| (gb * 1e9).round() as u64, |bytes| *bytes as f64 / 1e9);
unit!(megabytes, u64, |mb| (mb * 1e6).round() as u64, |bytes| *bytes as f64 / 1e6);
unit!(seconds, std::time::Duration, std::time::Duration::from_secs_f64, std::time::Duration::as_secs_f64);
