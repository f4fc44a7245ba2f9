mod legend;
mod marks;
mod range;
mod text;

#[cfg(test)]
mod tests;

use super::{Axis, Chart, decades};
use legend::Legend;
use marks::PlotFrame;
use text::{LABEL_PX, TICK_PX, TITLE_PX, text, text_lines};

/// Width of every picture, px.
const WIDTH_PX: f64 = 900.0;
/// Space around everything, px.
const MARGIN_PX: f64 = 16.0;
/// Distance of text lines, in letter sizes.
const LINE: f64 = 1.4;
/// Height of the numbers and the label below the x axis, px.
const BELOW_PX: f64 = 48.0;
/// Gap from there to the legend, px.
const GAP_PX: f64 = 8.0;
/// Height over width of a plot that is not a map.
const USUAL: f64 = 0.55;
/// Width of the numbers and the label left of the y axis, px.
const LEFT_PX: f64 = 90.0;
/// The picture's width without margins, numbers and label, px.
const PLOT_WIDTH_PX: f64 = WIDTH_PX - 2.0 * MARGIN_PX - LEFT_PX;
/// Largest number of ticks along an axis.
const MOST_TICKS: f64 = 9.0;
/// Length of a tick, and distance of its number from the axis, px.
const TICK_LENGTH_PX: f64 = 5.0;
const NUMBER_PX: f64 = 10.0;

/// The chart as an SVG document, 900 px wide and as tall as it needs.
///
/// Points that are not finite are left out; the plot ends at its axes. The legend is below it.
pub fn svg(chart: &Chart) -> String {
    let chart = chart.in_decades();
    let layout = ChartLayout::of(&chart);
    let height_px = layout.height_px();
    format!(
        "<svg width=\"{WIDTH_PX}\" height=\"{height_px}\" viewBox=\"0 0 {WIDTH_PX} {height_px}\" \
         font-family=\"sans-serif\" xmlns=\"http://www.w3.org/2000/svg\">\n\
         <rect width=\"{WIDTH_PX}\" height=\"{height_px}\" fill=\"#FFFFFF\"/>\n{}</svg>\n",
        layout.draw(&chart)
    )
}

/// Layout of the picture.
struct ChartLayout<'a> {
    title: Vec<String>,
    frame: PlotFrame,
    legend: Legend<'a>,
}

impl<'a> ChartLayout<'a> {
    fn of(chart: &'a Chart) -> Self {
        let mut x = range::shown(&chart.x, &chart.layers, 0);
        let mut y = range::shown(&chart.y, &chart.layers, 1);
        if chart.map {
            range::make_fit(&mut x, &mut y);
        }
        let aspect = if chart.map { (y[1] - y[0]) / (x[1] - x[0]) } else { USUAL };
        let title = text_lines(&chart.title, TITLE_PX, WIDTH_PX - 2.0 * MARGIN_PX);
        let corner_px = [MARGIN_PX + LEFT_PX, MARGIN_PX + LINE * TITLE_PX * title.len() as f64];
        let frame = PlotFrame { x, y, corner_px, size_px: [PLOT_WIDTH_PX, PLOT_WIDTH_PX * aspect] };
        Self { title, frame, legend: Legend::of(&chart.layers, WIDTH_PX - 2.0 * MARGIN_PX) }
    }

    fn legend_top_px(&self) -> f64 {
        self.frame.corner_px[1] + self.frame.size_px[1] + BELOW_PX + GAP_PX
    }

    fn height_px(&self) -> f64 {
        (self.legend_top_px() + self.legend.height_px() + MARGIN_PX).ceil()
    }

    fn draw(&self, chart: &Chart) -> String {
        let title = |(i, line): (usize, &String)| {
            text([0.5 * WIDTH_PX, MARGIN_PX + LINE * TITLE_PX * (i as f64 + 0.35)], TITLE_PX, "middle", "", line)
        };
        let titles: String = self.title.iter().enumerate().map(title).collect();
        let marks: String = chart.layers.iter().map(|layer| marks::draw(layer, &self.frame)).collect();
        let ([left, top], [width, height]) = (self.frame.corner_px, self.frame.size_px);
        let place = format!("{left:.1} {top:.1} {width:.1} {height:.1}");
        // a nested picture is cut off at its rim
        let plot = format!(
            "<svg x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" viewBox=\"{place}\">\n\
             {marks}</svg>\n"
        );
        titles + &self.axes([&chart.x, &chart.y]) + &plot + &self.legend.draw([MARGIN_PX, self.legend_top_px()])
    }

    /// Axes, grid and their numbers and labels.
    fn axes(&self, [x, y]: [&Axis; 2]) -> String {
        let frame = &self.frame;
        let ([left, top], [width, height]) = (frame.corner_px, frame.size_px);
        let (right, bottom) = (left + width, top + height);
        let mut grid = String::new();
        let mut axes = format!("M{left:.1} {top:.1}V{bottom:.1}H{right:.1}");
        let mut texts = String::new();
        for value in ticks(frame.x) {
            let [at, _] = frame.px([value, frame.y[0]]);
            grid += &format!("M{at:.1} {bottom:.1}V{top:.1}");
            axes += &format!("M{at:.1} {bottom:.1}v{TICK_LENGTH_PX}");
            let number = decades::tick_text(x.is_log, value);
            texts += &text([at, bottom + NUMBER_PX + 0.5 * TICK_PX], TICK_PX, "middle", "", &number);
        }
        for value in ticks(frame.y) {
            let [_, at] = frame.px([frame.x[0], value]);
            grid += &format!("M{left:.1} {at:.1}H{right:.1}");
            axes += &format!("M{left:.1} {at:.1}h-{TICK_LENGTH_PX}");
            texts += &text([left - NUMBER_PX, at], TICK_PX, "end", "", &decades::tick_text(y.is_log, value));
        }
        let [across, down] = [left + 0.5 * width, top + 0.5 * height];
        let beside = MARGIN_PX + 0.5 * LABEL_PX;
        let turned = format!(" transform=\"rotate(-90 {beside:.1} {down:.1})\"");
        texts += &text([across, bottom + BELOW_PX - 0.5 * LABEL_PX], LABEL_PX, "middle", "", &x.label);
        texts += &text([beside, down], LABEL_PX, "middle", &turned, &y.label);
        let path = |d: &str, color: &str| format!("<path d=\"{d}\" fill=\"none\" stroke=\"{color}\"/>\n");
        path(&grid, "#E1E1E1") + &path(&axes, "#5A5A5A") + &texts
    }
}

/// Numbers at the ticks of an axis: multiples of the least step of 1, 2 or 5 times a power of ten that are not too
/// many.
fn ticks([low, high]: [f64; 2]) -> impl Iterator<Item = f64> {
    let decade = 10f64.powf(((high - low) / MOST_TICKS).log10().floor());
    let ends = |step: f64| [(low / step).ceil(), (high / step).floor()];
    let fits = |step: &f64| ends(*step)[1] - ends(*step)[0] < MOST_TICKS;
    let step = [1.0, 2.0, 5.0].map(|times| times * decade).into_iter().find(fits).unwrap_or(10.0 * decade);
    let [first, last] = ends(step);
    (0..=(last - first) as i32).map(move |i| (first + f64::from(i)) * step)
}
