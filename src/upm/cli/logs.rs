use std::io::{IsTerminal, Write};
use std::time::Duration;
use std::{env, io};

use tracing::Subscriber;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::layer::SubscriberExt;

use super::args::{Common, LogFormat};
use super::timeline::Timeline;
use super::{panics, signals};
use upm_core::background::{BackgroundThread, OverflowPolicy, Queue};

/// Lines of a daemon's log that may wait for its reader.
const LINES: usize = 1024;
/// Time for which the end of the program waits for room in that queue, and for its reader.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(1);

/// Starts the log on stderr. `daemon` is the format of a daemon's log, which has times and one level more than those of
/// other commands, since these run while a person watches. The log of a daemon never waits for its reader; dropping the
/// returned value at the end of the process flushes its queue. Spans go to `timeline`.
pub(super) fn start(common: Common, daemon: Option<LogFormat>, timeline: Option<Timeline>) -> Option<FlushGuard> {
    let level = level(common, daemon.is_some());
    let is_colored = io::stderr().is_terminal() && env::var_os("NO_COLOR").is_none_or(|no| no.is_empty());
    let (subscriber, flush_guard) = match daemon {
        Some(_) => {
            let (lines, flush_guard) = non_blocking(io::stderr());
            (subscriber(daemon, level, is_colored, timeline, move || lines.clone()), Some(flush_guard))
        }
        None => (subscriber(daemon, level, is_colored, timeline, io::stderr), None),
    };
    if tracing::subscriber::set_global_default(subscriber).is_err() {
        errln!("upm: the log was started before");
    }
    if daemon.is_some() {
        panics::install_panic_hook();
    }
    flush_guard
}

/// On drop, logs how many lines were dropped, and flushes the queue of the log, for about a second at most.
pub(super) struct FlushGuard {
    lines: LineQueue,
    writer: Option<BackgroundThread<()>>,
}

impl Drop for FlushGuard {
    fn drop(&mut self) {
        let lost = self.lines.0.lost();
        if lost > 0 {
            tracing::warn!("{lost} lines of the log were lost");
        }
        // a reader that is only slow makes room for the end
        let patient = self.lines.0.with_policy(OverflowPolicy::WaitAtMost(FLUSH_TIMEOUT));
        if let Some(writer) = self.writer.take().filter(|_| patient.send(None).is_ok()) {
            writer.wait_within(FLUSH_TIMEOUT).ok();
        }
    }
}

/// Log writer that never blocks: lines that find its queue full are lost and counted. `None` ends the log.
#[derive(Clone, Debug)]
struct LineQueue(Queue<Option<Vec<u8>>>);

impl Write for LineQueue {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        self.0.send(Some(line.to_owned())).ok();
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A queue of lines that a thread writes to `out`.
fn non_blocking(mut out: impl io::Write + Send + 'static) -> (LineQueue, FlushGuard) {
    let (queue, waiting) = Queue::bounded(LINES, OverflowPolicy::GiveUp);
    let write = move || {
        signals::ending().thread_block().ok();
        waiting.iter().map_while(|line| line).for_each(|line: Vec<u8>| drop(out.write_all(&line)));
    };
    let writer = BackgroundThread::start("log", false, write).ok();
    let lines = LineQueue(queue);
    (lines.clone(), FlushGuard { lines, writer })
}

fn level(common: Common, is_daemon: bool) -> LevelFilter {
    match (common.quiet, common.verbose + u8::from(is_daemon)) {
        (true, _) => LevelFilter::ERROR,
        (false, 0) => LevelFilter::WARN,
        (false, 1) => LevelFilter::INFO,
        (false, 2) => LevelFilter::DEBUG,
        (false, _) => LevelFilter::TRACE,
    }
}

fn subscriber(
    daemon: Option<LogFormat>,
    level: LevelFilter,
    is_colored: bool,
    timeline: Option<Timeline>,
    writer: impl for<'a> MakeWriter<'a> + Send + Sync + 'static,
) -> Box<dyn Subscriber + Send + Sync> {
    let log = tracing_subscriber::fmt::layer().with_writer(writer).with_ansi(is_colored);
    // of a write that fails it would write to stderr, and panic where that fails, too
    let log = log.log_internal_errors(false);
    let wanted = wanted(level);
    let log = match daemon {
        None => log.without_time().with_filter(wanted).boxed(),
        Some(LogFormat::Json) => {
            let log = log.json().flatten_event(true).with_current_span(false).with_span_list(false);
            log.with_filter(wanted).boxed()
        }
        Some(LogFormat::Text) => log.with_filter(wanted).boxed(),
    };
    Box::new(tracing_subscriber::registry().with(timeline).with(log))
}

/// Filter: this program's messages up to `level`; of libraries warnings only, and all messages at the highest level.
fn wanted(level: LevelFilter) -> Targets {
    let of_others = if level == LevelFilter::TRACE { level } else { level.min(LevelFilter::WARN) };
    Targets::new().with_default(of_others).with_target("upm", level)
}

#[cfg(test)]
mod tests {
    use super::super::test_buffer::TestBuffer;
    use super::*;

    /// Log text with messages at two levels.
    fn logged(daemon: Option<LogFormat>, level: LevelFilter) -> String {
        let page = TestBuffer::default();
        let writer = page.clone();
        let subscriber = subscriber(daemon, level, false, None, move || writer.clone());
        tracing::subscriber::with_default(subscriber, || {
            tracing::warn!(plate = "left", "deadline missed by {} frames", 2);
            tracing::debug!("not \"told\"");
            tracing::info!(target: "re_grpc_server", "listening where nobody shall go");
            tracing::debug!(target: "ureq::pool", "internals");
            tracing::warn!(target: "ureq::pool", "a warning of another library");
        });
        page.text()
    }

    #[test]
    fn internals_of_libraries_are_logged_at_trace_level_only() {
        let text = |level| logged(None, level);
        assert!(text(LevelFilter::DEBUG).contains("not \"told\""));
        assert!(!text(LevelFilter::DEBUG).contains("internals") && !text(LevelFilter::DEBUG).contains("listening"));
        assert!(text(LevelFilter::TRACE).contains("internals") && text(LevelFilter::TRACE).contains("listening"));
        assert_eq!(text(LevelFilter::ERROR), "");
    }

    #[test]
    fn a_daemons_text_has_times() {
        let text = logged(Some(LogFormat::Text), LevelFilter::INFO);
        let (time, rest) = text.split_once(' ').unwrap();
        assert!(time.parse::<jiff::Timestamp>().is_ok(), "{text}");
        let first = rest.lines().next().unwrap();
        assert_eq!(first.trim_start(), "WARN upm::cli::logs::tests: deadline missed by 2 frames plate=\"left\"");
    }

    #[test]
    fn end_flushes_the_queue_of_the_log() {
        let page = TestBuffer::default();
        let (lines, flush_guard) = non_blocking(page.clone());
        let writer = move || lines.clone();
        tracing::subscriber::with_default(
            subscriber(Some(LogFormat::Text), LevelFilter::INFO, false, None, writer),
            || {
                (0..100).for_each(|i| tracing::info!("{i}."));
                drop(flush_guard);
            },
        );
        assert_eq!(page.lines().len(), 100);
    }

    #[test]
    fn each_line_is_a_json_object() {
        let text = logged(Some(LogFormat::Json), LevelFilter::DEBUG);
        let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[0]["timestamp"].as_str().unwrap().parse::<jiff::Timestamp>().is_ok());
        let fields = ["level", "message", "plate", "target"].map(|key| lines[0][key].as_str().unwrap());
        assert_eq!(fields, ["WARN", "deadline missed by 2 frames", "left", "upm::cli::logs::tests"]);
        assert_eq!(lines[1]["message"], "not \"told\"");
    }

    #[test]
    fn daemon_logs_one_level_more() {
        let common = |verbose, quiet| Common { json: false, verbose, quiet };
        assert_eq!(
            [level(common(0, false), false), level(common(0, false), true)],
            [LevelFilter::WARN, LevelFilter::INFO]
        );
        assert_eq!([level(common(0, true), false), level(common(0, true), true)], [LevelFilter::ERROR; 2]);
        assert_eq!(level(common(2, false), false), LevelFilter::DEBUG);
        assert_eq!(level(common(9, false), true), LevelFilter::TRACE);
    }
}
