use std::io::{self, Write};

use gif::{EncodingError, Frame as Picture, Repeat};

use super::overlay::Overlay;
use super::shades::{Shades, UNCHANGED};
use super::view::View;
use crate::types::MovieContext;
use upm_core::signal::Frame;
use upm_core::time::PlateTime;
use upm_perception::vision::Table;

/// Time for which the last picture stays, hundredths of a second.
const HOLD_CS: u64 = 200;

/// Writes frames as pictures of a GIF that repeats for ever.
pub(super) struct Encoder {
    gif: gif::Encoder<Box<dyn Write + Send>>,
    view: View,
    overlay: Overlay,
    shades: Shades,
    /// The gray that each pixel shows.
    shown: Vec<Option<u8>>,
    /// The newest picture and the time of its beginning, hundredths of a second: the next one ends it.
    newest: Option<(u64, Picture<'static>)>,
}

impl Encoder {
    /// An encoder for frames like `first`, in which `table` was found.
    pub(super) fn new(
        out: Box<dyn Write + Send>,
        table: &Table,
        first: &Frame,
        context: &MovieContext,
    ) -> io::Result<Self> {
        let view = View::of(table, first);
        let overlay = Overlay::of(context, table, &view);
        // of a mean of `bin²` pixels
        let noise_sd = |level: f64| context.noise_sd[level as usize & 255] / view.bin as f64;
        let shades = Shades::of(&view.reduced(first), noise_sd);
        let palette = shades.palette(&overlay.colors);
        let mut gif = gif::Encoder::new(out, view.width as u16, view.height as u16, &palette).map_err(fault)?;
        gif.set_repeat(Repeat::Infinite).map_err(fault)?;
        let shown = vec![None; view.width * view.height];
        Ok(Self { gif, view, overlay, shades, shown, newest: None })
    }

    /// Adds what has changed since the last frame.
    pub(super) fn add(&mut self, frame: &Frame) -> io::Result<()> {
        let width = self.view.width;
        let mut changes = vec![UNCHANGED; self.shown.len()];
        let ([mut left, mut top], [mut right, mut bottom]) = ([width - 1, self.view.height - 1], [0; 2]);
        for (at, level) in self.view.reduced(frame).into_iter().enumerate() {
            let (ink, before) = (self.overlay.inks[at], self.shown[at]);
            let gray = self.shades.gray(level, before);
            self.shown[at] = Some(gray);
            if before.is_none_or(|before| ink.index(before) != ink.index(gray)) {
                changes[at] = ink.index(gray);
                let (x, y) = (at % width, at / width);
                (left, top, right, bottom) = (left.min(x), top.min(y), right.max(x), bottom.max(y));
            }
        }
        // without any change, one pixel that does not change
        (right, bottom) = (right.max(left), bottom.max(top));
        let rows = (top..=bottom).flat_map(|y| &changes[y * width + left..=y * width + right]);
        let picture = Picture {
            transparent: Some(UNCHANGED),
            left: left as u16,
            top: top as u16,
            width: (right - left + 1) as u16,
            height: (bottom - top + 1) as u16,
            buffer: rows.copied().collect(),
            ..Picture::default()
        };
        // the first picture begins with the run
        let begins_cs = if self.newest.is_some() { hundredths(frame.exposed_at) } else { 0 };
        self.end_newest(begins_cs)?;
        self.newest = Some((begins_cs, picture));
        Ok(())
    }

    /// Holds the last picture from the run's end on, and ends the file.
    pub(super) fn finish(mut self, at: PlateTime) -> io::Result<()> {
        self.end_newest(hundredths(at) + HOLD_CS)?;
        self.gif.into_inner().map_err(fault)?.flush()
    }

    /// Writes the newest picture, which ends at this time.
    fn end_newest(&mut self, ends_cs: u64) -> io::Result<()> {
        let Some((begins_cs, mut picture)) = self.newest.take() else { return Ok(()) };
        picture.delay = u16::try_from(ends_cs.saturating_sub(begins_cs)).unwrap_or(u16::MAX);
        self.gif.write_frame(&picture).map_err(fault)
    }
}

fn hundredths(at: PlateTime) -> u64 {
    (at.secs() * 100.0).round() as u64
}

fn fault(error: EncodingError) -> io::Error {
    match error {
        EncodingError::Io(error) => error,
        error => io::Error::other(error),
    }
}
