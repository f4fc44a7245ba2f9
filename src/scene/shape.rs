use upm_core::geometry::Vec2;

/// An outline on the plate's plane, m.
#[derive(Clone, Debug, PartialEq)]
pub enum ClutterOutline {
    /// The hull of two circles: centres and radii.
    Hull([(Vec2, f64); 2]),
    /// Intersection of half-planes: `normal · p ≤ offset`, normals of length 1.
    Convex(Vec<(Vec2, f64)>),
}

impl ClutterOutline {
    /// Outline of all points within `radius_m` of `at_m`.
    pub fn circle(at_m: Vec2, radius_m: f64) -> Self {
        Self::Hull([(at_m, radius_m); 2])
    }

    /// A finger's outline: all points within `radius_m` of the segment between two points.
    pub fn capsule(from_m: Vec2, to_m: Vec2, radius_m: f64) -> Self {
        Self::Hull([(from_m, radius_m), (to_m, radius_m)])
    }

    /// A rectangle from its middle, its half sides and the direction of the first of them.
    pub fn rectangle(at_m: Vec2, half_m: [f64; 2], direction_rad: f64) -> Self {
        let (sin, cos) = direction_rad.sin_cos();
        let (along, across) = (Vec2::new(cos, sin), Vec2::new(-sin, cos));
        let sides = [(along, half_m[0]), (-along, half_m[0]), (across, half_m[1]), (-across, half_m[1])];
        Self::Convex(sides.map(|(normal, half)| (normal, normal.dot(&at_m) + half)).into())
    }

    /// The plate's square.
    pub fn square(side_m: f64) -> Self {
        Self::rectangle(Vec2::zeros(), [side_m / 2.0; 2], 0.0)
    }

    /// Depth of `p_m` inside the outline, m: zero on the outline and nowhere else, negative outside, and never changing
    /// by more than the distance moved. Outside corners it falls short of the distance.
    pub fn depth(&self, p_m: Vec2) -> f64 {
        match self {
            Self::Hull(circles) => hull_depth(circles, p_m),
            Self::Convex(sides) => sides.iter().map(|(n, offset)| offset - n.dot(&p_m)).fold(f64::INFINITY, f64::min),
        }
    }

    /// True when a corner is within about `reach_m` of `p_m`.
    pub(super) fn has_corner_near(&self, p_m: Vec2, reach_m: f64) -> bool {
        match self {
            Self::Hull(_) => false,
            Self::Convex(sides) => {
                sides.iter().filter(|(n, offset)| (offset - n.dot(&p_m)).abs() < 2.0 * reach_m).count() > 1
            }
        }
    }
}

/// Depth in a hull: beside the tangents that of the nearest circle, between them that of the nearer tangent. The
/// tangents' normals are at angles from the axis whose cosine is the radii's difference over the distance.
fn hull_depth(&[(a, a_radius), (b, b_radius)]: &[(Vec2, f64); 2], p: Vec2) -> f64 {
    let circle = |center: Vec2, radius: f64| radius - (p - center).norm();
    let axis = b - a;
    let length = axis.norm();
    if length <= (a_radius - b_radius).abs() {
        return if a_radius > b_radius { circle(a, a_radius) } else { circle(b, b_radius) };
    }
    let axis = axis / length;
    let (x, y) = (axis.dot(&(p - a)), axis.perp(&(p - a)).abs());
    let cos = (a_radius - b_radius) / length;
    let sin = (1.0 - cos * cos).sqrt();
    let along = x * sin - y * cos;
    if along <= 0.0 {
        circle(a, a_radius)
    } else if along >= length * sin {
        circle(b, b_radius)
    } else {
        a_radius - (x * cos + y * sin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec2> {
        (-3.0..3.0f64, -3.0..3.0f64).prop_map(|(x, y)| Vec2::new(x, y))
    }

    proptest! {
        #[test]
        fn hull_is_the_union_of_the_circles_between(a in point(), b in point(), p in point(), radii in (0.1..2.0f64, 0.1..2.0f64)) {
            let between = |t: f64| radii.0 + t * (radii.1 - radii.0) - (p - a - (b - a) * t).norm();
            let slow = (0..=4000).map(|i| between(f64::from(i) / 4000.0)).fold(f64::NEG_INFINITY, f64::max);
            let depth = ClutterOutline::Hull([(a, radii.0), (b, radii.1)]).depth(p);
            // Outside, the distance is that of the nearest of those circles; inside, only the sign agrees.
            prop_assert!((depth > 0.0) == (slow > 0.0) || depth.abs() < 1e-5, "{depth} {slow}");
            prop_assert!(depth > 0.0 || (depth - slow).abs() < 1e-5, "{depth} {slow}");
        }

        #[test]
        fn depth_never_changes_faster_than_the_way(
            a in point(), b in point(), p in point(), q in point(), radii in (0.1..2.0f64, 0.1..2.0f64), direction in -3.0..3.0f64,
        ) {
            for shape in [ClutterOutline::Hull([(a, radii.0), (b, radii.1)]), ClutterOutline::rectangle(a, [radii.0, radii.1], direction)] {
                prop_assert!((shape.depth(p) - shape.depth(q)).abs() <= (p - q).norm() + 1e-12);
            }
        }
    }
}
