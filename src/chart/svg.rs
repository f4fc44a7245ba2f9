use super::Chart;

/// The chart as an SVG document.
pub fn svg(chart: &Chart) -> String {
    chart.title.clone()
}
