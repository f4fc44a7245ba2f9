use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

use tracing_subscriber::fmt::MakeWriter;

use upm_core::priority::step_back;
use upm_core::time::{Clock, MonotonicClock};

/// Lines that may wait to be written.
const WAITING: usize = 1024;

/// Longest time that the end of the process waits for them.
const FAREWELL: Duration = Duration::from_millis(100);

/// How often it looks meanwhile.
const LOOK: Duration = Duration::from_millis(1);

/// Queue of log lines that never blocks: a dedicated thread writes them. When it is full lines are dropped, and their number
/// is reported before the next one.
#[derive(Debug)]
pub(super) struct LogWriter {
    lines: SyncSender<Entry>,
    tally: Arc<Tally>,
}

#[derive(Debug)]
struct Entry {
    text: Vec<u8>,
    /// Lines lost just before it.
    lost: u64,
}

#[derive(Debug, Default)]
struct Tally {
    /// Lines that are not written yet.
    waiting: AtomicUsize,
    /// Lines lost that nothing was told of yet.
    lost: AtomicU64,
}

impl LogWriter {
    /// Starts the thread that writes to `out`. `tell_lost` is called on it with how many lines were lost.
    pub(super) fn start(
        out: impl Write + Send + 'static,
        tell_lost: impl Fn(u64) + Send + 'static,
    ) -> io::Result<(Self, LastWords)> {
        let (lines, entries) = sync_channel(WAITING);
        let tally = Arc::<Tally>::default();
        let written = Arc::clone(&tally);
        thread::Builder::new().name("log".into()).spawn(move || {
            step_back();
            write_down(&entries, out, &written, tell_lost);
        })?;
        Ok((Self { lines, tally: Arc::clone(&tally) }, LastWords(tally)))
    }

    fn offer(&self, text: Vec<u8>) {
        let Tally { waiting, lost } = &*self.tally;
        let entry = Entry { text, lost: lost.swap(0, Ordering::SeqCst) };
        waiting.fetch_add(1, Ordering::SeqCst);
        if let Err(TrySendError::Full(entry) | TrySendError::Disconnected(entry)) = self.lines.try_send(entry) {
            waiting.fetch_sub(1, Ordering::SeqCst);
            lost.fetch_add(entry.lost + 1, Ordering::SeqCst);
        }
    }
}

fn write_down(entries: &Receiver<Entry>, mut out: impl Write, tally: &Tally, tell_lost: impl Fn(u64)) {
    while let Ok(Entry { text, lost }) = entries.recv() {
        if lost > 0 {
            tell_lost(lost);
        }
        // a log that cannot be written has no place to report it
        out.write_all(&text).ok();
        tally.waiting.fetch_sub(1, Ordering::SeqCst);
    }
}

impl<'a> MakeWriter<'a> for LogWriter {
    type Writer = Line<'a>;

    fn make_writer(&'a self) -> Line<'a> {
        Line { log: self, text: Vec::new() }
    }
}

/// A line that is being put together; whole when it is dropped.
#[derive(Debug)]
pub(super) struct Line<'a> {
    log: &'a LogWriter,
    text: Vec<u8>,
}

impl Write for Line<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.text.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Line<'_> {
    fn drop(&mut self) {
        self.log.offer(std::mem::take(&mut self.text));
    }
}

/// On drop, waits up to 100 ms for the queue to be written.
#[derive(Debug)]
pub(super) struct LastWords(Arc<Tally>);

impl Drop for LastWords {
    fn drop(&mut self) {
        let clock = MonotonicClock::new();
        while self.0.waiting.load(Ordering::SeqCst) > 0 && clock.elapsed() < FAREWELL {
            thread::sleep(LOOK);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::log_page::Page;
    use super::*;

    /// Says that it is asked to write, and then does not return before it is let go.
    struct Stuck {
        page: Page,
        asked: SyncSender<()>,
        go: Receiver<()>,
    }

    impl Write for Stuck {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.asked.try_send(()).ok();
            // an error once the other end is dropped
            self.go.recv().ok();
            self.page.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    struct Log {
        log: LogWriter,
        last_words: LastWords,
        page: Page,
        asked: Receiver<()>,
        let_go: SyncSender<()>,
    }

    fn stuck() -> Log {
        let ((asking, asked), (let_go, go)) = (sync_channel(1), sync_channel(0));
        let page = Page::default();
        let (out, told) = (Stuck { page: page.clone(), asked: asking, go }, page.clone());
        let (log, last_words) =
            LogWriter::start(out, move |lost| writeln!(told.clone(), "{lost} lost").unwrap()).unwrap();
        Log { log, last_words, page, asked, let_go }
    }

    #[test]
    fn who_logs_never_waits_and_lost_lines_are_counted() {
        let Log { log, last_words, page, asked, let_go } = stuck();
        let say = |text: String| writeln!(log.make_writer(), "{text}").unwrap();
        say("first".to_owned());
        asked.recv().unwrap();
        // the writer is stuck until all of this is said
        (0..WAITING).for_each(|i| say(i.to_string()));
        (0..7).for_each(|_| say("no room".to_owned()));
        drop(let_go);
        let until_written = || {
            while last_words.0.waiting.load(Ordering::SeqCst) > 0 {
                thread::sleep(LOOK);
            }
        };
        until_written();
        say("after".to_owned());
        until_written();
        let lines = page.lines();
        assert_eq!(lines.len(), 1 + WAITING + 2, "{lines:?}");
        assert_eq!((lines[0].as_str(), lines[WAITING].as_str()), ("first", (WAITING - 1).to_string().as_str()));
        assert_eq!(lines[WAITING + 1..], ["7 lost", "after"]);
    }

    #[test]
    fn the_end_waits_for_what_goes_and_not_for_what_is_stuck() {
        let Log { log, last_words, page, let_go, .. } = stuck();
        drop(let_go);
        for i in 0..100 {
            let mut line = log.make_writer();
            write!(line, "{i}").unwrap();
            writeln!(line, ".").unwrap();
        }
        drop(last_words);
        let whole: Vec<String> = (0..100).map(|i| format!("{i}.")).collect();
        assert_eq!(page.lines(), whole);

        let Log { log, last_words, page, let_go, .. } = stuck();
        writeln!(log.make_writer(), "stuck").unwrap();
        drop(last_words);
        assert_eq!(page.lines(), [""; 0], "the end came though nobody read");
        drop(let_go);
    }
}
