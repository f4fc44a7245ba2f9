//! Records of a run. Every recorder is a [`Sink`](upm_control::Sink): the control loop reports facts to it and gets
//! nothing back, so a run is the same with and without it.
//!
//! [`Journal`] writes one line per fact without wall time, so equal seeds give equal bytes. [`RunStats`] counts,
//! compares measurements with the simulated truth and yields a [`Report`]. [`Fanout`] combines several sinks.
//! [`BackgroundWriter`] writes lines on a background thread.

mod background_writer;
mod fanout;
mod handle;
mod journal;
mod lengths;
mod motion;
mod options;
mod outline;
mod path_stats;
mod report;
mod rerun_mode;
mod run_stats;
mod timings;
mod wave;

pub use background_writer::{BackgroundWriter, SyncWrite};
pub use fanout::Fanout;
pub use handle::{RecordingHandle, RecordingState, report_recording_end};
pub use journal::{Journal, RECORDING_FAILED, journal_schema};
pub use lengths::rounded;
pub use motion::MotionRecord;
pub use options::{RecordingOptions, WriterStatus};
pub use outline::outline_px;
pub use report::{
    AccuracyReport, CycleError, FaultEntry, FaultValue, GuardReport, IncidentReport, PacingReport, PartReport,
    PathReport, PlannerReport, PredictionError, Report, SelectedBy, StopReport, Verdict, WorkReport, report_schema,
};
pub use rerun_mode::RerunMode;
pub use run_stats::RunStats;
pub use timings::{Durations, Quantiles, Timings, TimingsReport};
