//! The shipped configurations (jobs, rigs, libraries and examples), embedded in the binary.

/// Paths and texts. The files name each other by relative paths, which are kept.
pub(super) const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// True if `path` is that of a shipped file, relative to the folder that it was written into.
pub(super) fn is_shipped(path: &str) -> bool {
    let path = path.strip_prefix("./").unwrap_or(path);
    FILES.iter().any(|(name, _)| *name == path)
}
