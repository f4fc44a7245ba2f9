use std::collections::BTreeMap;
use std::path::Path as FilePath;

use schemars::JsonSchema;
use serde::Deserialize;

use super::read::{NAMES, is_name};
use upm_core::document::{Diagnostic, Path, parse_and_build, text_of};
use upm_core::rig::PartKind;
use upm_core::units::m_from_mm;

/// Sets compiled into the program.
const SETS: [(&str, &str); 4] = [
    ("us", include_str!("../../../configs/coins/us.json")),
    ("eu", include_str!("../../../configs/coins/eu.json")),
    ("uk", include_str!("../../../configs/coins/uk.json")),
    ("jp", include_str!("../../../configs/coins/jp.json")),
];

/// A set of round parts as a person writes it.
#[derive(Deserialize, JsonSchema)]
#[schemars(title = "coins")]
struct CoinsFile {
    #[schemars(length(min = 1, max = 64))]
    coins: BTreeMap<String, CoinEntry>,
}

#[derive(Deserialize, JsonSchema)]
struct CoinEntry {
    #[schemars(range(min = 1.0, max = 1000.0))]
    diameter_mm: f64,
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100.0))]
    thickness_mm: f64,
}

/// The kinds of a set of coins, by diameter: one of `us`, `eu`, `uk` and `jp`, or a file of the same form.
///
/// # Errors
/// Every fault of the file.
pub fn coin_set(name_or_path: &str) -> Result<Vec<PartKind>, Vec<Diagnostic>> {
    let text = match SETS.iter().find(|(name, _)| *name == name_or_path) {
        Some((_, text)) => (*text).to_owned(),
        None if !name_or_path.contains(['.', '/', '\\']) => {
            let sets = SETS.map(|(name, _)| name).join(", ");
            let allowed = format!("one of {sets}, or the name of a file");
            return Err(vec![Diagnostic::new("--coins", Path::root(), format!("{name_or_path:?}"), allowed)]);
        }
        None => text_of(FilePath::new(name_or_path))?,
    };
    parse_and_build(&text, name_or_path, |CoinsFile { coins }, faults| {
        for name in coins.keys() {
            let at = Path::root().key("coins").key(name);
            faults.require(is_name(name), &at, format!("{name:?}"), NAMES);
        }
        let kind = |(name, coin): (String, CoinEntry)| {
            let (radius_m, thickness_m) = (m_from_mm(0.5 * coin.diameter_mm), m_from_mm(coin.thickness_mm));
            PartKind { name, radius_m, thickness_m }
        };
        let mut kinds: Vec<PartKind> = coins.into_iter().map(kind).collect();
        kinds.sort_by(|a, b| a.radius_m.total_cmp(&b.radius_m));
        Some(kinds)
    })
}
