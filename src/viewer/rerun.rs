//! Streaming of a run to Rerun: into a file and, if asked, to a viewer as well.
//!
//! Facts are copied into owned messages and go through a bounded queue to a recorder thread, which encodes and logs
//! them. The file never has gaps: when the queue is full, either the control loop waits or the recording ends there as
//! failed. A file that a killed process left opens up to its last whole message. A viewer gets a copy of the file's
//! messages through a separate thread and queue; when it lags or is absent, messages to it are dropped and counted, and
//! the run never waits.
//!
//! Timelines: `plate_time` and `cycle`. Entity paths: `camera` (the frame that starts each cycle), `table` (from
//! above, mm), `plan`, `motors`, `accelerometers`, `errors`, `timing`, `log`. Rerun's 2D views have y down;
//! `table` has a transform that mirrors it, so that y is up in its data as in the journal's, and on the screen.

mod blueprint;
mod camera;
mod file;
mod live;
mod log_view;
mod observation;
mod paint;
mod plots;
mod recorder;
mod run_stream;
mod signals;
mod sink;
#[cfg(test)]
mod survival_tests;
mod table;
mod task;
#[cfg(test)]
mod task_tests;
#[cfg(test)]
mod tests;
mod trails;

pub use sink::RerunSink;
