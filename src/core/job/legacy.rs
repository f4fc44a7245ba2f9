//! Sentences in files of version 0.1.0 that later files replace by codes. Only readers of old files use them; no file
//! is written with them.

/// Beginning of the event, and of the warning in the report, about a recording that ended before its run.
pub const RECORDING_ENDS_EARLY: &str = "the recording ends early: ";

/// Reason in the report of a run that was stopped because the daemon ended.
pub const DAEMON_ENDED: &str = "the daemon ended";

/// Events of runs that were ended from outside.
const EXTERNAL_STOPS: [&str; 6] = [
    "stopped from outside, motors at zero",
    "gave way to another job",
    "the rig stopped: emergency stop",
    "the rig stopped: the drive lease ran out, nobody drove the motors for 0.1 s",
    "the rig stopped: the watchdog stopped it",
    "the rig stopped: the program ends",
];

/// True for the text of an event that reports a stop from outside the run.
pub fn is_external_stop(text: &str) -> bool {
    EXTERNAL_STOPS.contains(&text)
}
