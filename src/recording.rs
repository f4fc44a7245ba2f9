//! What is kept of a run. Every recorder is a [`Sink`](crate::control::Sink): the control loop tells it facts and
//! gets nothing back, so a run is the same with and without it.
//!
//! [`Journal`] writes the run down line by line and holds no wall time, so equal seeds give equal bytes. [`Tally`]
//! counts, compares what was measured with the simulated truth and ends as a [`Report`]. [`MemorySink`] keeps
//! everything, for tests. With the feature `rerun`, `RerunSink` streams the run to the Rerun viewer.
//! [`Fanout`] makes one sink of several.

mod fanout;
mod journal;
mod maps;
mod memory;
mod motion;
mod records;
mod report;
#[cfg(feature = "rerun")]
mod rerun;
mod rerun_mode;
mod tally;
#[cfg(test)]
mod testing;
mod timings;
mod wave;

pub use fanout::Fanout;
pub use journal::Journal;
pub use maps::{VoteMap, edge_map, outline_px, response_map, vote_map};
pub use memory::MemorySink;
pub use motion::Motion;
pub use records::{CycleRecord, EventRecord, LocalisedRecord, PulseRecord};
pub use report::{Outcome, PartReport, PredictionError, Report};
#[cfg(feature = "rerun")]
pub use rerun::{PartLook, RecordingError, RecordingStats, RerunSink, RunContext, record_lab, record_located};
pub use rerun_mode::{BadRerunMode, RerunMode};
pub use tally::{Deadlines, Ending, PartEnding, Tally};
pub use timings::{Durations, Quantiles, Timings, TimingsReport};
