use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Duration;

use tracing_subscriber::fmt::MakeWriter;

use upm_core::background::{BackgroundThread, OverflowPolicy, Queue, QueueError, Receiver};

/// Capacity of the queue, lines.
const WAITING: usize = 1024;

/// Longest time that the end of the process waits for the queue.
const FLUSH_TIMEOUT: Duration = Duration::from_millis(100);

/// Log writer that never blocks: a thread writes the lines. When the queue is full, lines are dropped, and their number
/// is written before the next line.
#[derive(Debug)]
pub(super) struct LogWriter {
    entries: Queue<LogEntry>,
    /// Number of dropped lines that no entry reports.
    lost: Arc<AtomicU64>,
}

#[derive(Debug)]
enum LogEntry {
    /// A line, and the number of lines dropped just before it.
    Line { text: Vec<u8>, lost: u64 },
    /// Request for a reply once all earlier entries are written.
    Written(SyncSender<()>),
}

impl LogWriter {
    /// Starts the thread that writes to `out`; it calls `tell_lost` with the number of dropped lines.
    pub(super) fn start(
        out: impl Write + Send + 'static,
        tell_lost: impl Fn(u64) + Send + 'static,
    ) -> io::Result<(Self, FlushGuard)> {
        let (entries, waiting) = Queue::bounded(WAITING, OverflowPolicy::GiveUp);
        BackgroundThread::start("log", true, move || write_down(&waiting, out, tell_lost))?;
        Ok((Self { entries: entries.clone(), lost: Arc::default() }, FlushGuard(entries)))
    }

    fn offer(&self, text: Vec<u8>) {
        let lost = self.lost.swap(0, Ordering::SeqCst);
        let sent = self.entries.send(LogEntry::Line { text, lost });
        if let Err(QueueError::Full(_) | QueueError::Closed(_)) = sent {
            self.lost.fetch_add(lost + 1, Ordering::SeqCst);
        }
    }
}

fn write_down(entries: &Receiver<LogEntry>, mut out: impl Write, tell_lost: impl Fn(u64)) {
    for entry in entries {
        match entry {
            LogEntry::Line { text, lost } => {
                if lost > 0 {
                    tell_lost(lost);
                }
                // an error of the log cannot be reported anywhere else
                out.write_all(&text).ok();
            }
            LogEntry::Written(reply) => drop(reply.try_send(())),
        }
    }
}

impl<'a> MakeWriter<'a> for LogWriter {
    type Writer = LogLine<'a>;

    fn make_writer(&'a self) -> LogLine<'a> {
        LogLine { log: self, text: Vec::new() }
    }
}

/// A line under construction; sent when dropped.
#[derive(Debug)]
pub(super) struct LogLine<'a> {
    log: &'a LogWriter,
    text: Vec<u8>,
}

impl Write for LogLine<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.text.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for LogLine<'_> {
    fn drop(&mut self) {
        self.log.offer(std::mem::take(&mut self.text));
    }
}

/// On drop, flushes the queue for at most 100 ms.
#[derive(Debug)]
pub(super) struct FlushGuard(Queue<LogEntry>);

impl FlushGuard {
    fn wait_within(&self, longest: Duration) {
        let (reply, written) = sync_channel(1);
        if self.0.send_within(LogEntry::Written(reply), longest).is_ok() {
            written.recv_timeout(longest).ok();
        }
    }
}

impl Drop for FlushGuard {
    fn drop(&mut self) {
        self.wait_within(FLUSH_TIMEOUT);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::super::test_buffer::TestBuffer;
    use super::*;

    /// Writer that signals the first write and then blocks until released.
    struct Stuck {
        page: TestBuffer,
        asked: SyncSender<()>,
        go: mpsc::Receiver<()>,
    }

    impl Write for Stuck {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.asked.try_send(()).ok();
            // returns an error once the other end is dropped
            self.go.recv().ok();
            self.page.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    struct Log {
        log: LogWriter,
        flush_guard: FlushGuard,
        page: TestBuffer,
        asked: mpsc::Receiver<()>,
        let_go: SyncSender<()>,
    }

    fn stuck() -> Log {
        let ((asking, asked), (let_go, go)) = (sync_channel(1), sync_channel(0));
        let page = TestBuffer::default();
        let (out, written) = (Stuck { page: page.clone(), asked: asking, go }, page.clone());
        let (log, flush_guard) =
            LogWriter::start(out, move |lost| writeln!(written.clone(), "{lost} lost").unwrap()).unwrap();
        Log { log, flush_guard, page, asked, let_go }
    }

    #[test]
    fn full_log_queue_drops_and_counts_lines() {
        let Log { log, flush_guard, page, asked, let_go } = stuck();
        let outln = |text: String| writeln!(log.make_writer(), "{text}").unwrap();
        outln("first".to_owned());
        asked.recv().unwrap();
        // the writer is blocked until the queue has overflowed
        (0..WAITING).for_each(|i| outln(i.to_string()));
        (0..7).for_each(|_| outln("no room".to_owned()));
        drop(let_go);
        let until_written = || flush_guard.wait_within(Duration::from_secs(60));
        until_written();
        outln("after".to_owned());
        until_written();
        let lines = page.lines();
        assert_eq!(lines.len(), 1 + WAITING + 2, "{lines:?}");
        assert_eq!((lines[0].as_str(), lines[WAITING].as_str()), ("first", (WAITING - 1).to_string().as_str()));
        assert_eq!(lines[WAITING + 1..], ["7 lost", "after"]);
    }

    #[test]
    fn flush_on_drop_waits_for_a_working_writer_but_not_for_a_stuck_one() {
        let Log { log, flush_guard, page, let_go, .. } = stuck();
        drop(let_go);
        for i in 0..100 {
            let mut line = log.make_writer();
            write!(line, "{i}").unwrap();
            writeln!(line, ".").unwrap();
        }
        drop(flush_guard);
        let whole: Vec<String> = (0..100).map(|i| format!("{i}.")).collect();
        assert_eq!(page.lines(), whole);

        let Log { log, flush_guard, page, let_go, .. } = stuck();
        writeln!(log.make_writer(), "stuck").unwrap();
        drop(flush_guard);
        assert_eq!(page.lines(), [""; 0], "the end came though nobody read");
        drop(let_go);
    }
}
