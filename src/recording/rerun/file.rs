use std::io::{self, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rerun::external::re_build_info::CrateVersion;
use rerun::external::re_log_encoding::{Encoder, EncodingOptions};
use rerun::log::LogMsg;
use rerun::sink::{LogSink, SinkFlushError};

use super::live::LiveQueue;

/// The `.rrd` file as Rerun's log sink. Unlike Rerun's own file sink it keeps the first write that fails and can be
/// closed with a result. Every message is one write, so a killed process leaves all that was written so far.
#[derive(Clone)]
pub(super) struct RrdFile(Arc<Mutex<State>>);

struct State {
    encoder: Option<Encoder<Counted>>,
    fault: Option<String>,
    bytes: u64,
    messages: u64,
    live: Option<LiveQueue>,
}

impl RrdFile {
    /// Writes to `out`, unbuffered; what is written goes to `live` as well.
    pub(super) fn new(out: Box<dyn Write + Send>, live: Option<LiveQueue>) -> Result<Self, String> {
        let options = EncodingOptions::PROTOBUF_COMPRESSED;
        let out = Counted { out, bytes: 0 };
        let encoder = Encoder::new_eager(CrateVersion::LOCAL, options, out).map_err(|e| e.to_string())?;
        let state = State { encoder: Some(encoder), fault: None, bytes: 0, messages: 0, live };
        Ok(Self(Arc::new(Mutex::new(state))))
    }

    /// Writes the footer and closes. Bytes and messages written, or the first write that failed.
    pub(super) fn close(&self) -> Result<(u64, u64), String> {
        let mut state = self.state();
        state.live = None;
        if let Some(mut encoder) = state.encoder.take() {
            match encoder.finish().and_then(|()| encoder.into_inner()) {
                Ok(out) => state.bytes = out.bytes,
                Err(fault) => state.fault = state.fault.take().or_else(|| Some(fault.to_string())),
            }
        }
        match &state.fault {
            Some(fault) => Err(fault.clone()),
            None => Ok((state.bytes, state.messages)),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LogSink for RrdFile {
    fn send(&self, message: LogMsg) {
        let mut state = self.state();
        if state.fault.is_none()
            && let Some(encoder) = &mut state.encoder
        {
            match encoder.append(&message) {
                Ok(_) => state.messages += 1,
                Err(fault) => state.fault = Some(fault.to_string()),
            }
        }
        if let Some(live) = &state.live {
            live.offer(message);
        }
    }

    fn flush_blocking(&self, _timeout: Duration) -> Result<(), SinkFlushError> {
        match &self.state().fault {
            Some(fault) => Err(SinkFlushError::failed(fault.clone())),
            None => Ok(()),
        }
    }

    fn defers_finalization_to_shutdown(&self) -> bool {
        true
    }
}

/// Counts what passes.
struct Counted {
    out: Box<dyn Write + Send>,
    bytes: u64,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
