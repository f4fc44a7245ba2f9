//! The shipped configurations: jobs, rigs, libraries and examples, in the binary.

/// Their paths and texts. They name each other by relative paths, so each keeps its place.
pub(super) const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// True for the path of a shipped file as seen from the folder that it was written into.
pub(super) fn is_shipped(path: &str) -> bool {
    let path = path.strip_prefix("./").unwrap_or(path);
    FILES.iter().any(|(name, _)| *name == path)
}
