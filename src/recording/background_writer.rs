use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::time::Duration;

use super::options::WriterStatus;
use upm_core::background::{
    BackgroundThread, OverflowPolicy, Queue, QueueError, Receiver, RecvTimeoutError, WaitError,
};
use upm_core::time::Clock;

/// Capacity of the queue, lines.
const QUEUE: usize = 256;

/// Longest time for which lines are gathered before they are written.
const GATHER: Duration = Duration::from_millis(250);

/// Most bytes gathered before they are written.
const MOST_GATHERED_BYTES: usize = 1 << 16;

/// Time after a commit at which the next one is due. Checked every [`GATHER`], so lines are committed within 1 s.
const COMMIT: Duration = Duration::from_millis(750);

/// Time for which [`OverflowPolicy::GiveUp`] waits at the end for a disk that lags.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(10);

/// A writer that can commit its bytes to the disk, so that they survive a loss of power.
pub trait SyncWrite: Write {
    /// Returns when all bytes written so far are on the disk.
    fn commit(&mut self) -> io::Result<()>;
}

impl SyncWrite for File {
    fn commit(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// Writes lines on a background thread, so that a slow disk does not delay the run.
///
/// Every `write` is one line. Lines are written within 0.25 s and committed within 1 s, always whole ones. A fault of
/// the thread is returned by the next `write` or by [`BackgroundWriter::finish`]; nothing is written after the first
/// fault.
#[derive(Debug)]
pub struct BackgroundWriter {
    /// `None` after the end.
    lines: Option<Queue<Vec<u8>>>,
    thread: BackgroundThread<io::Result<()>>,
    overflow: OverflowPolicy,
    watch: WriterStatus,
}

impl BackgroundWriter {
    /// Starts the thread that writes to `out`, at lower priority if `steps_back`; `watch` receives its status.
    ///
    /// # Errors
    /// The system's error where it cannot start a thread. Faults of `out` come later, from the writer.
    pub fn start(
        mut out: impl SyncWrite + Send + 'static,
        overflow: OverflowPolicy,
        steps_back: bool,
        clock: impl Clock + Send + 'static,
        watch: WriterStatus,
    ) -> io::Result<Self> {
        let (lines, waiting) = Queue::bounded(QUEUE, overflow);
        let status = watch.clone();
        let thread = BackgroundThread::start("writer", steps_back, move || {
            let written = transcribe(&mut out, &waiting, &clock, &status).inspect_err(|fault| status.fail(fault));
            status.go_on();
            written
        })?;
        Ok(Self { lines: Some(lines), thread, overflow, watch })
    }

    /// Returns when every line is on the disk. `Err` with the first fault since the start.
    pub fn finish(mut self) -> io::Result<()> {
        let ended = self.end();
        self.watch.error().map_or(ended, Err)
    }

    /// Lets the thread write the queued lines and waits for it, as long as the overflow policy allows.
    fn end(&mut self) -> io::Result<()> {
        if self.lines.take().is_none() {
            return Ok(());
        }
        self.thread.wait_as(self.overflow, CLOSE_TIMEOUT).unwrap_or_else(|unfinished| match unfinished {
            WaitError::Hangs => Err(io::Error::new(ErrorKind::TimedOut, "the disk hangs")),
            WaitError::Died => Err(io::Error::other("the writer's thread died")),
        })
    }
}

impl Write for BackgroundWriter {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        if let Some(fault) = self.watch.error() {
            return Err(fault);
        }
        let fault = match self.lines.as_ref().map(|lines| lines.send(line.to_vec())) {
            Some(Ok(())) => return Ok(line.len()),
            Some(Err(QueueError::Full)) => {
                io::Error::new(ErrorKind::WouldBlock, format!("the disk lags: {QUEUE} lines wait to be written"))
            }
            Some(Err(QueueError::Closed)) | None => self.end().err().unwrap_or_else(|| ErrorKind::BrokenPipe.into()),
        };
        self.watch.fail(&fault);
        Err(fault)
    }

    /// Does nothing: the thread writes lines without it, and [`BackgroundWriter::finish`] waits for them.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for BackgroundWriter {
    fn drop(&mut self) {
        if self.overflow == OverflowPolicy::Wait {
            self.end().ok();
        }
    }
}

/// Body of the thread: writes and commits `lines` until their sender is gone.
fn transcribe(
    out: &mut impl SyncWrite,
    lines: &Receiver<Vec<u8>>,
    clock: &impl Clock,
    watch: &WriterStatus,
) -> io::Result<()> {
    let (mut gathered, mut uncommitted) = (Vec::new(), false);
    let mut written_at = clock.elapsed();
    let mut committed_at = written_at;
    loop {
        let line = lines.recv_timeout(GATHER.saturating_sub(clock.elapsed().saturating_sub(written_at)));
        match &line {
            Ok(line) => gathered.extend_from_slice(line),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        let now = clock.elapsed();
        watch.wait(now);
        let due = line.is_err() || now.saturating_sub(written_at) >= GATHER;
        if due || gathered.len() >= MOST_GATHERED_BYTES {
            out.write_all(&gathered)?;
            watch.add_bytes(gathered.len() as u64);
            uncommitted |= !gathered.is_empty();
            gathered.clear();
            written_at = now;
        }
        if uncommitted && now.saturating_sub(committed_at) >= COMMIT {
            out.commit()?;
            uncommitted = false;
            committed_at = now;
        }
        watch.go_on();
    }
    watch.wait(clock.elapsed());
    out.write_all(&gathered)?;
    out.commit()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::sync::{Arc, Mutex};
    use std::thread;

    use super::*;
    use upm_core::time::{MonotonicClock, StoppedClock};
    use upm_fixtures::wait::eventually_true;

    /// Calls of a simulated disk, in order.
    #[derive(Clone, Debug, PartialEq, Eq)]
    enum DiskCall {
        Written(String),
        Committed,
    }

    /// A simulated disk that records its calls. It blocks at a gate first, and is full after a given number of bytes.
    #[derive(Clone, Default)]
    struct RecordedDisk {
        calls: Arc<Mutex<Vec<DiskCall>>>,
        gate: Arc<Mutex<()>>,
        room_bytes: Option<usize>,
    }

    impl RecordedDisk {
        fn calls(&self) -> Vec<DiskCall> {
            self.calls.lock().unwrap().clone()
        }

        fn text(&self) -> String {
            let text = |call| if let DiskCall::Written(text) = call { text } else { String::new() };
            self.calls().into_iter().map(text).collect()
        }
    }

    impl Write for RecordedDisk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            drop(self.gate.lock().unwrap());
            if let Some(room) = &mut self.room_bytes {
                *room = room.checked_sub(bytes.len()).ok_or(ErrorKind::StorageFull)?;
            }
            self.calls.lock().unwrap().push(DiskCall::Written(String::from_utf8(bytes.to_vec()).unwrap()));
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl SyncWrite for RecordedDisk {
        fn commit(&mut self) -> io::Result<()> {
            self.calls.lock().unwrap().push(DiskCall::Committed);
            Ok(())
        }
    }

    /// A clock that advances by a fixed number of ms whenever it is read.
    #[derive(Debug)]
    struct Steps(AtomicU64, u64);

    impl Clock for Steps {
        fn elapsed(&self) -> Duration {
            Duration::from_millis(self.0.fetch_add(self.1, Ordering::Relaxed))
        }
    }

    fn start(disk: &RecordedDisk, overflow: OverflowPolicy, status: &WriterStatus) -> BackgroundWriter {
        let steps_back = overflow == OverflowPolicy::GiveUp;
        BackgroundWriter::start(disk.clone(), overflow, steps_back, MonotonicClock::new(), status.clone()).unwrap()
    }

    #[test]
    fn all_lines_are_written_in_order_and_committed_at_the_end() {
        let (disk, status) = (RecordedDisk::default(), WriterStatus::default());
        let mut writer =
            BackgroundWriter::start(disk.clone(), OverflowPolicy::Wait, false, StoppedClock, status).unwrap();
        let lines: String = (0..5000).map(|i| format!("line {i}\n")).collect();
        lines.split_inclusive('\n').for_each(|line| writer.write_all(line.as_bytes()).unwrap());
        writer.finish().unwrap();
        assert_eq!(disk.text(), lines);
        assert_eq!(disk.calls().last(), Some(&DiskCall::Committed));
        assert!(disk.calls().iter().all(|call| !matches!(call, DiskCall::Written(text) if !text.ends_with('\n'))));
    }

    #[test]
    fn line_reaches_the_disk_while_the_writer_stays_open() {
        let disk = RecordedDisk::default();
        let mut writer = start(&disk, OverflowPolicy::Wait, &WriterStatus::default());
        writer.write_all(b"first\n").unwrap();
        eventually_true("a commit", || disk.calls().contains(&DiskCall::Committed));
        assert_eq!(disk.calls(), [DiskCall::Written("first\n".into()), DiskCall::Committed]);
        writer.finish().unwrap();
    }

    #[test]
    fn a_stream_of_lines_is_written_every_quarter_of_a_second_and_committed_within_one() {
        let disk = RecordedDisk::default();
        let (lines, waiting) = Queue::bounded(QUEUE, OverflowPolicy::Wait);
        (0..100).for_each(|i| lines.send(format!("{i}\n").into_bytes()).unwrap());
        drop(lines);
        // two readings a line: 20 ms a line
        transcribe(&mut disk.clone(), &waiting, &Steps(AtomicU64::new(0), 10), &WriterStatus::default()).unwrap();
        let mut since_commit = 0;
        for call in disk.calls() {
            match call {
                DiskCall::Written(text) => {
                    let lines = text.lines().count();
                    since_commit += lines;
                    assert!(lines <= 13, "{lines} lines of 20 ms each were gathered");
                }
                DiskCall::Committed => since_commit = 0,
            }
            assert!(since_commit <= 50, "{since_commit} lines of 20 ms each were not committed");
        }
        assert_eq!(disk.text().lines().count(), 100);
    }

    #[test]
    fn hung_disk_makes_a_writer_that_gives_up_fail_without_blocking() {
        let disk = RecordedDisk::default();
        let (gate, watch) = (disk.gate.lock().unwrap(), WriterStatus::default());
        let mut writer = start(&disk, OverflowPolicy::GiveUp, &watch);
        let fault = (0..9 * QUEUE).find_map(|_| {
            thread::sleep(Duration::from_millis(u64::from(disk.calls().is_empty()))); // lets the thread run into the gate
            writer.write_all(b"x\n").err()
        });
        assert_eq!(fault.unwrap().kind(), ErrorKind::WouldBlock);
        assert!(watch.waits_since().is_some());
        assert_eq!(watch.fault(), Some("the disk lags: 256 lines wait to be written"));
        drop(gate);
        eventually_true("the queue is written", || disk.text().len() >= 2 * QUEUE);
        let again = writer.write_all(b"late\n").unwrap_err();
        assert_eq!(again.kind(), ErrorKind::WouldBlock, "a journal with a gap in it would lie");
        assert_eq!(writer.finish().unwrap_err().to_string(), "the disk lags: 256 lines wait to be written");
        assert!(disk.text().len() >= 2 * QUEUE, "what was taken is written");
    }

    #[test]
    fn full_disk_fails_the_next_write_and_the_finish() {
        for mode in [OverflowPolicy::Wait, OverflowPolicy::GiveUp] {
            let watch = WriterStatus::default();
            let disk = RecordedDisk { room_bytes: Some(12), ..RecordedDisk::default() };
            let mut writer = start(&disk, mode, &watch);
            writer.write_all(b"line one\n").unwrap();
            eventually_true("a line is written", || !disk.text().is_empty());
            assert_eq!((watch.fault(), writer.write_all(b"line two\n").is_ok()), (None, true));
            eventually_true("a fault", || watch.fault().is_some());
            eventually_true("a refused line", || writer.write_all(b"more\n").is_err());
            assert_eq!(watch.waits_since(), None);
            assert_eq!(writer.write_all(b"more\n").unwrap_err().kind(), ErrorKind::StorageFull);
            assert_eq!(writer.finish().unwrap_err().kind(), ErrorKind::StorageFull);
            assert_eq!(disk.text(), "line one\n");
        }
    }
}
