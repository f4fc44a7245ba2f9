//! Metal of coins, by colour or, in a gray picture, by comparison with the other coins.

use image::RgbImage;

use upm_core::geometry::Vec2;
use upm_perception::vision::DetectedDisc;

/// Warmth (see [`warmth`]) of the two metals: copper above the first, silver below the second; brass is between them.
const COPPER: f64 = 0.19;
const SILVER: f64 = 0.12;
/// Level, as a share of the plate's, below which a coin is painted or seen against the light, so that no metal is
/// visible.
const BLACK: f64 = 0.25;
/// Difference in level below which the two metals are alike and copper contradicts its name, and the least amount by
/// which the other metal's level must be nearer for a coin to contradict its name.
const SAME_LEVEL: f64 = 0.05;
/// Number of directions in which face and surrounding plate are sampled, and the distances from the centre, in radii.
const TURNS: usize = 24;
const FACE: [f64; 3] = [0.25, 0.5, 0.7];
const AROUND: [f64; 3] = [1.2, 1.3, 1.4];

/// Metal of a coin as seen in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Metal {
    Copper,
    Silver,
}

/// Metal of a coin with this name.
pub(super) fn metal_of(kind: &str) -> Option<Metal> {
    match kind {
        "penny" => Some(Metal::Copper),
        "nickel" | "dime" | "quarter" => Some(Metal::Silver),
        _ => None,
    }
}

/// For each disc, true if its tone contradicts the metal of its name.
pub(super) fn contradicted(named: &[(Option<Metal>, &DetectedDisc)], colors: Option<&RgbImage>) -> Vec<bool> {
    match colors {
        Some(colors) => {
            named.iter().map(|(metal, disc)| metal.is_some() && *metal != seen_metal(colors, disc)).collect()
        }
        None => by_level(named),
    }
}

/// Metal that a disc shows; `None` for brass.
fn seen_metal(colors: &RgbImage, disc: &DetectedDisc) -> Option<Metal> {
    match warmth(colors, disc) {
        warmth if warmth > COPPER => Some(Metal::Copper),
        warmth if warmth < SILVER => Some(Metal::Silver),
        _ => None,
    }
}

/// How much less green than red a face is, white-balanced on the plate around it.
fn warmth(colors: &RgbImage, disc: &DetectedDisc) -> f64 {
    let [face, around] = [FACE, AROUND].map(|radii| {
        let place = |k: usize, radius: f64| {
            let (sin, cos) = (k as f64 / TURNS as f64 * std::f64::consts::TAU).sin_cos();
            disc.center_px + Vec2::new(cos, sin) * (radius * disc.radius_px)
        };
        let places = radii.into_iter().flat_map(|radius| (0..TURNS).map(move |k| place(k, radius)));
        let seen: Vec<[u8; 3]> = places.filter_map(|at| pixel(colors, at)).collect();
        [0, 1].map(|channel| median(seen.iter().map(|rgb| f64::from(rgb[channel]))).max(1.0))
    });
    1.0 - (face[1] / around[1]) / (face[0] / around[0])
}

fn pixel(colors: &RgbImage, at: Vec2) -> Option<[u8; 3]> {
    let inside = at.x >= 0.0 && at.y >= 0.0;
    inside.then(|| colors.get_pixel_checked(at.x.round() as u32, at.y.round() as u32).map(|rgb| rgb.0))?
}

fn by_level(named: &[(Option<Metal>, &DetectedDisc)]) -> Vec<bool> {
    let level_of = |metal: Metal| {
        let levels: Vec<f64> = named.iter().filter(|(m, _)| *m == Some(metal)).map(|(_, disc)| disc.level).collect();
        (!levels.is_empty()).then(|| median(levels.into_iter()))
    };
    let (Some(copper), Some(silver)) = (level_of(Metal::Copper), level_of(Metal::Silver)) else {
        return vec![false; named.len()];
    };
    let contradicted = |(metal, disc): &(Option<Metal>, &DetectedDisc)| {
        let (own, other) = match metal {
            Some(Metal::Copper) => (copper, silver),
            Some(Metal::Silver) => (silver, copper),
            None => return false,
        };
        let alike = (own - other).abs() < SAME_LEVEL && *metal == Some(Metal::Copper);
        let nearer = (disc.level - own).abs() > (disc.level - other).abs() + SAME_LEVEL;
        disc.level > BLACK && (alike || nearer)
    };
    named.iter().map(contradicted).collect()
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    fn disc(at: f64, level: f64) -> DetectedDisc {
        let center_px = Vec2::new(at, 30.0);
        let (radius_px, radius_m, at_m) = (15.0, 0.01, Vec2::zeros());
        DetectedDisc {
            center_px,
            radius_px,
            at_m,
            radius_m,
            outline_share: 1.0,
            crispness: 1.0,
            level,
            covariance_px2: Default::default(),
        }
    }

    #[test]
    fn copper_and_silver_are_distinguished_by_colour_under_any_white() {
        for white in [[230.0, 230.0, 230.0], [240.0, 200.0, 150.0], [120.0, 140.0, 170.0]] {
            let colors = RgbImage::from_fn(180, 60, |x, y| {
                let on = |at: f64| (f64::from(x) - at).hypot(f64::from(y) - 30.0) <= 15.0;
                let share = match () {
                    () if on(30.0) => [0.68, 0.45, 0.33],
                    () if on(90.0) => [0.66, 0.66, 0.67],
                    () if on(150.0) => [0.76, 0.65, 0.4],
                    () => [1.0; 3],
                };
                Rgb([0, 1, 2].map(|c| (white[c] * share[c]) as u8))
            });
            let metals = [30.0, 90.0, 150.0].map(|at| seen_metal(&colors, &disc(at, 0.6)));
            assert_eq!(metals, [Some(Metal::Copper), Some(Metal::Silver), None], "{white:?}");
        }
    }

    #[test]
    fn gray_coin_with_the_level_of_the_other_metal_is_contradicted() {
        let [copper, silver] = [Some(Metal::Copper), Some(Metal::Silver)];
        let discs = [0.5, 0.51, 0.7, 0.7, 0.69, 0.5].map(|level| disc(30.0, level));
        let metals = [copper, copper, copper, silver, silver, silver];
        let named: Vec<_> = metals.into_iter().zip(&discs).collect();
        assert_eq!(contradicted(&named, None), [false, false, true, false, false, true]);
        let black = [0.1, 0.1].map(|level| disc(30.0, level));
        let named: Vec<_> = [copper, silver].into_iter().zip(&black).collect();
        assert_eq!(contradicted(&named, None), [false, false], "painted parts have no metal");
    }
}
