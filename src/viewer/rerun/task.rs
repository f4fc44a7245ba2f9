//! Bins and wanted paths of a task, for the table from above and for the camera's picture.

use re_sdk_types::archetypes::{LineStrips2D, Points2D};
use rerun::AsComponents;

use super::paint::{self, thin};
use super::run_stream::{LogResult, RunStream};
use crate::pieces::pieces;
use crate::types::RunContext;
use upm_chart::{Palette, bin_label, bin_outline};
use upm_core::geometry::Vec2;
use upm_core::job::{Bin, LayoutPath};

/// Bins and paths of a task in a view.
pub(super) struct TaskOverlay<'a, P> {
    /// Its entity: `table`.
    pub(super) root: &'a str,
    /// True where the task never moves in the view.
    pub(super) is_static: bool,
    /// Maps a point of the table, m, into the view.
    pub(super) place: P,
}

impl<P: Fn(Vec2) -> [f32; 2]> TaskOverlay<'_, P> {
    /// Logs the bins with their names and the wanted paths: bins in the colour of their kind, paths in that of their
    /// part.
    pub(super) fn log(&self, stream: &RunStream, context: &RunContext) -> LogResult {
        let palette = paint::palette(&context.parts);
        if !context.bins.is_empty() {
            let (bins, names) = self.bins(&context.bins, &palette);
            self.put(stream, "bins", &bins)?;
            self.put(stream, "bins/names", &names)?;
        }
        if context.paths.is_empty() {
            return Ok(());
        }
        let rgb =
            |path: &LayoutPath| path.part.and_then(|part| palette.parts().get(part).copied()).unwrap_or(paint::FAINT);
        let colors: Vec<[u8; 3]> = context.paths.iter().map(rgb).collect();
        let lines = context.paths.iter().map(|path| self.strip(&path.line_m()));
        let paths = LineStrips2D::new(lines).with_colors(paint::colors(&colors)).with_radii([thin(0.5)]);
        self.put(stream, "paths", &paths.with_draw_order(-3.0))
    }

    /// Rims of the bins, and their names below them.
    fn bins(&self, bins: &[Bin], palette: &Palette) -> (LineStrips2D, Points2D) {
        let rgb = |bin: &Bin| palette.of_bin(&bin.kinds).unwrap_or(paint::FAINT);
        let colors = paint::colors(&bins.iter().map(rgb).collect::<Vec<_>>());
        let rim = |bin: &Bin| {
            let corners_m = bin_outline(bin.region.min_m.into(), bin.region.max_m.into());
            self.strip(&corners_m.map(Vec2::from))
        };
        let rims = LineStrips2D::new(bins.iter().map(rim)).with_radii([thin(1.25)]);
        let lowest =
            |bin: &Bin| (self.place)(Vec2::new(0.5 * (bin.region.min_m.x + bin.region.max_m.x), bin.region.min_m.y));
        let names = Points2D::new(bins.iter().map(lowest))
            .with_labels(bins.iter().map(|bin| bin_label(&bin.kinds, &bin.parts)))
            .with_show_labels(true)
            .with_radii([thin(0.1)]);
        (rims.with_colors(colors.clone()).with_draw_order(-4.0), names.with_colors(colors))
    }

    fn strip(&self, line_m: &[Vec2]) -> Vec<[f32; 2]> {
        pieces(line_m).into_iter().map(&self.place).collect()
    }

    fn put(&self, stream: &RunStream, name: &str, what: &impl AsComponents) -> LogResult {
        let path = format!("{}/{name}", self.root);
        if self.is_static { stream.log_static(&path, what) } else { stream.log(&path, what) }
    }
}
