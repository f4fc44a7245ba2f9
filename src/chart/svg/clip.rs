//! Clipping of shapes to the plot: lines are cut off at its rim, never bent.

/// The part of the segment from `a` to `b` within ranges `x` and `y`; `None` when it is outside (Liang and Barsky,
/// 1984).
pub(super) fn segment(a: [f64; 2], b: [f64; 2], x: [f64; 2], y: [f64; 2]) -> Option<[[f64; 2]; 2]> {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for (axis, [low, high]) in [x, y].into_iter().enumerate() {
        let way = b[axis] - a[axis];
        if way == 0.0 {
            if a[axis] < low || a[axis] > high {
                return None;
            }
            continue;
        }
        let (enter, leave) = ((low - a[axis]) / way, (high - a[axis]) / way);
        from = from.max(enter.min(leave));
        to = to.min(enter.max(leave));
    }
    let at = |t: f64| {
        let place = |axis: usize, [low, high]: [f64; 2]| (a[axis] + t * (b[axis] - a[axis])).clamp(low, high);
        // the end itself, free of rounding: the next segment starts there
        if t < 1.0 { [place(0, x), place(1, y)] } else { b }
    };
    (from <= to).then(|| [at(from), at(to)])
}

/// The stretches of the line through `points` within ranges `x` and `y`. A point that is not `drawable` breaks the
/// line.
pub(super) fn runs(
    points: impl IntoIterator<Item = [f64; 2]>,
    x: [f64; 2],
    y: [f64; 2],
    drawable: impl Fn(f64) -> bool,
) -> Vec<Vec<[f64; 2]>> {
    let mut runs: Vec<Vec<[f64; 2]>> = Vec::new();
    let mut before: Option<[f64; 2]> = None;
    // end of the current stretch, if it can be continued
    let mut open: Option<[f64; 2]> = None;
    for point in points {
        if !point.iter().all(|&value| drawable(value)) {
            (before, open) = (None, None);
            continue;
        }
        let kept = before.and_then(|before| segment(before, point, x, y));
        match (kept, open, runs.last_mut()) {
            (Some([from, to]), Some(end), Some(run)) if from == end => run.push(to),
            (Some([from, to]), _, _) => runs.push(vec![from, to]),
            (None, _, _) => {}
        }
        open = kept.map(|[_, to]| to);
        before = Some(point);
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const X: [f64; 2] = [-1.0, 2.0];
    const Y: [f64; 2] = [0.0, 1.0];

    fn inside([px, py]: [f64; 2]) -> bool {
        (X[0]..=X[1]).contains(&px) && (Y[0]..=Y[1]).contains(&py)
    }

    proptest! {
        #[test]
        fn a_sampled_segment_agrees(a in proptest::array::uniform2(-4.0..4.0f64), b in proptest::array::uniform2(-4.0..4.0f64)) {
            let at = |k: i32| { let t = f64::from(k) / 400.0; [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])] };
            let kept: Vec<[f64; 2]> = (0..=400).map(at).filter(|&p| inside(p)).collect();
            let found = segment(a, b, X, Y);
            if let (Some(first), Some(last)) = (kept.first(), kept.last()) {
                let [from, to] = found.unwrap();
                let step = (b[0] - a[0]).hypot(b[1] - a[1]) / 400.0 + 1e-9;
                prop_assert!((from[0] - first[0]).hypot(from[1] - first[1]) <= step);
                prop_assert!((to[0] - last[0]).hypot(to[1] - last[1]) <= step);
            }
            prop_assert!(found.is_none_or(|ends| ends.into_iter().all(inside)));
        }
    }

    #[test]
    fn a_line_that_leaves_and_comes_back_is_two() {
        let drawable = |value: f64| value.is_finite();
        let line = [[0.0, 0.5], [1.0, 0.5], [1.0, 5.0], [0.0, 5.0], [0.0, 0.2]];
        let expected = vec![vec![[0.0, 0.5], [1.0, 0.5], [1.0, 1.0]], vec![[0.0, 1.0], [0.0, 0.2]]];
        assert_eq!(runs(line, X, Y, drawable), expected);
        let broken = [[0.0, 0.5], [0.1, 0.5], [f64::NAN, 0.5], [0.2, 0.5], [0.3, 0.5]];
        assert_eq!(runs(broken, X, Y, drawable).len(), 2);
        assert_eq!(runs([[0.0, 0.5]], X, Y, drawable), Vec::<Vec<[f64; 2]>>::new());
    }
}
