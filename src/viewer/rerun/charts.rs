//! Charts in 2D views. A map keeps the units of its axes. A curve is drawn in a box with its ticks, because a 2D view
//! has no axes and Rerun's plots allow only time along x. Views have y down, so y is negated.

use std::borrow::Cow;

use rerun::{Arrows2D, Color, Ellipses2D, Image, LineStrips2D, Points2D, Transform3D};

use super::names::{self, LabelSize};
use super::paint::{self, thin};
use super::run_stream::{LogResult, RunStream};
use super::shaded_cells::Raster;
use upm_chart::{self as chart, Chart, LabelledDisc, Layer, Mark, axis_ticks, place_labels};

/// Width and height of the box that a curve is drawn in.
const BOX: [f64; 2] = [160.0, 100.0];

/// Margins around the picture for ticks and text, in hundredths of its height: left and right, below and above.
const MARGIN: [[f64; 2]; 2] = [[18.0, 8.0], [24.0, 32.0]];

/// Largest number of ticks along an axis.
const MOST_TICKS: usize = 6;

/// Draw order of texts, which are above all layers; layers are drawn in their order.
const WORDS: f32 = 1e3;

/// A chart and its placement in its view.
pub(super) struct ChartView<'a> {
    /// The chart, logarithmic axes in decades.
    chart: Cow<'a, Chart>,
    /// Ranges of x and y, in the axes' units.
    range: [[f64; 2]; 2],
    /// Length in the view of one unit of x and of y.
    scale: [f64; 2],
    /// A hundredth of the picture's height in the view.
    unit: f64,
}

impl<'a> ChartView<'a> {
    pub(super) fn new(chart: &'a Chart) -> Self {
        let chart = chart.in_decades();
        let range = [(0, &chart.x), (1, &chart.y)].map(|(axis, of)| of.range.unwrap_or_else(|| extent(&chart, axis)));
        let scale = [0, 1].map(|axis| if chart.map { 1.0 } else { BOX[axis] / (range[axis][1] - range[axis][0]) });
        let unit = (range[1][1] - range[1][0]) * scale[1] / 100.0;
        Self { chart, range, scale, unit }
    }

    /// Bounds of the view, from and to: along x, then down y.
    pub(super) fn bounds(&self) -> [[f64; 2]; 2] {
        let [[left, right], [below, above]] = MARGIN.map(|margin| margin.map(|share| share * self.unit));
        let [x, y] = [0, 1].map(|axis| self.range[axis].map(|value| value * self.scale[axis]));
        [[x[0] - left, x[1] + right], [-y[1] - above, -y[0] + below]]
    }

    /// Logs the chart under `root`.
    pub(super) fn log(&self, stream: &RunStream, root: &str) -> LogResult {
        self.log_axes(stream, &format!("{root}/axes"))?;
        self.log_legend(stream, &format!("{root}/legend"))?;
        for (i, layer) in self.chart.layers.iter().enumerate() {
            let name: String = layer.label.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
            self.log_layer(stream, &format!("{root}/{}_{name}", i + 1), layer, i as f32)?;
        }
        Ok(())
    }

    fn place(&self, [x, y]: [f64; 2]) -> [f32; 2] {
        [(x * self.scale[0]) as f32, (-y * self.scale[1]) as f32]
    }

    /// The point of the view this many units to the right of and below another.
    fn beside(&self, at: [f64; 2], right: f64, below: f64) -> [f32; 2] {
        let [x, y] = self.place(at);
        [x + (right * self.unit) as f32, y + (below * self.unit) as f32]
    }

    fn log_layer(&self, stream: &RunStream, path: &str, layer: &Layer, order: f32) -> LogResult {
        let (color, points) = (color(layer.color), &layer.points);
        let seen = || points.iter().copied().filter(is_finite).map(|point| self.place(point));
        let strips = |strips: Vec<Vec<[f32; 2]>>| {
            LineStrips2D::new(strips).with_colors([color]).with_radii([thin(1.0)]).with_draw_order(order)
        };
        match &layer.mark {
            Mark::Line => stream.log_static(path, &strips(self.lines(points))),
            Mark::Dashes => {
                let broken = self.lines(points).iter().flat_map(|line| dashes(line, 2.0 * self.unit as f32)).collect();
                stream.log_static(path, &strips(broken))
            }
            Mark::Dots => {
                let dots = Points2D::new(seen()).with_colors([color]).with_radii([thin(2.0)]);
                stream.log_static(path, &dots.with_draw_order(order))
            }
            Mark::Crosses => {
                let arm = 1.2 * self.unit as f32;
                let strokes = |[x, y]: [f32; 2]| {
                    [1.0, -1.0].map(|lean| vec![[x - arm, y - lean * arm], [x + arm, y + lean * arm]])
                };
                stream.log_static(path, &strips(seen().flat_map(strokes).collect()))
            }
            Mark::Circles { radius } => {
                let half = self.scale.map(|scale| (radius * scale) as f32);
                let circles = Ellipses2D::from_centers_and_half_sizes(seen(), seen().map(|_| half));
                stream
                    .log_static(path, &circles.with_colors([color]).with_line_radii([thin(1.0)]).with_draw_order(order))
            }
            Mark::Arrows { vectors } => {
                let (from, along): (Vec<_>, Vec<_>) = points
                    .iter()
                    .zip(vectors)
                    .filter(|(point, vector)| is_finite(point) && is_finite(vector))
                    .map(|(&point, &vector)| (self.place(point), self.place(vector)))
                    .unzip();
                let arrows = Arrows2D::from_vectors(along).with_origins(from).with_colors([color]);
                stream.log_static(path, &arrows.with_radii([thin(1.0)]).with_draw_order(order))
            }
            Mark::Cells { side, values } => self.log_cells(stream, path, layer, (*side, values), order),
            Mark::Names { texts, radii, colors } => self.log_names(stream, path, layer, (texts, radii, colors)),
            Mark::Labels { texts } => {
                let pairs = points.iter().zip(texts).filter(|(point, _)| is_finite(point));
                let words = pairs.map(|(&point, text)| (self.place(point), text.clone())).collect();
                stream.log_static(path, &written(words).with_colors([color]))
            }
        }
    }

    /// Logs names beside their discs, off every disc and off each other, each in its colour.
    fn log_names(
        &self,
        stream: &RunStream,
        path: &str,
        layer: &Layer,
        (texts, radii, colors): (&[String], &[f64], &[chart::Color]),
    ) -> LogResult {
        let (words, colors) = self.names(&layer.points, (texts, radii, colors));
        stream.log_static(path, &written(words).with_colors(colors))
    }

    /// Names with the points that they hang from, and their colours.
    fn names(
        &self,
        points: &[[f64; 2]],
        (texts, radii, colors): (&[String], &[f64], &[chart::Color]),
    ) -> (Vec<([f32; 2], String)>, Vec<Color>) {
        let bounds = self.bounds();
        let label = LabelSize::of(bounds, names::PANEL);
        let given = points.iter().zip(texts).zip(radii).zip(colors).filter(|(((point, _), _), _)| is_finite(point));
        let (discs, words): (Vec<LabelledDisc>, Vec<(&String, Color)>) = given
            .map(|(((&point, text), radius), &of)| {
                let center = self.place(point).map(f64::from);
                (LabelledDisc { center, radius: radius * self.scale[0], half: label.half(text) }, (text, color(of)))
            })
            .unzip();
        let hung = place_labels(&discs, bounds, &[]).into_iter().map(|place| label.hung_from(place.center));
        hung.zip(words).map(|(place, (text, color))| ((place, text.clone()), color)).unzip()
    }

    /// Logs the cells as one picture, because boxes cannot be filled.
    fn log_cells(
        &self,
        stream: &RunStream,
        path: &str,
        layer: &Layer,
        (side, values): (f64, &[f64]),
        order: f32,
    ) -> LogResult {
        let cells: Vec<([f64; 2], f64)> = layer.points.iter().copied().zip(values.iter().copied()).collect();
        let Some(raster) = Raster::of(&cells, side, layer.color.rgb()) else { return Ok(()) };
        let [x, y] = self.place(raster.top_left);
        let pixel = self.scale.map(|scale| (raster.pixel * scale) as f32);
        let place = Transform3D::from_translation_scale([x, y, 0.0], [pixel[0], pixel[1], 1.0]);
        stream.log_static(path, &place)?;
        stream.log_static(path, &Image::from_rgba32(raster.rgba, raster.size_px).with_draw_order(order))
    }

    /// Lines through the points, broken at points that are not finite.
    fn lines(&self, points: &[[f64; 2]]) -> Vec<Vec<[f32; 2]>> {
        let stretches = points.split(|point| !is_finite(point)).filter(|stretch| !stretch.is_empty());
        stretches.map(|stretch| stretch.iter().map(|&point| self.place(point)).collect()).collect()
    }

    /// Logs frame, ticks and axis labels.
    fn log_axes(&self, stream: &RunStream, path: &str) -> LogResult {
        let [[left, right], [below, above]] = self.range;
        let frame = [[left, below], [right, below], [right, above], [left, above], [left, below]];
        let mut strips = vec![frame.map(|corner| self.place(corner)).to_vec()];
        let mut words = vec![
            (self.beside([0.5 * (left + right), below], 0.0, 12.0), self.chart.x.label.clone()),
            (self.beside([left, above], 0.0, -16.0), self.chart.y.label.clone()),
        ];
        for (tick, text) in axis_ticks(self.chart.x.scale, self.range[0], MOST_TICKS).major {
            strips.push(vec![self.place([tick, below]), self.beside([tick, below], 0.0, 1.5)]);
            words.push((self.beside([tick, below], 0.0, 1.5), text));
        }
        for (tick, text) in axis_ticks(self.chart.y.scale, self.range[1], MOST_TICKS).major {
            strips.push(vec![self.place([left, tick]), self.beside([left, tick], -1.5, 0.0)]);
            // labels are below their point
            words.push((self.beside([left, tick], -7.0, -3.0), text));
        }
        let gray = paint::color(paint::FAINT);
        let strips = LineStrips2D::new(strips).with_colors([gray]).with_radii([thin(0.5)]);
        stream.log_static(&format!("{path}/lines"), &strips.with_draw_order(-20.0))?;
        stream.log_static(&format!("{path}/words"), &written(words).with_colors([gray]))
    }

    /// Logs the layers' names above the picture, in their colours.
    fn log_legend(&self, stream: &RunStream, path: &str) -> LogResult {
        let named: Vec<&Layer> = self.chart.layers.iter().filter(|layer| !layer.label.is_empty()).collect();
        let ([left, right], above) = (self.range[0], self.range[1][1]);
        let step = (right - left) / named.len().max(1) as f64;
        let words = named
            .iter()
            .enumerate()
            .map(|(i, layer)| (self.beside([left + (i as f64 + 0.5) * step, above], 0.0, -28.0), layer.label.clone()));
        let words = written(words.collect()).with_colors(named.iter().map(|layer| color(layer.color)));
        stream.log_static(path, &words.with_radii([thin(4.0)]))
    }
}

/// Texts, each hanging from a point.
fn written(words: Vec<([f32; 2], String)>) -> Points2D {
    let (places, words): (Vec<_>, Vec<_>) = words.into_iter().unzip();
    Points2D::new(places).with_labels(words).with_show_labels(true).with_radii([thin(0.1)]).with_draw_order(WORDS)
}

/// The chart's colour, slightly lighter because views are dark.
pub(super) fn color(of: chart::Color) -> Color {
    let [r, g, b] = of.rgb().map(|part| part + (255 - part) / 4);
    Color::from_rgb(r, g, b)
}

fn is_finite(point: &[f64; 2]) -> bool {
    point.iter().all(|value| value.is_finite())
}

/// Range of all items along an axis, with a margin; 0 to 1 without items.
fn extent(chart: &Chart, axis: usize) -> [f64; 2] {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for layer in &chart.layers {
        for (i, point) in layer.points.iter().enumerate() {
            let (before, after) = match &layer.mark {
                Mark::Circles { radius } => (-radius, *radius),
                Mark::Cells { side, .. } => (-0.5 * side, 0.5 * side),
                Mark::Arrows { vectors } => vectors.get(i).map_or((0.0, 0.0), |v| (v[axis].min(0.0), v[axis].max(0.0))),
                _ => (0.0, 0.0),
            };
            if (point[axis] + before + after).is_finite() {
                (low, high) = (low.min(point[axis] + before), high.max(point[axis] + after));
            }
        }
    }
    match high - low {
        span if span > 0.0 => [low - 0.04 * span, high + 0.04 * span],
        // a single value
        0.0 => [low - 0.5 * low.abs().max(1.0), high + 0.5 * high.abs().max(1.0)],
        _ => [0.0, 1.0],
    }
}

/// Every second stretch of `length` along a line.
fn dashes(line: &[[f32; 2]], length: f32) -> Vec<Vec<[f32; 2]>> {
    let (mut all, mut dash, mut left, mut drawn) = (Vec::new(), Vec::new(), length, true);
    for pair in line.windows(2) {
        let ([mut x, mut y], [to_x, to_y]) = (pair[0], pair[1]);
        loop {
            if drawn {
                dash.push([x, y]);
            }
            let rest = (to_x - x).hypot(to_y - y);
            if rest <= left || all.len() >= MOST_DASHES {
                left -= rest;
                break;
            }
            (x, y) = (x + (to_x - x) * left / rest, y + (to_y - y) * left / rest);
            if drawn {
                dash.push([x, y]);
                all.push(std::mem::take(&mut dash));
            }
            (drawn, left) = (!drawn, length);
        }
    }
    if let (true, Some(&end)) = (drawn, line.last()) {
        dash.push(end);
        all.push(dash);
    }
    all
}

/// Largest number of dashes; the rest of a longer line is drawn unbroken.
const MOST_DASHES: usize = 2000;

#[cfg(test)]
mod tests {
    use super::*;
    use upm_chart::Axis;

    fn chart(map: bool, mark: Mark, points: &[[f64; 2]]) -> Chart {
        let axis = Axis::new("a");
        let layers = vec![Layer::new("layer", mark, chart::Color::Blue, points.iter().copied())];
        Chart { name: "c".into(), title: "C".into(), x: axis.clone(), y: axis, map, layers }
    }

    #[test]
    fn maps_keep_their_unit_and_curves_fill_their_box() {
        let points = [[0.0, 0.0], [50.0, 100.0]];
        let map = chart(true, Mark::Line, &points);
        let view = ChartView::new(&map);
        assert_eq!(view.place([50.0, 100.0]), [50.0, -100.0]);
        let curve = chart(false, Mark::Line, &points);
        let view = ChartView::new(&curve);
        let ([x0, y0], [x1, y1]) = (view.place([-2.0, -4.0]), view.place([52.0, 104.0]));
        assert!((f64::from(x1 - x0) - BOX[0]).abs() < 1e-4 && (f64::from(y0 - y1) - BOX[1]).abs() < 1e-4);
        let [x, y] = view.bounds();
        for (from, to, inside) in [(x[0], x[1], [x0, x1]), (y[0], y[1], [y0, y1])] {
            assert!(inside.iter().all(|&value| from < f64::from(value) && f64::from(value) < to));
        }
    }

    #[test]
    fn extents_contain_the_whole_marks() {
        assert_eq!(extent(&chart(true, Mark::Circles { radius: 5.0 }, &[[0.0, 0.0]]), 0), [-5.4, 5.4]);
        assert_eq!(extent(&chart(true, Mark::Arrows { vectors: vec![[10.0, 0.0]] }, &[[0.0, 3.0]]), 0), [-0.4, 10.4]);
        assert_eq!(extent(&chart(true, Mark::Dots, &[[f64::NAN, 3.0]]), 0), [0.0, 1.0]);
        assert_eq!(extent(&chart(true, Mark::Dots, &[[0.0, 3.0]]), 1), [1.5, 4.5]);
        assert_eq!(extent(&chart(true, Mark::Dots, &[]), 1), [0.0, 1.0]);
    }

    #[test]
    fn dashes_are_every_second_stretch() {
        let line = [[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]];
        let expected = [vec![[0.0, 0.0], [2.0, 0.0]], vec![[3.0, 1.0], [3.0, 3.0]]];
        assert_eq!(dashes(&line, 2.0), expected);
        let around = dashes(&line, 5.0);
        assert_eq!(around, [vec![[0.0, 0.0], [3.0, 0.0], [3.0, 2.0]]]);
        assert!(dashes(&[], 1.0).is_empty());
        assert!(dashes(&[[0.0, 0.0], [1e9, 0.0]], 1e-3).len() <= MOST_DASHES + 1);
    }

    #[test]
    fn names_are_beside_their_discs_in_their_colours() {
        let points = [[0.0, 0.0], [f64::NAN, 0.0], [100.0, 100.0]];
        let texts: Vec<String> = ["penny-1", "lost", "penny-2"].map(str::to_owned).to_vec();
        let (radii, colors) = (vec![9.5; 3], [[10, 20, 30], [0; 3], [200, 20, 30]].map(chart::Color::Rgb).to_vec());
        let mark = Mark::Names { texts: texts.clone(), radii: radii.clone(), colors: colors.clone() };
        let mut map = chart(true, mark, &points);
        map.x.range = Some([-150.0, 150.0]);
        map.y.range = map.x.range;
        let view = ChartView::new(&map);
        let (words, drawn) = view.names(&points, (&texts, &radii, &colors));
        assert_eq!(words.iter().map(|(_, text)| text.as_str()).collect::<Vec<_>>(), ["penny-1", "penny-2"]);
        assert_eq!(drawn, [color(colors[0]), color(colors[2])]);
        let label = LabelSize::of(view.bounds(), names::PANEL);
        for ([x, hung_y], at) in words.iter().map(|(place, _)| *place).zip([points[0], points[2]]) {
            let (left, top) = (f64::from(x) - at[0], f64::from(hung_y) + at[1]);
            let [w, h] = label.half("penny-1");
            // the label is below the point that it hangs from
            let y = top + label.hung_from([0.0, 0.0])[1].abs() as f64;
            let apart = (left.abs() - w).max(0.0).hypot((y.abs() - h).max(0.0));
            assert!(apart > 9.5 && apart < 25.0, "{apart}: beside the disc, {words:?}");
        }
    }

    #[test]
    fn lines_break_at_nan_points() {
        let broken = chart(true, Mark::Line, &[]);
        let view = ChartView::new(&broken);
        let lines = view.lines(&[[0.0, 0.0], [1.0, 1.0], [2.0, f64::NAN], [3.0, 3.0]]);
        assert_eq!(lines, [vec![[0.0, -0.0], [1.0, -1.0]], vec![[3.0, -3.0]]]);
    }
}
