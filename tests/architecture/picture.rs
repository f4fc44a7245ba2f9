//! Picture of the crates in their layers, as SVG: each arrow leads from a crate to one that it imports.

use std::fmt::Write;

use super::layers::Crates;
use super::map::MAP;

/// Crates in each column of the picture, from left to right. An arrow over several layers runs down the column of the
/// crate that it leads to.
const COLUMNS: [&[&str]; 9] = [
    &["reference"],
    &["perception"],
    &["fixtures", "task", "core"],
    &["recording", "control", "planner", "cor_library", "document"],
    &["upm", "server", "runner", "viewer", "qp"],
    &["shapes"],
    &["sim"],
    &["lab", "scene"],
    &["chart"],
];

/// Left margin for the titles of the layers, px.
const MARGIN: usize = 190;
/// Width and height of a cell, and of the box of a crate in it, px.
const CELL: [usize; 2] = [92, 68];
const BOX: [usize; 2] = [80, 28];

fn column_of(of: &str) -> usize {
    let column = COLUMNS.iter().position(|column| column.contains(&of));
    column.unwrap_or_else(|| panic!("`{of}` has no column in the picture"))
}

/// Arrows that run across a crate on their way.
pub fn crossings(crates: &Crates) -> Vec<String> {
    let arrows = crates.arrows().flat_map(|(from, to)| {
        let between = crates.layer(to) + 1..crates.layer(from);
        let hit = crates.imports().filter(move |(of, _)| between.contains(&crates.layer(of)));
        hit.filter(move |(of, _)| column_of(of) == column_of(to))
            .map(move |(of, _)| format!("{from} -> {to} runs across {of}"))
    });
    arrows.collect()
}

/// SVG of all crates in their layers, the content of `assets/layers.svg`.
pub fn picture(crates: &Crates) -> String {
    let layers = MAP.layers.len();
    let [width, height] = [MARGIN + COLUMNS.len() * CELL[0] + 10, layers * CELL[1]];
    // Middle of a crate's column, and of a layer: the lowest one is at the bottom.
    let x_of = |of: &str| MARGIN + column_of(of) * CELL[0] + CELL[0] / 2;
    let y_of = |layer: usize| (layers - 1 - layer) * CELL[1] + CELL[1] / 2;
    let mut svg = format!(
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}"
 font-family="Helvetica, Arial, sans-serif" font-size="14">
<title>Crates of upm in layers; each arrow leads from a crate to one that it imports</title>
<marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">
<path d="M0 0L8 4L0 8z" fill="#667"/></marker>
<rect width="100%" height="100%" rx="8" fill="white"/>
"##
    );
    for (number, layer) in MAP.layers.iter().enumerate() {
        let (y, title) = (y_of(number), layer.title.trim_start_matches("Layer ").replacen(':', "", 1));
        let (top, tall, base) = (y - CELL[1] / 2, CELL[1], y + 5);
        if number % 2 == 0 {
            let _ = writeln!(svg, r##"<rect y="{top}" width="100%" height="{tall}" rx="8" fill="#f4f5f8"/>"##);
        }
        let _ = writeln!(svg, r##"<text x="14" y="{base}" fill="#556">{title}</text>"##);
    }
    for (from, to) in crates.arrows() {
        let [start, end] = [from, to].map(|of| (x_of(of), y_of(crates.layer(of))));
        // A bend below the start, then straight down.
        let (y, gap) = (start.1 + BOX[1] / 2, CELL[1] - BOX[1]);
        let ([x0, x1], [middle, straight, y1]) = ([start.0, end.0], [y + gap / 2, y + gap - 9, end.1 - BOX[1] / 2]);
        let path = format!("M{x0} {y}C{x0} {middle} {x1} {middle} {x1} {straight}V{y1}");
        let _ = writeln!(
            svg,
            r##"<path d="{path}" fill="none" stroke="#667" stroke-width="1.3" marker-end="url(#head)"/>"##
        );
    }
    for (of, _) in crates.imports() {
        let [x, y] = [x_of(of), y_of(crates.layer(of))];
        let ([left, top], [wide, tall], base) = ([x - BOX[0] / 2, y - BOX[1] / 2], BOX, y + 5);
        let _ = writeln!(
            svg,
            r##"<rect x="{left}" y="{top}" width="{wide}" height="{tall}" rx="5" fill="white" stroke="#335"/>
<text x="{x}" y="{base}" text-anchor="middle" fill="#112">{of}</text>"##
        );
    }
    svg + "</svg>\n"
}
