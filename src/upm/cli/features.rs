//! Cargo features that a build can leave out.

use std::sync::LazyLock;

/// Each feature, and whether this build has it.
const FEATURES: [(&str, bool); 2] = [("rerun", upm_viewer::BUILT_IN), ("daemon", cfg!(feature = "daemon"))];

/// Version, with the features that this build lacks.
pub(super) static VERSION: LazyLock<String> = LazyLock::new(|| match missing() {
    missing if missing.is_empty() => env!("CARGO_PKG_VERSION").to_owned(),
    missing => format!("{} (built without {missing})", env!("CARGO_PKG_VERSION")),
});

/// Last line of the help: the features that this build lacks; empty if it has all.
pub(super) static HELP: LazyLock<String> = LazyLock::new(|| match missing() {
    missing if missing.is_empty() => missing,
    missing => format!("Built without {missing}. `cargo install --path .` builds everything."),
});

fn missing() -> String {
    let missing = FEATURES.iter().filter(|(_, built)| !built).map(|(name, _)| *name);
    missing.collect::<Vec<_>>().join(", ")
}
