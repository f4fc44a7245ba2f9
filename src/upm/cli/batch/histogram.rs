use upm_chart::{Chart, Color};

/// Largest number of bars.
const MOST_BARS: f64 = 12.0;

/// Histogram of the plate times of completed runs, with their median; `None` without runs.
pub(super) fn plate_time_chart(times_s: &[f64], median_s: f64, title: &str) -> Option<Chart> {
    let Histogram { start, width, counts } = Histogram::of(times_s)?;
    let bar = |(bar, &count): (usize, &usize)| {
        let ([from, to], top) = ([bar, bar + 1].map(|edge| start + width * edge as f64), count as f64);
        [[from, 0.0], [from, top], [to, top], [to, 0.0]]
    };
    let most = counts.iter().copied().max().unwrap_or(0) as f64;
    let chart = Chart::plot("plate-time", title, ["plate time (s)", "completed runs"])
        .line("runs", Color::Blue, counts.iter().enumerate().flat_map(bar))
        .dashes("median", Color::Orange, [[median_s, 0.0], [median_s, most]]);
    Some(chart)
}

/// Counts of values over intervals of equal width.
struct Histogram {
    start: f64,
    width: f64,
    counts: Vec<usize>,
}

impl Histogram {
    /// Histogram of finite `values`, with at most twelve intervals whose width is 1, 2 or 5 times a power of ten.
    fn of(values: &[f64]) -> Option<Self> {
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
    fn chart_rises_from_the_axis_and_has_the_median() {
        let chart = plate_time_chart(&[1.0, 2.0, 2.5], 2.0, "a title").unwrap();
        let outline = &chart.layers[0].points;
        assert_eq!((outline[0][1], outline[outline.len() - 1][1]), (0.0, 0.0));
        assert_eq!(chart.layers[1].points[0][0], 2.0);
        assert!(plate_time_chart(&[], 0.0, "a title").is_none());
    }

    proptest! {
        /// Every value is counted, in at most twelve bars that hold it.
        #[test]
        fn every_value_has_its_bar(values in proptest::collection::vec(0.0..1e5f64, 1..50)) {
            let Histogram { start, width, counts } = Histogram::of(&values).unwrap();
            prop_assert_eq!(counts.iter().sum::<usize>(), values.len());
            prop_assert!(counts.len() <= MOST_BARS as usize);
            let end = start + width * counts.len() as f64;
            let slack = 1e-9 * end;
            prop_assert!(values.iter().all(|&value| start - slack <= value && value <= end + slack));
        }
    }
}
