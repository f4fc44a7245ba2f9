use std::io::{self, Write};
use std::time::Duration;

use tracing_subscriber::fmt::MakeWriter;

use upm_core::background::{BackgroundThread, OverflowPolicy, Queue};

/// Capacity of the queue, lines.
const WAITING: usize = 1024;

/// Longest time that the end of the process waits for the queue.
const FLUSH_TIMEOUT: Duration = Duration::from_millis(100);

/// Log writer that never blocks: a thread writes the lines. When the queue is full, lines are dropped and counted.
#[derive(Debug)]
pub(super) struct LogWriter(Queue<Option<Vec<u8>>>);

impl LogWriter {
    /// Starts the thread that writes to `out`.
    pub(super) fn start(mut out: impl Write + Send + 'static) -> io::Result<(Self, FlushGuard)> {
        let (lines, waiting) = Queue::bounded(WAITING, OverflowPolicy::GiveUp);
        let thread = BackgroundThread::start("log", true, move || {
            for line in waiting.iter().map_while(|line: Option<Vec<u8>>| line) {
                // an error of the log cannot be reported anywhere else
                out.write_all(&line).ok();
            }
        })?;
        Ok((Self(lines.clone()), FlushGuard { lines, thread }))
    }
}

impl<'a> MakeWriter<'a> for LogWriter {
    type Writer = &'a Self;

    fn make_writer(&'a self) -> &'a Self {
        self
    }
}

/// Each write is a line: the log formats a line before it writes it.
impl Write for &LogWriter {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        // the queue counts a line that it has no room for
        self.0.send(Some(line.to_vec())).ok();
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// On drop, logs how many lines were dropped, and flushes the queue for at most 100 ms.
#[derive(Debug)]
pub(super) struct FlushGuard {
    /// `None` ends the thread.
    lines: Queue<Option<Vec<u8>>>,
    thread: BackgroundThread<()>,
}

impl Drop for FlushGuard {
    fn drop(&mut self) {
        let lost = self.lines.lost();
        if lost > 0 {
            tracing::warn!("{lost} lines of the log were lost");
        }
        if self.lines.send_within(None, FLUSH_TIMEOUT).is_ok() {
            self.thread.wait_within(FLUSH_TIMEOUT).ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

    use super::super::test_buffer::TestBuffer;
    use super::*;

    /// Writer that signals the first write and then blocks until released.
    struct Stuck {
        page: TestBuffer,
        asked: SyncSender<()>,
        go: Receiver<()>,
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

    #[test]
    fn stuck_writer_delays_neither_a_line_nor_the_end() {
        let ((asking, asked), (let_go, go)) = (sync_channel(1), sync_channel::<()>(0));
        let page = TestBuffer::default();
        let (log, flush_guard) = LogWriter::start(Stuck { page: page.clone(), asked: asking, go }).unwrap();
        let outln = |text: &str| log.make_writer().write_all(format!("{text}\n").as_bytes()).unwrap();
        outln("first");
        asked.recv().unwrap();
        // the writer is blocked until the queue has overflowed
        (0..WAITING + 7).for_each(|_| outln("more"));
        assert_eq!(log.0.lost(), 7);
        drop(flush_guard);
        assert_eq!(page.lines(), [""; 0], "the end came though nobody read");
        drop(let_go);
    }

    #[test]
    fn end_waits_for_a_working_writer() {
        let page = TestBuffer::default();
        let (log, flush_guard) = LogWriter::start(page.clone()).unwrap();
        (0..100).for_each(|i| log.make_writer().write_all(format!("{i}.\n").as_bytes()).unwrap());
        drop(flush_guard);
        let whole: Vec<String> = (0..100).map(|i| format!("{i}.")).collect();
        assert_eq!(page.lines(), whole);
    }
}
