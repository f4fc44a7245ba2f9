use std::collections::BTreeMap;
use std::path::Path as FilePath;

use schemars::JsonSchema;
use serde::Deserialize;

use super::read::{NAME_PATTERN, NAMES, is_name};
use upm_core::document::{Diagnostic, Path, counted, parse_and_build, text_of};
use upm_core::rig::PartKind;
use upm_core::units::mm;

/// Most kinds in a set.
const MOST_COINS: usize = 64;

/// Sets compiled into the program.
const SETS: [(&str, &str); 4] = [
    ("us", include_str!("../../../configs/coins/us.json")),
    ("eu", include_str!("../../../configs/coins/eu.json")),
    ("uk", include_str!("../../../configs/coins/uk.json")),
    ("jp", include_str!("../../../configs/coins/jp.json")),
];

/// A set of round parts that a picture may show.
#[derive(Deserialize, JsonSchema)]
#[schemars(title = "coins")]
pub(super) struct CoinsFile {
    /// Kinds by name, 1 to 64.
    #[schemars(extend("maxProperties" = MOST_COINS, "minProperties" = 1))]
    #[schemars(extend("propertyNames" = {"minLength": 1, "maxLength": 64, "pattern": NAME_PATTERN}))]
    coins: BTreeMap<String, CoinEntry>,
}

/// A kind of round part.
#[derive(Deserialize, JsonSchema)]
struct CoinEntry {
    /// Diameter, mm.
    #[serde(rename = "diameter_mm", with = "mm")]
    #[schemars(with = "f64", range(min = 1.0, max = 1000.0))]
    diameter_m: f64,
    /// Height, mm.
    #[serde(rename = "thickness_mm", default, with = "mm")]
    #[schemars(with = "f64", range(min = 0.0, max = 100.0))]
    thickness_m: f64,
}

/// The kinds of a set of coins, by diameter: one of `us`, `eu`, `uk` and `jp`, or a file of the same form.
///
/// # Errors
/// Every fault of the file.
pub fn coin_set(name_or_path: &str) -> Result<Vec<PartKind>, Vec<Diagnostic>> {
    match SETS.iter().find(|(name, _)| *name == name_or_path) {
        Some((name, text)) => coins_of(text, name),
        None if !name_or_path.contains(['.', '/', '\\']) => {
            let sets = SETS.map(|(name, _)| name).join(", ");
            let allowed = format!("one of {sets}, or the name of a file");
            Err(vec![Diagnostic::new("--coins", Path::root(), format!("{name_or_path:?}"), allowed)])
        }
        None => load_coins(FilePath::new(name_or_path)),
    }
}

/// The kinds of the set of coins in the file at `path`, by diameter.
///
/// # Errors
/// Every fault of the file.
pub fn load_coins(path: &FilePath) -> Result<Vec<PartKind>, Vec<Diagnostic>> {
    coins_of(&text_of(path)?, &path.display().to_string())
}

/// The kinds of the set in `text`, called `file` in faults.
pub(super) fn coins_of(text: &str, file: &str) -> Result<Vec<PartKind>, Vec<Diagnostic>> {
    parse_and_build(text, file, |CoinsFile { coins }, faults| {
        let allowed = format!("1 to {MOST_COINS}");
        faults.require((1..=MOST_COINS).contains(&coins.len()), "coins", counted(coins.len(), "kind"), allowed);
        for name in coins.keys() {
            let at = Path::root().key("coins").key(name);
            faults.require(is_name(name), &at, format!("{name:?}"), NAMES);
        }
        let kind = |(name, coin): (String, CoinEntry)| PartKind {
            name,
            radius_m: 0.5 * coin.diameter_m,
            thickness_m: coin.thickness_m,
        };
        let mut kinds: Vec<PartKind> = coins.into_iter().map(kind).collect();
        kinds.sort_by(|a, b| a.radius_m.total_cmp(&b.radius_m));
        Some(kinds)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_has_plain_names_and_is_neither_empty_nor_endless() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("coins.json");
        let lines = |text: &str| {
            std::fs::write(&path, format!("\u{feff}{text}")).unwrap();
            let faults = load_coins(&path).err().unwrap_or_default();
            faults.iter().map(|fault| format!("{}: {}", fault.path, fault.found)).collect::<Vec<_>>()
        };
        assert_eq!(lines(r#"{"coins": {"token": {"diameter_mm": 23.0}}}"#), [""; 0]);
        assert_eq!(lines(r#"{"coins": {}}"#), ["coins: 0 kinds"]);
        assert_eq!(lines(r#"{"coins": {"a b": {"diameter_mm": 23}}}"#), [r#"coins["a b"]: "a b""#]);
        assert_eq!(lines(r#"{"coins": {"a": {}}}"#), ["coins.a.diameter_mm: nothing"]);
        let many: Vec<String> = (0..65).map(|i| format!(r#""k{i}": {{"diameter_mm": 23}}"#)).collect();
        assert_eq!(lines(&format!(r#"{{"coins": {{{}}}}}"#, many.join(", "))), ["coins: 65 kinds"]);
    }
}
