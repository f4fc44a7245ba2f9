mod clip;
mod legend;
mod marks;
mod range;
mod sheet;

#[cfg(test)]
mod tests;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::{Chart, decades};
use legend::Legend;
use marks::PlotFrame;
use sheet::{DrawResult, LABEL_PX, Sheet, TICK_PX, TITLE_PX, fine, font, plain_text, text_lines};

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
const MOST_TICKS: usize = 9;

/// The chart as an SVG document, 900 px wide and as tall as it needs.
///
/// Points that are not finite are left out; lines end at the rim of the plot. The legend is below it.
pub fn svg(chart: &Chart) -> String {
    let chart = chart.in_decades();
    let chart = chart.as_ref();
    let layout = ChartLayout::of(chart);
    let (width, height) = (fine(WIDTH_PX) as u32, fine(layout.height_px()) as u32);
    let mut document = String::new();
    let sheet = SVGBackend::with_string(&mut document, (width, height)).into_drawing_area();
    // writing into a string cannot fail
    layout.draw(chart, &sheet).and_then(|()| sheet.present()).ok();
    drop(sheet);
    let shown = format!("width=\"{WIDTH_PX}\" height=\"{}\"", layout.height_px());
    document.replacen(&format!("width=\"{width}\" height=\"{height}\""), &shown, 1)
}

/// All charts below each other in one SVG document.
pub fn svg_page(charts: &[Chart]) -> String {
    let (mut page, mut height_px) = (String::new(), 0.0);
    for chart in charts {
        page += &svg(chart).replacen("<svg ", &format!("<svg y=\"{height_px}\" "), 1);
        height_px += ChartLayout::of(&chart.in_decades()).height_px();
    }
    let open = format!("<svg width=\"{WIDTH_PX}\" height=\"{height_px}\" xmlns=\"http://www.w3.org/2000/svg\">\n");
    open + &page + "</svg>\n"
}

/// Layout of the picture.
struct ChartLayout {
    title: Vec<String>,
    /// Ranges of the axes, in decades on a logarithmic one.
    x: [f64; 2],
    y: [f64; 2],
    plot_height_px: f64,
    legend: Legend,
}

impl ChartLayout {
    fn of(chart: &Chart) -> Self {
        let mut x = range::shown(&chart.x, &chart.layers, 0);
        let mut y = range::shown(&chart.y, &chart.layers, 1);
        if chart.map {
            range::make_fit(&mut x, &mut y);
        }
        let aspect = if chart.map { (y[1] - y[0]) / (x[1] - x[0]) } else { USUAL };
        Self {
            title: text_lines(&chart.title, TITLE_PX, WIDTH_PX - 2.0 * MARGIN_PX),
            x,
            y,
            plot_height_px: PLOT_WIDTH_PX * aspect,
            legend: Legend::of(&chart.layers, WIDTH_PX - 2.0 * MARGIN_PX),
        }
    }

    fn plot_top_px(&self) -> f64 {
        MARGIN_PX + LINE * TITLE_PX * self.title.len() as f64
    }

    fn legend_top_px(&self) -> f64 {
        self.plot_top_px() + self.plot_height_px + BELOW_PX + GAP_PX
    }

    fn height_px(&self) -> f64 {
        (self.legend_top_px() + self.legend.height_px() + MARGIN_PX).ceil()
    }

    fn draw(&self, chart: &Chart, sheet: &Sheet<'_>) -> DrawResult {
        sheet.fill(&WHITE)?;
        for (i, line) in self.title.iter().enumerate() {
            let at = (fine(0.5 * WIDTH_PX), fine(MARGIN_PX + LINE * TITLE_PX * (i as f64 + 0.35)));
            sheet.draw(&Text::new(line.clone(), at, font(TITLE_PX, HPos::Center)))?;
        }
        let frame = self.draw_axes(chart, sheet)?;
        for layer in &chart.layers {
            marks::draw(layer, &frame, sheet)?;
        }
        self.legend.draw(sheet, MARGIN_PX, self.legend_top_px())
    }

    /// Draws axes, grid and labels; returns the frame for the marks.
    fn draw_axes(&self, chart: &Chart, sheet: &Sheet<'_>) -> Result<PlotFrame, DrawingAreaErrorKind<std::io::Error>> {
        let mut plot = ChartBuilder::on(sheet)
            .margin_top(fine(self.plot_top_px()))
            .margin_bottom(fine(self.height_px() - self.legend_top_px() + GAP_PX))
            .margin_left(fine(MARGIN_PX))
            .margin_right(fine(MARGIN_PX))
            .x_label_area_size(fine(BELOW_PX))
            .y_label_area_size(fine(LEFT_PX))
            .build_cartesian_2d(self.x[0]..self.x[1], self.y[0]..self.y[1])?;
        plot.configure_mesh()
            .label_style(font(TICK_PX, HPos::Center))
            .axis_desc_style(font(LABEL_PX, HPos::Center))
            .x_desc(plain_text(&chart.x.label))
            .y_desc(plain_text(&chart.y.label))
            .bold_line_style(RGBColor(225, 225, 225).stroke_width(fine(1.0) as u32))
            .axis_style(RGBColor(90, 90, 90).stroke_width(fine(1.0) as u32))
            .max_light_lines(0)
            .x_labels(MOST_TICKS)
            .y_labels(MOST_TICKS)
            .x_label_formatter(&|value| decades::tick_text(chart.x.scale, *value))
            .y_label_formatter(&|value| decades::tick_text(chart.y.scale, *value))
            .set_all_tick_mark_size(fine(5.0))
            .draw()?;
        let (across, down) = plot.plotting_area().get_pixel_range();
        Ok(PlotFrame { x: self.x, y: self.y, across: [across.start, across.end], down: [down.start, down.end] })
    }
}
