//! `--trace`: the program's spans as a timeline in Chrome's trace format, which Perfetto and browsers open.

use std::cell::OnceCell;
use std::fmt::Debug;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use parking_lot::Mutex;
use serde_json::{Map, Value, json};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id};
use tracing::{Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;

use super::output::Failure;
use upm_core::time::{Clock, MonotonicClock};

/// Largest timeline, bytes; the rest is left out.
const MOST_BYTES: usize = 64 << 20;

/// Writer of a timeline. Its clones share the file.
#[derive(Clone)]
pub(super) struct Timeline {
    clock: MonotonicClock,
    file: Arc<Mutex<TimelineFile>>,
}

/// A list of events as JSON, up to [`MOST_BYTES`].
struct TimelineFile {
    out: BufWriter<Box<dyn Write + Send>>,
    room: usize,
}

/// Begin of a span, and its fields.
struct Begun(Duration, Fields);

#[derive(Default)]
struct Fields(Map<String, Value>);

impl Timeline {
    /// Starts the timeline in `file`.
    pub fn create(file: &Path) -> Result<Self, Failure> {
        Self::to(File::create(file).map_err(|error| Failure::write(file, error))?, MOST_BYTES)
    }

    fn to(out: impl Write + Send + 'static, room: usize) -> Result<Self, Failure> {
        let file = TimelineFile { out: BufWriter::new(Box::new(out)), room };
        let timeline = Self { clock: MonotonicClock::new(), file: Arc::new(Mutex::new(file)) };
        timeline.write("[", &json!({"name": "process_name", "ph": "M", "pid": 1, "args": {"name": "upm"}}));
        Ok(timeline)
    }

    /// True for the spans that belong on it.
    pub fn takes(metadata: &Metadata<'_>) -> bool {
        metadata.is_span() && metadata.target().starts_with("upm")
    }

    /// Writes an event; a file that is full or cannot be written keeps what it has.
    fn write(&self, before: &str, event: &Value) {
        let (line, mut file) = (format!("{before}\n{event}"), self.file.lock());
        file.room =
            file.room.checked_sub(line.len()).filter(|_| file.out.write_all(line.as_bytes()).is_ok()).unwrap_or(0);
    }

    /// Completes the file, which takes nothing more.
    pub fn finish(&self) {
        let mut file = self.file.lock();
        file.room = 0;
        file.out.write_all(b"\n]\n").and_then(|()| file.out.flush()).ok();
    }

    /// Number of the present thread, named in the file when it is first asked for.
    fn thread(&self) -> u32 {
        static THREADS: AtomicU32 = AtomicU32::new(1);
        thread_local!(static NUMBER: OnceCell<u32> = const { OnceCell::new() });
        NUMBER.with(|number| {
            *number.get_or_init(|| {
                let tid = THREADS.fetch_add(1, Ordering::Relaxed);
                let name = std::thread::current().name().unwrap_or("work").to_owned();
                self.write(
                    ",",
                    &json!({"name": "thread_name", "ph": "M", "pid": 1, "tid": tid, "args": {"name": name}}),
                );
                tid
            })
        })
    }
}

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for Timeline {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        let mut fields = Fields::default();
        attributes.record(&mut fields);
        if let Some(span) = context.span(id) {
            span.extensions_mut().insert(Begun(self.clock.elapsed(), fields));
        }
    }

    fn on_close(&self, id: Id, context: Context<'_, S>) {
        let Some(span) = context.span(&id) else { return };
        let Some(Begun(began, Fields(args))) = span.extensions_mut().remove() else { return };
        let (now, name, tid) = (self.clock.elapsed(), span.name(), self.thread());
        let us = |time: Duration| time.as_nanos() as f64 / 1e3;
        let event = |phase: &str, at| json!({"name": name, "cat": "upm", "ph": phase, "pid": 1, "tid": tid, "id": id.into_u64(), "ts": us(at)});
        if name == "request" {
            // requests overlap on one thread, so each has its own track
            let mut begin = event("b", began);
            begin["args"] = args.into();
            self.write(",", &begin);
            self.write(",", &event("e", now));
        } else {
            let mut whole = event("X", began);
            (whole["dur"], whole["args"]) = (us(now.saturating_sub(began)).into(), args.into());
            self.write(",", &whole);
        }
    }
}

impl Visit for Fields {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        self.0.insert(field.name().to_owned(), format!("{value:?}").into());
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        self.0.insert(field.name().to_owned(), value.into());
    }
}

#[cfg(test)]
mod tests {
    use tracing_subscriber::filter::filter_fn;
    use tracing_subscriber::layer::SubscriberExt;

    use super::super::test_buffer::TestBuffer;
    use super::*;

    fn timeline(room: usize) -> Vec<Value> {
        let page = TestBuffer::default();
        let timeline = Timeline::to(page.clone(), room).unwrap();
        let log = tracing_subscriber::registry().with(timeline.clone().with_filter(filter_fn(Timeline::takes)));
        tracing::subscriber::with_default(log, || {
            let _job = tracing::trace_span!("job", name = "a \"b\"", seed = 7_u64).entered();
            (0..40_u64).for_each(|index| drop(tracing::trace_span!("cycle", index).entered()));
            tracing::trace_span!("request", path = "/").in_scope(|| tracing::info!("no span"));
        });
        timeline.finish();
        serde_json::from_str(&page.text()).unwrap()
    }

    #[test]
    fn spans_are_events_with_begin_end_and_fields_in_a_bounded_list() {
        let events = timeline(1 << 20);
        let phases: String = events.iter().filter_map(|event| event["ph"].as_str()).collect();
        assert_eq!(phases, format!("MM{}beX", "X".repeat(40)));
        let job = &events[44];
        assert_eq!((&job["name"], &job["args"]), (&json!("job"), &json!({"name": "a \"b\"", "seed": "7"})));
        let end_us = |event: &Value| event["ts"].as_f64().unwrap() + event["dur"].as_f64().unwrap();
        assert!(job["ts"].as_f64() < events[2]["ts"].as_f64() && end_us(job) >= end_us(&events[41]));
        let cut = timeline(1000);
        assert!((2..20).contains(&cut.len()) && cut[0] == events[0], "{cut:?}");
    }
}
