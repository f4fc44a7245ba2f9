//! Program and machine of a run: on others its last digits may be others.

use std::fs;
use std::path::Path;

use serde_json::Value;

/// Processor and C library that this program is built for.
const TARGET: [&str; 2] = [
    if cfg!(target_arch = "x86_64") { "x86_64" } else { "another processor" },
    if cfg!(target_env = "gnu") { "glibc" } else { "another C library" },
];

/// This program and its machine.
pub fn maker() -> String {
    format!("upm {} on {}", env!("CARGO_PKG_VERSION"), machine())
}

/// The program and machine that made the run in folder `run`; `None` where it does not say so.
pub fn maker_of(run: &Path) -> Option<String> {
    let effective: Value = serde_json::from_str(&fs::read_to_string(run.join("effective.json")).ok()?).ok()?;
    Some(format!("upm {} on {}", effective["version"].as_str()?, effective["machine"].as_str()?))
}

/// The processor, with the extensions by which the C library and this program choose functions, and the C library.
pub(super) fn machine() -> String {
    #[cfg(target_arch = "x86_64")]
    let has_fma = std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    let has_fma = false;
    let [processor, library] = TARGET;
    format!("{processor}{}, {library}", if has_fma { " with avx2 and fma" } else { "" })
}
