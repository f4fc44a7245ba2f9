use crate::{Axis, Layer, Mark};

/// Numbers beyond this are left out like those that are not finite: no measurement is so large.
const MOST: f64 = 1e100;
/// Margin at each end of a range that fits the layers, as a share of it.
const MARGIN: f64 = 0.04;
/// Narrowest range, relative to its larger end: in a narrower one neighbouring ticks would have the same text.
const NARROWEST: f64 = 1e-9;
/// Narrowest range around zero.
const NARROWEST_AT_ZERO: f64 = 1e-12;
/// Least and largest ratio of a map's height to its width that fit a page.
const ASPECTS: [f64; 2] = [0.3, 1.05];

/// True for a number that can be drawn.
pub(super) fn drawable(value: f64) -> bool {
    value.abs() <= MOST
}

/// The range of `axis`, number 0 or 1: its fixed range if valid, otherwise the one that fits `layers`.
pub(super) fn shown(axis: &Axis, layers: &[Layer], number: usize) -> [f64; 2] {
    let own = axis.range.filter(|ends| ends.iter().all(|&end| drawable(end)) && ends[0] < ends[1]);
    if let Some([low, high]) = own {
        return widened(low, high);
    }
    let [low, high] = layers
        .iter()
        .flat_map(|layer| extents(layer, number))
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [from, to]| [low.min(from), high.max(to)]);
    if low > high {
        return [0.0, 1.0];
    }
    let margin = MARGIN * (high - low);
    if margin > 0.0 { widened(low - margin, high + margin) } else { widened(low - 0.5, high + 0.5) }
}

/// The range, widened to the least width for numbers of this size.
fn widened(low: f64, high: f64) -> [f64; 2] {
    let least = (NARROWEST * low.abs().max(high.abs())).max(NARROWEST_AT_ZERO);
    let missing = 0.5 * (least - (high - low)).max(0.0);
    [low - missing, high + missing]
}

/// Widens one range of a map so that its plot fits a page, with one unit as long along x as along y.
pub(super) fn make_fit(x: &mut [f64; 2], y: &mut [f64; 2]) {
    let [flattest, tallest] = ASPECTS;
    widen_to(y, flattest * (x[1] - x[0]));
    widen_to(x, (y[1] - y[0]) / tallest);
}

fn widen_to(range: &mut [f64; 2], width: f64) {
    let missing = 0.5 * (width - (range[1] - range[0])).max(0.0);
    *range = [range[0] - missing, range[1] + missing];
}

/// The extent along one axis of each drawable item in `layer`, from and to.
fn extents(layer: &Layer, number: usize) -> impl Iterator<Item = [f64; 2]> {
    let reach = move |i: usize| match &layer.mark {
        Mark::Circles { radius } => [-radius.abs(), radius.abs()],
        Mark::Cells { side, .. } => [-0.5 * side.abs(), 0.5 * side.abs()],
        Mark::Arrows { vectors } => {
            let along = vectors.get(i).map_or(0.0, |vector| vector[number]);
            [along.min(0.0), along.max(0.0)]
        }
        Mark::Line | Mark::Dashes | Mark::Dots | Mark::Crosses | Mark::Labels { .. } | Mark::Names { .. } => [0.0, 0.0],
    };
    layer.points.iter().enumerate().filter_map(move |(i, point)| {
        let [back, ahead] = reach(i);
        let ends = [point[number] + back, point[number] + ahead];
        let whole = point.iter().chain(&ends).all(|&value| drawable(value));
        whole.then_some(ends)
    })
}
