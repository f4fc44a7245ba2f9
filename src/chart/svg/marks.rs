use super::range::drawable;
use super::text::{text, text_width_px};
use crate::{Color, LabelledDisc, Layer, Mark, place_labels};

/// Width of lines, px.
const LINE_PX: f64 = 1.8;
/// Width of outlines, crosses and arrows, px.
const THIN_PX: f64 = 1.3;
const DOT_PX: f64 = 2.6;
/// Half the size of a cross, px.
const CROSS_PX: f64 = 4.0;
/// Largest head of an arrow: px, and as a share of the arrow.
const HEAD_PX: f64 = 9.0;
const HEAD: f64 = 0.45;
/// Half the width of a head over its length.
const HEAD_WIDTH: f64 = 0.42;
/// Shortest arrow drawn, px.
const SHORTEST_PX: f64 = 0.1;
/// Overlap of a cell with its neighbours to the right and below, px, so that no seam shows between them.
const UNDERLAP_PX: f64 = 0.5;
/// Size of text beside points, px.
const WORD_PX: f64 = 13.0;
/// Distance of the text from its point: across to its end, and up or down to its middle, px.
const BESIDE_PX: [f64; 2] = [9.0, 10.0];
/// Factor by which text is darker than marks, so that it is legible over lines.
const DARKER: f64 = 0.7;
/// Share of the full colour at value 0.
const LIGHTEST: f64 = 0.06;
/// Places farther from the picture are drawn at this distance, px: viewers have no larger numbers.
const FARTHEST_PX: f64 = 1e6;

/// Place in the picture, px.
pub(super) type Px = [f64; 2];

/// Place of a plot in the picture, and its ranges.
pub(super) struct PlotFrame {
    /// Ranges of x and y, in decades on a logarithmic axis.
    pub x: [f64; 2],
    pub y: [f64; 2],
    /// Upper left corner, width and height, px.
    pub corner_px: Px,
    pub size_px: [f64; 2],
}

impl PlotFrame {
    /// Length of a unit along both axes, px.
    fn unit_px(&self) -> [f64; 2] {
        [self.size_px[0] / (self.x[1] - self.x[0]), self.size_px[1] / (self.y[1] - self.y[0])]
    }

    pub fn px(&self, [x, y]: [f64; 2]) -> Px {
        let ([left, top], unit) = (self.corner_px, self.unit_px());
        [left + (x - self.x[0]) * unit[0], top + (self.y[1] - y) * unit[1]].map(within_reach)
    }

    fn holds(&self, [x, y]: [f64; 2]) -> bool {
        (self.x[0]..=self.x[1]).contains(&x) && (self.y[0]..=self.y[1]).contains(&y)
    }

    /// Whether the sides right of point `i` and above it are free of the lines to its neighbours.
    fn free_side(&self, points: &[[f64; 2]], i: usize) -> [bool; 2] {
        const EVEN: f64 = 1e-6;
        let unit = self.unit_px();
        let neighbours = [i.checked_sub(1), Some(i + 1)].into_iter().flatten().filter_map(|k| points.get(k));
        let away = neighbours
            .map(|other| [0, 1].map(|axis| unit[axis] * (points[i][axis] - other[axis])))
            .map(|[x, y]| [x / x.hypot(y), y / x.hypot(y)])
            .filter(|[x, y]| x.is_finite() && y.is_finite())
            .fold([0.0; 2], |[x, y], [along_x, along_y]| [x + along_x, y + along_y]);
        away.map(|along| along > -EVEN)
    }
}

fn within_reach(px: f64) -> f64 {
    px.clamp(-FARTHEST_PX, FARTHEST_PX)
}

/// The marks of `layer`; those that can be seen in part are cut off by the plot.
pub(super) fn draw(layer: &Layer, frame: &PlotFrame) -> String {
    let &Layer { ref points, ref mark, color, .. } = layer;
    let is_drawable = |point: &[f64; 2]| point.iter().all(|&value| drawable(value));
    let seen = || points.iter().filter(|point| frame.holds(**point)).map(|&point| frame.px(point));
    match mark {
        Mark::Line | Mark::Dashes => {
            let runs = points.split(|point| !is_drawable(point)).filter(|run| run.len() > 1);
            runs.map(|run| line(run.iter().map(|&point| frame.px(point)), *mark == Mark::Dashes, color)).collect()
        }
        Mark::Dots => seen().map(|at| dot(at, color)).collect(),
        Mark::Crosses => seen().map(|at| cross(at, color)).collect(),
        Mark::Circles { radius } if drawable(*radius) => {
            let radii_px = frame.unit_px().map(|unit| within_reach(unit * radius.abs()));
            let centers = points.iter().filter(|point| is_drawable(point));
            centers.map(|&center| ellipse(frame.px(center), radii_px, color)).collect()
        }
        Mark::Arrows { vectors } => {
            let ends = points.iter().zip(vectors).map(|(from, way)| [*from, [from[0] + way[0], from[1] + way[1]]]);
            let drawn = ends.filter(|ends| ends.iter().all(is_drawable));
            drawn.map(|ends| arrow(ends.map(|end| frame.px(end)), color)).collect()
        }
        Mark::Cells { side, values } if drawable(*side) => {
            let size_px = frame.unit_px().map(|unit| within_reach(unit * side.abs()));
            let cells = points.iter().zip(values).filter(|(center, value)| is_drawable(center) && !value.is_nan());
            let corner = |[x, y]: Px| [x - 0.5 * size_px[0], y - 0.5 * size_px[1]];
            cells.map(|(&center, &value)| cell(corner(frame.px(center)), size_px, value, color)).collect()
        }
        Mark::Circles { .. } | Mark::Cells { .. } => String::new(),
        Mark::Names { texts, radii, colors } => names(frame, points, (texts, radii, colors)),
        Mark::Labels { texts } => {
            let held = points.iter().zip(texts).enumerate().filter(|(_, (point, _))| frame.holds(**point));
            held.map(|(i, (&point, text))| beside(frame, frame.px(point), frame.free_side(points, i), text, color))
                .collect()
        }
    }
}

fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02X}{g:02X}{b:02X}")
}

/// Attributes of an outline in `color`.
fn outline(color: Color, width_px: f64) -> String {
    format!("fill=\"none\" stroke=\"{}\" stroke-width=\"{width_px}\"", hex(color.rgb()))
}

pub(super) fn line(run: impl IntoIterator<Item = Px>, dashed: bool, color: Color) -> String {
    let points: Vec<String> = run.into_iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    let dashes = if dashed { " stroke-dasharray=\"8 5\"" } else { "" };
    format!("<polyline {}{dashes} points=\"{}\"/>\n", outline(color, LINE_PX), points.join(" "))
}

pub(super) fn dot([x, y]: Px, color: Color) -> String {
    format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{DOT_PX}\" fill=\"{}\"/>\n", hex(color.rgb()))
}

pub(super) fn cross([x, y]: Px, color: Color) -> String {
    let (left, top, size) = (x - CROSS_PX, y - CROSS_PX, 2.0 * CROSS_PX);
    let strokes = format!("M{left:.1} {top:.1}l{size} {size}m-{size} 0l{size} -{size}");
    format!("<path {} d=\"{strokes}\"/>\n", outline(color, THIN_PX))
}

pub(super) fn ellipse([x, y]: Px, [rx, ry]: [f64; 2], color: Color) -> String {
    format!("<ellipse {} cx=\"{x:.1}\" cy=\"{y:.1}\" rx=\"{rx:.1}\" ry=\"{ry:.1}\"/>\n", outline(color, THIN_PX))
}

/// A shaft with a head.
pub(super) fn arrow([from, to]: [Px; 2], color: Color) -> String {
    let way = [to[0] - from[0], to[1] - from[1]];
    let length = way[0].hypot(way[1]);
    if length < SHORTEST_PX {
        return String::new();
    }
    let ([along_x, along_y], head) = (way.map(|way| way / length), HEAD_PX.min(HEAD * length));
    let corner = |side: f64| {
        let across = side * HEAD_WIDTH * head;
        let [x, y] = [to[0] - along_x * head - along_y * across, to[1] - along_y * head + along_x * across];
        format!("{x:.1} {y:.1}")
    };
    let (shaft, [tip_x, tip_y]) = (corner(0.0), to);
    format!(
        "<path {} d=\"M{:.1} {:.1}L{shaft}\"/>\n<path fill=\"{}\" d=\"M{tip_x:.1} {tip_y:.1}L{}L{}Z\"/>\n",
        outline(color, THIN_PX),
        from[0],
        from[1],
        hex(color.rgb()),
        corner(1.0),
        corner(-1.0)
    )
}

/// Names beside their discs. A name of a point outside the plot is left out.
fn names(frame: &PlotFrame, points: &[[f64; 2]], (texts, radii, colors): (&[String], &[f64], &[Color])) -> String {
    let given = points.iter().zip(texts).zip(radii).zip(colors).filter(|(((point, _), _), _)| frame.holds(**point));
    let (discs, words): (Vec<LabelledDisc>, Vec<(&String, Color)>) = given
        .map(|(((&point, text), &radius), &color)| {
            let half = [0.5 * text_width_px(text, WORD_PX), 0.65 * WORD_PX];
            let radius = if drawable(radius) { within_reach(radius.abs() * frame.unit_px()[0]) } else { 0.0 };
            (LabelledDisc { center: frame.px(point), radius, half }, (text, color))
        })
        .unzip();
    let bounds = [0, 1].map(|axis| [frame.corner_px[axis], frame.corner_px[axis] + frame.size_px[axis]]);
    let places = place_labels(&discs, bounds);
    places.iter().zip(words).map(|(place, (text, color))| word(*place, "middle", text, color)).collect()
}

/// Text beside a point, on its right and above where `free` says so, turned to the other side where it would leave the
/// plot.
fn beside(frame: &PlotFrame, [x, y]: Px, free: [bool; 2], words: &str, color: Color) -> String {
    let [across, up] = BESIDE_PX;
    let wide = across + text_width_px(words, WORD_PX);
    let (left, right) = (frame.corner_px[0], frame.corner_px[0] + frame.size_px[0]);
    let at_right = if free[0] { x + wide <= right } else { x - wide < left };
    let (x, anchor) = if at_right { (x + across, "start") } else { (x - across, "end") };
    word([x, if free[1] { y - up } else { y + up }], anchor, words, color)
}

pub(super) fn word(at: Px, anchor: &str, words: &str, color: Color) -> String {
    let fill = hex(color.rgb().map(|part| (DARKER * f64::from(part)) as u8));
    text(at, WORD_PX, anchor, &format!(" fill=\"{fill}\""), words)
}

/// A square or rectangle from its upper left corner, shaded by `value`.
pub(super) fn cell([x, y]: Px, size_px: [f64; 2], value: f64, color: Color) -> String {
    let share = LIGHTEST + (1.0 - LIGHTEST) * value.clamp(0.0, 1.0);
    let fill = hex(color.rgb().map(|full| (255.0 + share * (f64::from(full) - 255.0)).round() as u8));
    let [width, height] = size_px.map(|size| size + UNDERLAP_PX);
    format!("<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{fill}\"/>\n")
}
