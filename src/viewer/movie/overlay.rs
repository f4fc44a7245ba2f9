use std::f64::consts::TAU;

use libm::sincos;

use super::shades::{Ink, MOST_COLORS};
use super::view::View;
use crate::pieces::pieces;
use crate::types::MovieContext;
use upm_chart::{Ground, Palette, bin_outline};
use upm_core::geometry::{Segment, Vec2};
use upm_perception::vision::Table;

/// Width of a drawn line, px.
const LINE_PX: f64 = 1.5;

/// Distance of a target's ring from the rim of a part on it, m: the rim stays visible.
const RING_GAP_M: f64 = 1.2e-3;

/// Colour of paths and bins of several parts or kinds.
const FAINT: [u8; 3] = [110, 115, 130];

/// The task drawn over the pictures: rings of the targets, outlines of the bins, paths.
pub(super) struct Overlay {
    /// The colours; where there are too many, some lines share one.
    pub colors: Vec<[u8; 3]>,
    /// The ink of every pixel, row by row.
    pub inks: Vec<Ink>,
}

impl Overlay {
    pub(super) fn of(context: &MovieContext, table: &Table, view: &View) -> Self {
        let mut overlay = Self { colors: Vec::new(), inks: vec![Ink::NONE; view.width * view.height] };
        for (color, line_m) in lines(context) {
            let place = |p_m: Vec2| view.place(table.lens.image_from_ideal(table.ideal_from_table.apply(p_m)));
            let line: Vec<Vec2> = pieces(&line_m).into_iter().map(place).collect();
            let known = overlay.colors.iter().position(|known| *known == color);
            if known.is_none() {
                overlay.colors.push(color);
            }
            overlay.draw(&line, known.unwrap_or(overlay.colors.len() - 1), view);
        }
        overlay.colors.truncate(MOST_COLORS);
        overlay
    }

    /// Draws a line; pixels at its edges are half covered.
    fn draw(&mut self, line: &[Vec2], color: usize, view: &View) {
        let reach = Vec2::repeat(LINE_PX);
        for is_whole in [false, true] {
            let most_px = if is_whole { 0.5 * LINE_PX - 0.25 } else { 0.5 * LINE_PX + 0.25 };
            for pair in line.windows(2) {
                let segment = Segment { from: pair[0], to: pair[1] };
                let (low, high) = (pair[0].inf(&pair[1]) - reach, pair[0].sup(&pair[1]) + reach);
                for y in low.y as usize..(high.y as usize).min(view.height) {
                    for x in low.x as usize..(high.x as usize).min(view.width) {
                        if segment.distance(Vec2::new(x as f64 + 0.5, y as f64 + 0.5)) <= most_px {
                            self.inks[y * view.width + x] = Ink::of(color, is_whole);
                        }
                    }
                }
            }
        }
    }
}

/// The lines of a task, m, with their colours.
fn lines(context: &MovieContext) -> Vec<([u8; 3], Vec<Vec2>)> {
    let kinds: Vec<&str> = context.parts.iter().map(|part| part.kind.as_str()).collect();
    let palette = Palette::of(&kinds, Ground::Light);
    let rings = context
        .parts
        .iter()
        .zip(&context.targets_m)
        .map(|(part, &target_m)| (palette.kind(&part.kind), ring(target_m, part.radius_m + RING_GAP_M)));
    let bins = context.bins.iter().map(|bin| {
        let corners_m = bin_outline(bin.region.min_m.into(), bin.region.max_m.into());
        (palette.of_bin(&bin.kinds), corners_m.map(Vec2::from).to_vec())
    });
    let of_part = |part: usize| palette.parts().get(part).copied();
    let paths = context.paths.iter().map(|path| (path.part.and_then(of_part), path.line_m()));
    rings.chain(bins).chain(paths).map(|(color, line_m)| (color.unwrap_or(FAINT), line_m)).collect()
}

fn ring(center_m: Vec2, radius_m: f64) -> Vec<Vec2> {
    const CORNERS: u32 = 48;
    let corner = |k: u32| {
        let (sin, cos) = sincos(TAU * f64::from(k) / f64::from(CORNERS));
        center_m + Vec2::new(cos, sin) * radius_m
    };
    (0..=CORNERS).map(corner).collect()
}
