//! `--trace`: the program's spans as a timeline in Chrome's trace format, which Perfetto and browsers open.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use tracing::Metadata;
use tracing_chrome::{ChromeLayer, ChromeLayerBuilder, FlushGuard};
use tracing_subscriber::filter::{FilterFn, Filtered, filter_fn};
use tracing_subscriber::{Layer, Registry};

use super::output::Failure;
use super::signals;

/// Largest timeline, bytes; the rest is left out.
const MOST_BYTES: usize = 64 << 20;

/// Layer of a log that writes its spans to a timeline.
pub(super) type Timeline = Filtered<ChromeLayer<Registry>, FilterFn, Registry>;

/// Starts the timeline in `file`. It is complete once the returned guard is dropped.
pub(super) fn create(file: &Path) -> Result<(Timeline, FlushGuard), Failure> {
    let out = File::create(file).map_err(|error| Failure::write(file, error))?;
    // the library's thread must not take the signals that end a run
    signals::ending().thread_block().ok();
    let timeline = written_to(BoundedFile { out, room: MOST_BYTES });
    signals::ending().thread_unblock().ok();
    Ok(timeline)
}

fn written_to(out: impl Write + Send + 'static) -> (Timeline, FlushGuard) {
    let (layer, guard) = ChromeLayerBuilder::new().writer(out).include_args(true).include_locations(false).build();
    let of_program: fn(&Metadata<'_>) -> bool = |span| span.is_span() && span.target().starts_with("upm");
    (layer.with_filter(filter_fn(of_program)), guard)
}

/// A list of events as JSON. Events beyond its room, or that cannot be written, are lost without an error: the library
/// panics at one.
struct BoundedFile<W> {
    out: W,
    room: usize,
}

impl<W: Write> Write for BoundedFile<W> {
    fn write(&mut self, events: &[u8]) -> io::Result<usize> {
        let is_written = events.len() <= self.room && self.out.write_all(events).is_ok();
        if !is_written && self.room > 0 {
            // the list ends with the last whole event
            let whole = events.windows(2).rposition(|end| end == b",\n").unwrap_or(0);
            self.out.write_all(&events[..whole]).and_then(|()| self.out.write_all(b"\n]\n")).ok();
        }
        self.room = if is_written { self.room - events.len() } else { 0 };
        Ok(events.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;
    use tracing_subscriber::layer::SubscriberExt;

    use super::super::test_buffer::TestBuffer;
    use super::*;

    fn timeline(room: usize) -> Vec<Value> {
        let page = TestBuffer::default();
        let (layer, guard) = written_to(BoundedFile { out: page.clone(), room });
        tracing::subscriber::with_default(tracing_subscriber::registry().with(layer), || {
            let _job = tracing::trace_span!("job", seed = 7).entered();
            (0..400_u64).for_each(|index| drop(tracing::trace_span!("cycle", index).entered()));
            tracing::info!("no span");
        });
        drop(guard);
        serde_json::from_str(&page.text()).unwrap()
    }

    #[test]
    fn spans_are_a_bounded_list_of_beginnings_and_ends() {
        let events = timeline(1 << 20);
        let phases: String = events.iter().filter_map(|event| event["ph"].as_str()).collect();
        assert_eq!(phases, format!("MB{}E", "BE".repeat(400)));
        assert!(events[1]["name"] == "job" && events[1]["args"].to_string().contains("seed"), "{}", events[1]);
        let cut = timeline(20_000);
        assert!((20..800).contains(&cut.len()) && cut[0]["name"] == "job", "{}", cut.len());
    }
}
