//! Plates that are stepped for learning, without pixels: one pulse a step, seen at rest after it.
//!
//! ```
//! # use std::path::Path;
//! use std::sync::Arc;
//! use upm_runner::config::Origin;
//! use upm_runner::episode::{Episode, EpisodeParams};
//!
//! # fn main() -> Result<(), upm_runner::run::RunError> {
//! let text = r#"{"parts": [{"kind": "penny", "count": 2}], "task": {"type": "arrange"}, "action": "steps"}"#;
//! # let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/episode.json"));
//! # let origin = Origin::of_file(folder);
//! let params = Arc::new(EpisodeParams::from_json(text, &origin)?);
//! let mut episode = Episode::new(&params, 7)?;
//! let action = episode.expert();
//! let outcome = episode.step(&action)?;
//! assert!(outcome.reward > 0.0 && !outcome.truncated, "{outcome:?}");
//! # Ok(())
//! # }
//! ```

mod actions;
mod params;
mod plate;
mod single;
#[cfg(test)]
mod tests;
mod types;
mod vector;

pub use params::EpisodeParams;
pub use single::Episode;
pub use types::{ActionKind, EpisodeTask, StepOutcome};
pub use vector::Episodes;
