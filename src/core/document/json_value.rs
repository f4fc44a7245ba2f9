//! JSON text as a value. A parsed value no longer shows duplicate keys of an object, so they are reported while it is
//! read.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};

use super::diagnostic::{Diagnostics, Path};

/// The JSON value in `text`, whose byte order mark is skipped; adds a fault for each key that its object already has. A
/// number without a fraction is an integer, as in JSON Schema: `2.0` is 2.
///
/// # Errors
/// The error of a text that is not JSON.
pub(super) fn value_of(text: &str, faults: &mut Diagnostics) -> serde_json::Result<Value> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut json = serde_json::Deserializer::from_str(text);
    let value = Walk { at: Path::root(), faults }.deserialize(&mut json)?;
    json.end().map(|()| value)
}

/// Indented JSON of `value`. It is made here because this crate is always compiled for speed.
pub fn pretty(value: &Value) -> String {
    serde_json::to_string_pretty(value).unwrap_or_default()
}

struct Walk<'a> {
    at: Path,
    faults: &'a mut Diagnostics,
}

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, value: D) -> Result<Value, D::Error> {
        value.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(key) = members.next_key::<String>()? {
            let at = self.at.key(&key);
            if object.contains_key(&key) {
                self.faults.push(&at, format!("the key {key:?} a second time"), "each key once");
            }
            let value = members.next_value_seed(Walk { at, faults: self.faults })?;
            // a document may name its schema, for editors; nothing else reads that
            if key != "$schema" || !value.is_string() {
                object.insert(key, value);
            }
        }
        Ok(Value::Object(object))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element_seed(Walk { at: self.at.index(list.len()), faults: self.faults })? {
            list.push(item);
        }
        Ok(Value::Array(list))
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        let whole = if value < 0.0 { Value::from(value as i64) } else { Value::from(value as u64) };
        // 2⁶⁴ is beyond
        Ok(if value < u64::MAX as f64 && whole.as_f64() == Some(value) { whole } else { value.into() })
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_duplicate_key_is_reported_with_its_path() {
        let mut faults = Diagnostics::of("f");
        let text = r#"{"a": 1, "b": [{"c": null, "d": 2.5, "c": true}], "a": "x", "e": {"a": -1}}"#;
        assert_eq!(value_of(text, &mut faults).unwrap(), serde_json::from_str::<Value>(text).unwrap());
        let lines: Vec<String> = faults.into_list().iter().map(ToString::to_string).collect();
        assert_eq!(
            lines,
            [
                "f: b[0].c: expected each key once, found the key \"c\" a second time",
                "f: a: expected each key once, found the key \"a\" a second time",
            ]
        );
    }

    #[test]
    fn whole_numbers_are_integers_however_they_are_written() {
        let read = |text: &str| value_of(text, &mut Diagnostics::of("f")).unwrap().to_string();
        assert_eq!(read("\u{feff}[2.0, 2e3, -4.00, 2.5, -0.0, 1e300]"), "[2,2000,-4,2.5,0,1e+300]");
        let large = "[18446744073709549568.0, 1e19, 18446744073709551616, -9223372036854775808.0, -1e19]";
        let whole = "[18446744073709549568,10000000000000000000,1.8446744073709552e+19,-9223372036854775808,-1e+19]";
        assert_eq!(read(large), whole);
    }

    #[test]
    fn the_name_of_a_schema_is_a_text() {
        let read = |text: &str| value_of(text, &mut Diagnostics::of("f")).unwrap().to_string();
        assert_eq!(read(r#"{"$schema": "s.json", "a": {"$schema": 1}}"#), r#"{"a":{"$schema":1}}"#);
    }
}
