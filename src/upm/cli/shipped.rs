//! The shipped configurations (jobs, rigs, libraries and examples), embedded in the binary.

/// Paths and texts. The files name each other by relative paths, which are kept.
pub(super) const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// Name of the shipped job that `text` is.
pub(super) fn job_of(text: &str) -> Option<&'static str> {
    let (path, _) = FILES.iter().find(|(_, shipped)| *shipped == text)?;
    path.strip_prefix("configs/")?.strip_suffix(".json")
}

/// True if `path` is that of a shipped file, relative to the folder that it was written into.
pub(super) fn is_shipped(path: &str) -> bool {
    let path = path.strip_prefix("./").unwrap_or(path);
    FILES.iter().any(|(name, _)| *name == path)
}
