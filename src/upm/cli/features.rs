//! Cargo features that a build can leave out.

use std::sync::LazyLock;

/// Each feature, and whether this build has it.
const FEATURES: [(&str, bool); 2] = [("rerun", upm_viewer::BUILT_IN), ("daemon", cfg!(feature = "daemon"))];

/// Version, with the features that this build lacks.
pub(super) static VERSION: LazyLock<String> =
    LazyLock::new(|| env!("CARGO_PKG_VERSION").to_owned() + &lacking(|missing| format!(" (built without {missing})")));

/// Last line of the help: the features that this build lacks; empty if it has all.
pub(super) static HELP: LazyLock<String> = LazyLock::new(|| {
    lacking(|missing| format!("Built without {missing}. `cargo install --path .` builds everything."))
});

/// The text about the features that this build lacks; empty if it has all.
fn lacking(text: impl Fn(String) -> String) -> String {
    let missing: Vec<&str> = FEATURES.iter().filter(|(_, built)| !built).map(|(name, _)| *name).collect();
    if missing.is_empty() { String::new() } else { text(missing.join(", ")) }
}
