//! Places for the names of parts: beside their discs, off every disc and off each other.

use std::f64::consts::{FRAC_PI_2, TAU};

/// Number of directions from a disc in which its label may lie.
const DIRECTIONS: usize = 24;

/// Distances of a label from its disc that are tried, in heights of the label.
const STEPS: [f64; 12] = [0.0, 0.2, 0.4, 0.7, 1.1, 1.6, 2.2, 3.0, 4.0, 5.5, 7.5, 10.0];

/// A round part with the label to be placed beside it; y points down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LabelledDisc {
    /// Centre of the disc.
    pub(crate) center: [f64; 2],
    /// Distance from the centre to the rim, in the units of `center`.
    pub(crate) radius: f64,
    /// Half the width and half the height of its label.
    pub(crate) half: [f64; 2],
}

/// Middles of the labels of `parts`: the nearest places to each disc where the label covers no disc and no other label,
/// within `bounds`, from and to along x and y; right below the disc where there is none.
pub(crate) fn place_labels(parts: &[LabelledDisc], bounds: [[f64; 2]; 2]) -> Vec<[f64; 2]> {
    let mut placed: Vec<[f64; 2]> = Vec::with_capacity(parts.len());
    for part in parts {
        let is_free = |center: &[f64; 2]| {
            let on_label = placed.iter().zip(parts).any(|(other, of)| covers_label(*center, part, *other, of));
            let on_disc = parts.iter().any(|other| covers_disc(*center, part.half, other));
            !on_label && !on_disc && is_within(*center, part.half, bounds)
        };
        placed.push(candidates(part).find(is_free).or_else(|| candidates(part).next()).unwrap_or(part.center));
    }
    placed
}

/// Middles of a label around its disc, the nearest first, from below on.
fn candidates(part: &LabelledDisc) -> impl Iterator<Item = [f64; 2]> {
    let LabelledDisc { center: [x, y], radius, half: [w, h] } = *part;
    STEPS.into_iter().flat_map(move |steps| {
        (0..DIRECTIONS).map(move |direction| {
            let (sin, cos) = (FRAC_PI_2 + TAU * direction as f64 / DIRECTIONS as f64).sin_cos();
            let reach = touching(radius * 1.1, [w, h], [cos, sin]) + steps * 2.0 * h;
            [x + reach * cos, y + reach * sin]
        })
    })
}

/// Distance in a direction at which a box of half sides `half` just touches a disc of this radius.
fn touching(radius: f64, [w, h]: [f64; 2], [cos, sin]: [f64; 2]) -> f64 {
    let (mut near, mut far) = (0.0, radius + w + h);
    for _ in 0..24 {
        let middle = 0.5 * (near + far);
        let disc = LabelledDisc { center: [middle * cos, middle * sin], radius, half: [w, h] };
        if covers_disc([0.0; 2], disc.half, &disc) { near = middle } else { far = middle }
    }
    far
}

/// True where a label covers some of a disc.
fn covers_disc(center: [f64; 2], half: [f64; 2], disc: &LabelledDisc) -> bool {
    let [x, y] = [0, 1].map(|axis| ((disc.center[axis] - center[axis]).abs() - half[axis]).max(0.0));
    x.hypot(y) < disc.radius
}

/// True where two labels cover each other in part.
fn covers_label(a: [f64; 2], of_a: &LabelledDisc, b: [f64; 2], of_b: &LabelledDisc) -> bool {
    [0, 1].iter().all(|&axis| (a[axis] - b[axis]).abs() < of_a.half[axis] + of_b.half[axis])
}

/// True where a label is within `bounds`.
fn is_within(center: [f64; 2], half: [f64; 2], bounds: [[f64; 2]; 2]) -> bool {
    let ends = |axis: usize| [center[axis] - half[axis], center[axis] + half[axis]];
    [0, 1].iter().all(|&axis| ends(axis)[0] >= bounds[axis][0] && ends(axis)[1] <= bounds[axis][1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BOUNDS: [[f64; 2]; 2] = [[-190.0, 190.0], [-190.0, 190.0]];

    fn penny(center: [f64; 2]) -> LabelledDisc {
        LabelledDisc { center, radius: 9.5, half: [17.0, 10.0] }
    }

    /// Up to 24 pennies on a plate of 305 mm, none nearer than 2 mm to another.
    fn pennies() -> impl Strategy<Value = Vec<LabelledDisc>> {
        let place = proptest::array::uniform2(-142.0..142.0f64);
        proptest::collection::vec(place, 1..60).prop_map(|places| {
            let mut parts: Vec<LabelledDisc> = Vec::new();
            for [x, y] in places {
                let free = |part: &LabelledDisc| (part.center[0] - x).hypot(part.center[1] - y) > 21.0;
                if parts.len() < 24 && parts.iter().all(free) {
                    parts.push(penny([x, y]));
                }
            }
            parts
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]

        #[test]
        fn labels_of_pennies_cover_no_coin_and_no_other_label(parts in pennies()) {
            let placed = place_labels(&parts, BOUNDS);
            prop_assert_eq!(placed.len(), parts.len());
            for (i, place) in placed.iter().enumerate() {
                for part in &parts {
                    prop_assert!(!covers_disc(*place, parts[i].half, part), "{i}: {place:?} on {part:?}");
                }
                for (j, other) in placed.iter().enumerate().take(i) {
                    prop_assert!(!covers_label(*place, &parts[i], *other, &parts[j]), "{i} on {j}: {place:?} {other:?}");
                }
                prop_assert!(is_within(*place, parts[i].half, BOUNDS));
            }
        }
    }

    #[test]
    fn lone_label_is_placed_right_below_its_disc() {
        let [place] = place_labels(&[penny([10.0, 20.0])], BOUNDS)[..] else { panic!("one label") };
        assert!((place[0] - 10.0).abs() < 1e-9, "{place:?}");
        assert!((place[1] - (20.0 + 1.1 * 9.5 + 10.0)).abs() < 1e-3, "{place:?}");
    }
}
