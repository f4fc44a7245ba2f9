//! Movies of runs: the camera's pictures as an animated GIF.
//!
//! Pictures are encoded on a background thread as they come, so that memory is bounded. Camera noise is left out: a
//! pixel changes when it differs from the movie by more than its noise.

mod encoder;
mod overlay;
mod shades;
#[cfg(test)]
mod tests;
mod view;

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use upm_control::{EventFacts, FrameFacts, LocalisedFacts, Sink};
use upm_core::background::{BackgroundThread, OverflowPolicy, Queue, Receiver};
use upm_core::signal::Frame;
use upm_core::time::PlateTime;
use upm_perception::vision::Table;

use crate::types::MovieContext;
use encoder::Encoder;

/// Most pictures per second of plate time.
const PICTURES_HZ: f64 = 15.0;

/// Capacity of the queue to the encoder, frames.
const QUEUE: usize = 8;

/// A sink that films a run: its camera's pictures, cropped to the plate, with the task drawn over them, at the pace of
/// plate time. The run waits when the disk lags.
pub struct Movie {
    /// Frames, each with the first table.
    queue: Queue<(Table, Frame)>,
    encoder: BackgroundThread<io::Result<Option<Encoder>>>,
    table: Option<Table>,
    filmed_at: Option<PlateTime>,
    /// Time of the newest fact.
    now: PlateTime,
}

impl Movie {
    /// Creates the file at `path` and films a run into it.
    ///
    /// # Errors
    /// The system's error where it cannot create the file or start a thread.
    pub fn create(path: &Path, context: MovieContext) -> io::Result<Self> {
        Self::into_file(Box::new(BufWriter::new(File::create(path)?)), context)
    }

    fn into_file(out: Box<dyn Write + Send>, context: MovieContext) -> io::Result<Self> {
        let (queue, frames) = Queue::bounded(QUEUE, OverflowPolicy::Wait);
        let encoder = BackgroundThread::start("movie", false, move || encode(out, &frames, &context))?;
        Ok(Self { queue, encoder, table: None, filmed_at: None, now: PlateTime::ZERO })
    }

    /// Waits until everything is written.
    ///
    /// # Errors
    /// The first failed write; a run without a picture of its plate.
    pub fn finish(self) -> io::Result<()> {
        drop(self.queue);
        let encoder = self.encoder.wait_as(OverflowPolicy::Wait, Duration::MAX);
        let encoder = encoder.map_err(|_| io::Error::other("the encoder's thread died"))??;
        encoder.ok_or_else(|| io::Error::other("the run has no picture of its plate"))?.finish(self.now)
    }

    fn film(&mut self, frame: &Frame) {
        const ROUNDING_S: f64 = 1e-6;
        self.now = frame.exposed_at;
        let is_early = |before| self.now.secs_since(before) + ROUNDING_S < 1.0 / PICTURES_HZ;
        let is_left_out = frame.pixels.is_empty() || self.filmed_at.is_some_and(is_early);
        if let Some(table) = self.table.clone().filter(|_| !is_left_out) {
            self.filmed_at = Some(self.now);
            // `finish` reports why an encoder has ended early
            self.queue.send((table, frame.clone())).ok();
        }
    }
}

impl Sink for Movie {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.table.get_or_insert_with(|| facts.table.clone());
        self.film(facts.frame);
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        self.film(facts.frame);
    }

    fn event(&mut self, event: &EventFacts) {
        self.now = event.at;
    }
}

/// Body of the thread: encodes frames as long as there are senders; `None` without a frame.
fn encode(
    out: Box<dyn Write + Send>,
    frames: &Receiver<(Table, Frame)>,
    context: &MovieContext,
) -> io::Result<Option<Encoder>> {
    let Ok((table, first)) = frames.recv() else { return Ok(None) };
    let mut encoder = Encoder::new(out, &table, &first, context)?;
    encoder.add(&first)?;
    frames.iter().try_for_each(|(_, frame)| encoder.add(&frame))?;
    Ok(Some(encoder))
}
