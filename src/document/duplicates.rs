//! Detection of duplicate keys in an object, which a parsed value no longer shows.

use std::collections::HashSet;
use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};

use super::diagnostic::{Diagnostics, Path};

/// Adds a fault for each key of the JSON in `text` that its object already has.
pub(super) fn check(text: &str, faults: &mut Diagnostics) {
    let walk = Walk { at: Path::root(), faults };
    // invalid JSON has been reported before
    let _ = walk.deserialize(&mut serde_json::Deserializer::from_str(text));
}

struct Walk<'a> {
    at: Path,
    faults: &'a mut Diagnostics,
}

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, value: D) -> Result<(), D::Error> {
        value.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<(), A::Error> {
        let mut seen = HashSet::new();
        while let Some(key) = members.next_key::<String>()? {
            let at = self.at.key(&key);
            if seen.contains(&key) {
                self.faults.push(&at, format!("the key {key:?} a second time"), "each key once");
            }
            members.next_value_seed(Walk { at, faults: self.faults })?;
            seen.insert(key);
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<(), A::Error> {
        let mut i = 0;
        while items.next_element_seed(Walk { at: self.at.index(i), faults: self.faults })?.is_some() {
            i += 1;
        }
        Ok(())
    }

    fn visit_bool<E: Error>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_i64<E: Error>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_u64<E: Error>(self, _: u64) -> Result<(), E> {
        Ok(())
    }

    fn visit_f64<E: Error>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E: Error>(self, _: &str) -> Result<(), E> {
        Ok(())
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_duplicate_key_is_reported_with_its_path() {
        let mut faults = Diagnostics::of("f");
        check(r#"{"a": 1, "b": [{"c": null, "d": 2.5, "c": true}], "a": "x", "e": {"a": -1}}"#, &mut faults);
        let lines: Vec<String> = faults.into_list().iter().map(ToString::to_string).collect();
        assert_eq!(
            lines,
            [
                "f: b[0].c: expected each key once, found the key \"c\" a second time",
                "f: a: expected each key once, found the key \"a\" a second time",
            ]
        );
    }
}
