use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;

use rerun::external::re_log_encoding::{Encoder, EncodingOptions};
use rerun::log::LogMsg;
use rerun::sink::{LogSink, SinkFlushError};

use super::live::MessageSink;
use upm_recording::RecordingHandle;

/// The `.rrd` file as Rerun's log sink. Unlike Rerun's file sink it keeps the first failed write,
/// reports it at once on its handle, and returns a result when it is closed. Every message is one write, so a killed
/// process loses nothing written so far.
#[derive(Clone)]
pub(super) struct RrdFile(Arc<Mutex<State>>, RecordingHandle);

struct State {
    encoder: Option<Encoder<CountingWriter>>,
    fault: Option<String>,
    feed: Option<MessageSink>,
}

impl RrdFile {
    /// A sink that writes to `out`, unbuffered; every message also goes to `feed`.
    pub(super) fn new(
        out: Box<dyn Write + Send>,
        feed: Option<MessageSink>,
        handle: RecordingHandle,
    ) -> Result<Self, String> {
        let out = CountingWriter { out, handle: handle.clone() };
        // the header first
        let encoder = Encoder::new_eager(rerun::build_info().version, EncodingOptions::PROTOBUF_COMPRESSED, out);
        let encoder = encoder.map_err(|e| e.to_string()).inspect_err(|fault| handle.fail(fault.as_str()))?;
        let state = State { encoder: Some(encoder), fault: None, feed };
        Ok(Self(Arc::new(Mutex::new(state)), handle))
    }

    /// Status of the recording.
    pub(super) fn handle(&self) -> &RecordingHandle {
        &self.1
    }

    /// Writes the footer, closes the file and disconnects the viewer. `Err` with the first failed write.
    pub(super) fn close(&self) -> Result<(), String> {
        let mut state = self.0.lock();
        if let Some(mut encoder) = state.encoder.take() {
            match encoder.finish().and_then(|()| encoder.into_inner()) {
                Ok(_) => self.1.close(),
                Err(fault) => self.fail(&mut state, fault.to_string()),
            }
        }
        state.feed = None;
        state.fault.clone().map_or(Ok(()), Err)
    }

    /// Ends writing without a footer, which would follow an incomplete message.
    fn fail(&self, state: &mut State, fault: String) {
        state.encoder.take().map(Encoder::into_inner);
        self.1.fail(fault.as_str());
        state.fault.get_or_insert(fault);
    }
}

impl LogSink for RrdFile {
    fn send(&self, message: LogMsg) {
        let mut state = self.0.lock();
        if let Some(Err(fault)) = state.encoder.as_mut().map(|encoder| encoder.append(&message)) {
            self.fail(&mut state, fault.to_string());
        }
        if let Some(feed) = &mut state.feed {
            feed(message);
        }
    }

    fn flush_blocking(&self, _timeout: Duration) -> Result<(), SinkFlushError> {
        Ok(()) // the handle and `close` report a failure
    }

    fn defers_finalization_to_shutdown(&self) -> bool {
        true
    }
}

/// Counts the bytes that pass through.
struct CountingWriter {
    out: Box<dyn Write + Send>,
    handle: RecordingHandle,
}

impl Write for CountingWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.handle.add_bytes(written as u64);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
