//! Cargo features that a build can leave out.

use std::sync::LazyLock;

#[cfg(not(feature = "daemon"))]
use super::output::Failure;

/// The daemon and its client commands.
pub(super) const DAEMON: &str = "daemon";
/// Recordings for the Rerun viewer.
const RERUN: &str = "rerun";

/// Each feature, and whether this build has it.
const FEATURES: [(&str, bool); 2] = [(RERUN, upm_viewer::BUILT_IN), (DAEMON, cfg!(feature = "daemon"))];

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

#[cfg(not(feature = "daemon"))]
/// Failure of `command`, which needs a feature that this build lacks.
pub(super) fn lacking(feature: &str, command: &str) -> Failure {
    Failure::bad_input(format!(
        "{command} needs the feature `{feature}`, and this build was made without it; \
         `cargo install --path . --features {feature}` adds it"
    ))
}

fn missing() -> String {
    let missing = FEATURES.iter().filter(|(_, built)| !built).map(|(name, _)| *name);
    missing.collect::<Vec<_>>().join(", ")
}
