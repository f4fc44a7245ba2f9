use upm_chart::{Chart, Color, Layer, Mark};

/// Largest number of bars.
const MOST_BARS: f64 = 12.0;

/// Length of the longest bar, columns.
const COLUMNS: usize = 40;

/// Histogram: counts of values over intervals of equal width.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Histogram {
    start: f64,
    width: f64,
    counts: Vec<usize>,
}

impl Histogram {
    /// Histogram of finite `values`, with at most twelve intervals whose width is 1, 2 or 5 times a power of ten;
    /// `None` without values.
    pub fn of(values: &[f64]) -> Option<Self> {
        let least = values.iter().copied().min_by(f64::total_cmp)?;
        let most = values.iter().copied().max_by(f64::total_cmp)?;
        let width = width(most - least, least.abs().max(most.abs()));
        let start = (least / width).floor() * width;
        let bar = |value: f64| ((value - start) / width) as usize;
        let mut counts = vec![0; bar(most) + 1];
        for &value in values {
            if let Some(count) = counts.get_mut(bar(value)) {
                *count += 1;
            }
        }
        Some(Self { start, width, counts })
    }

    fn ends(&self, bar: usize) -> [f64; 2] {
        [bar, bar + 1].map(|edge| self.start + self.width * edge as f64)
    }

    /// One line per bar: interval, count, and marks in proportion.
    pub fn lines(&self) -> Vec<String> {
        let most = self.counts.iter().copied().max().unwrap_or(1).max(1);
        let decimals = (-self.width.log10().floor()).max(0.0) as usize;
        let line = |(bar, &count): (usize, &usize)| {
            let [from, to] = self.ends(bar).map(|edge| format!("{edge:.decimals$}"));
            // a bar whose count is not 0 has at least one mark
            let length = (count * COLUMNS).div_ceil(most);
            format!("{from:>8} to {to:>8} {count:>5}  {}", "#".repeat(length)).trim_end().to_owned()
        };
        self.counts.iter().enumerate().map(line).collect()
    }

    /// Outline of the bars, which begins and ends on the axis.
    fn outline(&self) -> Vec<[f64; 2]> {
        let of_bar = |(bar, &count): (usize, &usize)| {
            let ([from, to], top) = (self.ends(bar), count as f64);
            [[from, 0.0], [from, top], [to, top], [to, 0.0]]
        };
        self.counts.iter().enumerate().flat_map(of_bar).collect()
    }

    /// The chart of the plate times of completed runs, with their median.
    pub fn chart(&self, title: &str, median_s: f64) -> Chart {
        let most = self.counts.iter().copied().max().unwrap_or(0) as f64;
        let layers = vec![
            Layer::new("runs", Mark::Line, Color::Blue, self.outline()),
            Layer::new("median", Mark::Dashes, Color::Orange, [[median_s, 0.0], [median_s, most]]),
        ];
        Chart::plot("plate-time", title, ["plate time (s)", "completed runs"], layers)
    }
}

/// Width of the intervals over `range`; equal values of about `size` get one interval.
fn width(range: f64, size: f64) -> f64 {
    let wanted = if range > 0.0 { range / (MOST_BARS - 1.0) } else { 0.1 * size.max(1.0) };
    let power = 10_f64.powf(wanted.log10().floor());
    let steps = [1.0, 2.0, 5.0].map(|step| step * power);
    steps.into_iter().find(|&step| step >= wanted).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn bars_show_interval_count_and_share() {
        let histogram = Histogram::of(&[78.9, 80.0, 80.1, 81.9, 95.0]).unwrap();
        let lines = histogram.lines();
        assert_eq!(lines[0], format!("      78 to       80     1  {}", "#".repeat(14)));
        assert_eq!(lines[1], format!("      80 to       82     3  {}", "#".repeat(40)));
        assert_eq!(lines[2], "      82 to       84     0");
        assert_eq!(lines.len(), 9);
    }

    #[test]
    fn equal_values_are_one_bar_and_no_values_none() {
        assert_eq!(Histogram::of(&[]), None);
        for value in [0.0, 12.5, 1e6] {
            assert_eq!(Histogram::of(&[value; 7]).unwrap().counts, [7], "{value}");
        }
    }

    #[test]
    fn chart_rises_from_the_axis_and_has_the_median() {
        let chart = Histogram::of(&[1.0, 2.0, 2.5]).unwrap().chart("a title", 2.0);
        let outline = &chart.layers[0].points;
        assert_eq!((outline[0][1], outline[outline.len() - 1][1]), (0.0, 0.0));
        assert_eq!(chart.layers[1].points[0][0], 2.0);
    }

    proptest! {
        /// Every value is counted, in at most twelve bars that hold it.
        #[test]
        fn every_value_has_its_bar(values in proptest::collection::vec(0.0..1e5f64, 1..50)) {
            let histogram = Histogram::of(&values).unwrap();
            prop_assert_eq!(histogram.counts.iter().sum::<usize>(), values.len());
            prop_assert!(histogram.counts.len() <= MOST_BARS as usize);
            let [least, _] = histogram.ends(0);
            let [_, most] = histogram.ends(histogram.counts.len() - 1);
            let slack = 1e-9 * most;
            prop_assert!(values.iter().all(|&value| least - slack <= value && value <= most + slack));
        }
    }
}
