//! What is kept of a run. Every recorder is a [`Sink`](upm_control::Sink): the control loop tells it facts and
//! gets nothing back, so a run is the same with and without it.
//!
//! [`Journal`] writes the run down line by line and holds no wall time, so equal seeds give equal bytes. [`Tally`]
//! counts, compares what was measured with the simulated truth and ends as a [`Report`]. [`MemorySink`] keeps
//! everything, for tests. [`Fanout`] makes one sink of several, [`Herald`] tells them what becomes of journal and recording. [`Scribe`] writes lines on a thread of its own.

mod fanout;
mod herald;
mod journal;
mod keeping;
mod lengths;
mod maps;
mod memory;
mod motion;
mod records;
mod report;
mod rerun_mode;
mod roomy_file;
mod scribe;
mod scribe_watch;
mod stop;
mod switch;
mod tally;
mod timings;
mod wave;

pub use fanout::Fanout;
pub use herald::{Herald, tell_recording};
pub use journal::Journal;
pub use keeping::Keeping;
pub use maps::{VoteMap, edge_map, outline_px, response_map, vote_map};
pub use memory::MemorySink;
pub use motion::Motion;
pub use records::{CycleRecord, EventRecord, LocalisedRecord, PulseRecord};
pub use report::{
    CycleError, FaultReport, GuardReport, PartReport, PlannerReport, PredictionError, RecordingReport, Report,
    SelectedBy, Verdict,
};
pub use rerun_mode::{BadRerunMode, RerunMode};
pub use roomy_file::RoomyFile;
pub use scribe::{Durable, Scribe, ScribeMode};
pub use scribe_watch::ScribeWatch;
pub use stop::StopReport;
pub use switch::{OnFull, RecordingState, RecordingSwitch};
pub use tally::{Deadlines, Ending, PartEnding, Tally};
pub use timings::{Durations, Quantiles, Timings, TimingsReport};
