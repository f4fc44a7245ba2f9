//! Streams a run to Rerun: into a file and, if asked, to a viewer as well.
//!
//! Facts are copied into owned messages and go through a bounded queue to a recorder thread, which encodes and logs
//! them. The file never loses anything: when the queue is full the control loop waits, or else the recording ends there
//! as a failed one. It has its name only once it is closed and is `NAME.part` before. A viewer gets a copy of
//! what goes into the file from a thread and a queue of its own; when it falls behind or is not there, messages to
//! it are dropped and counted, and nobody waits. A [`LiveServer`] is where viewers come by themselves.
//!
//! Timelines: `plate_time` and `cycle`. What a person sees, by entity path: `camera` (what each cycle started from),
//! `vision` (how table and parts were found), `table` (from above, mm), `plan`, `motors`, `accelerometers`,
//! `errors`, `timing`, `log`. Rerun's 2D views have y down; `table` is logged with y negated, so up is up.

mod blueprint;
mod camera;
mod cells;
mod charts;
mod destination;
mod draft;
mod experiment;
#[cfg(test)]
mod experiment_tests;
mod field;
mod file;
mod live;

mod live_server;
#[cfg(test)]
mod live_tests;
mod located;
mod looks;
mod paint;
mod picture;
mod plots;
mod recorder;
mod repair;
#[cfg(test)]
mod repair_tests;
mod signals;
mod sink;
#[cfg(test)]
mod survival_tests;
mod table;
mod tape;
#[cfg(test)]
mod tests;
mod trails;
mod viewer_proxy;
mod vision;
mod words;

pub use experiment::record_experiment;
pub use live_server::LiveServer;
pub use located::record_located;
pub use repair::repair_recording;
pub use sink::RerunSink;
