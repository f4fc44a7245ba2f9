//! Estimates the plate's side from the sizes of the discs on it, where neither command line nor rig gives it.

use serde::Serialize;

use upm_core::rig::PartKind;
use upm_perception::vision::DetectedDisc;

/// Relative difference in diameter below which discs are of one kind.
const ONE_KIND: f64 = 0.02;
/// Relative deviation within which a size fits a kind; also the difference below which two scales, or the side found
/// and the one assumed, are equal.
const FITS: f64 = 0.015;
/// Relative deviation within which a size fits a kind once the scale is fitted; shadows make a coin appear a few
/// percent larger.
const FITS_AT_LAST: f64 = 0.008;
/// Most discs of one size that count, and the factor by which a scale's weight must exceed all others for it to be
/// chosen.
const MOST_WEIGHT: usize = 3;
const CLEARLY_MORE: f64 = 1.3;
/// Least visible share of the outline, and least sharpness of it, for discs that the scale is estimated from.
const LEAST_SHARE: f64 = 0.55;
const LEAST_CRISPNESS: f64 = 0.45;

/// Source of a plate's side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum SideSource {
    /// The command line.
    Given,
    Rig,
    /// Three or more kinds of parts, or two on the papers' plate, whose ratios leave one scale.
    Parts,
    /// Two kinds of parts, whose ratio leaves one scale.
    TwoKinds,
    /// No information: the papers' plate is assumed.
    Assumed,
}

/// A plate's side that agrees with the discs.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SideCandidate {
    pub side_m: f64,
    /// Indices of the kinds that the discs have on such a plate.
    pub kinds: Vec<usize>,
}

/// The plate's side and its source.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PlateSide {
    pub side_m: f64,
    pub source: SideSource,
    /// For an assumed side: the sides that agree with the discs.
    pub candidates: Vec<SideCandidate>,
}

impl PlateSide {
    pub fn known(side_m: f64, source: SideSource) -> Self {
        Self { side_m, source, candidates: Vec::new() }
    }

    /// Estimates the side from discs measured on a plate assumed to have the side `assumed_m`.
    pub fn from_discs(discs: &[DetectedDisc], assumed_m: f64, kinds: &[PartKind]) -> Self {
        let sizes = sizes(discs);
        let mut scales: Vec<ImageScale> = Vec::new();
        for (size, _) in &sizes {
            for kind in kinds {
                let scale = ImageScale::fitted(2.0 * kind.radius_m / size, &sizes, kinds);
                let same = |other: &ImageScale| (other.factor / scale.factor - 1.0).abs() < FITS;
                match scales.iter_mut().find(|other| same(other)) {
                    Some(other) if scale.rank() > other.rank() => *other = scale,
                    Some(_) => {}
                    None => scales.push(scale),
                }
            }
        }
        scales.sort_by(|a, b| b.rank().cmp(&a.rank()).then(a.factor.ln().abs().total_cmp(&b.factor.ln().abs())));
        let candidate =
            |scale: &ImageScale| SideCandidate { side_m: scale.factor * assumed_m, kinds: scale.kinds.clone() };
        let most = scales.first().map_or(0, |scale| scale.weight);
        let as_good = |scale: &&ImageScale| scale.weight as f64 * CLEARLY_MORE > most as f64;
        let best: Vec<&ImageScale> = scales.iter().filter(as_good).collect();
        match best.as_slice() {
            [only] if only.kinds.len() >= 2 => {
                let is_assumed = (only.factor - 1.0).abs() < FITS;
                let side_m = if is_assumed { assumed_m } else { only.factor * assumed_m };
                let source = if is_assumed || only.kinds.len() > 2 { SideSource::Parts } else { SideSource::TwoKinds };
                Self::known(side_m, source)
            }
            several => Self {
                side_m: assumed_m,
                source: SideSource::Assumed,
                candidates: several.iter().map(|scale| candidate(scale)).collect(),
            },
        }
    }
}

/// A scale factor under which sizes of discs agree with kinds.
struct ImageScale {
    factor: f64,
    /// Indices of the kinds that some size fits.
    kinds: Vec<usize>,
    /// Number of discs of those sizes, up to [`MOST_WEIGHT`] of each.
    weight: usize,
}

impl ImageScale {
    /// Best-fitting scale near `factor`.
    fn fitted(factor: f64, sizes: &[(f64, usize)], kinds: &[PartKind]) -> Self {
        let near = Self::matching(factor, FITS, sizes, kinds);
        Self::matching(near.factor, FITS_AT_LAST, sizes, kinds)
    }

    /// Kinds within `fits` of a size under `factor`, and the mean scale of those sizes.
    fn matching(factor: f64, fits: f64, sizes: &[(f64, usize)], kinds: &[PartKind]) -> Self {
        let (mut found, mut weight, mut discs, mut sum) = (Vec::new(), 0, 0, 0.0);
        for (size, count) in sizes {
            let is_near = |kind: &PartKind| (factor * size / (2.0 * kind.radius_m) - 1.0).abs() < fits;
            if let Some((i, kind)) = kinds.iter().enumerate().find(|(_, kind)| is_near(kind)) {
                found.push(i);
                discs += count;
                weight += (*count).min(MOST_WEIGHT);
                sum += *count as f64 * 2.0 * kind.radius_m / size;
            }
        }
        found.sort_unstable();
        found.dedup();
        Self { factor: if discs > 0 { sum / discs as f64 } else { factor }, kinds: found, weight }
    }

    fn rank(&self) -> (usize, usize) {
        (self.weight, self.kinds.len())
    }
}

/// Diameters that discs have in common, m, and the number of discs with each.
fn sizes(discs: &[DetectedDisc]) -> Vec<(f64, usize)> {
    let clear = |disc: &&DetectedDisc| disc.outline_share >= LEAST_SHARE && disc.crispness >= LEAST_CRISPNESS;
    let mut diameters: Vec<f64> = discs.iter().filter(clear).map(|disc| 2.0 * disc.radius_m).collect();
    diameters.sort_by(f64::total_cmp);
    let alike = diameters.chunk_by(|a, b| b / a - 1.0 < ONE_KIND);
    alike.filter_map(|alike| alike.get(alike.len() / 2).map(|middle| (*middle, alike.len()))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::Vec2;

    fn coins() -> Vec<PartKind> {
        [("penny", 19.05), ("nickel", 21.21), ("dime", 17.91), ("quarter", 24.26)]
            .map(|(name, mm)| PartKind { name: name.into(), radius_m: mm * 5e-4, thickness_m: 1.5e-3 })
            .into()
    }

    /// Test data: discs of these diameters, mm, as measured on a plate of `side_mm` that is assumed to have 200 mm.
    fn seen(diameters_mm: &[f64], side_mm: f64) -> Vec<DetectedDisc> {
        let disc = |mm: &f64| DetectedDisc {
            center_px: Vec2::zeros(),
            radius_px: 40.0,
            at_m: Vec2::zeros(),
            radius_m: mm * 5e-4 * 200.0 / side_mm,
            outline_share: 1.0,
            crispness: 1.0,
            level: 0.5,
            covariance_px2: Default::default(),
        };
        diameters_mm.iter().map(disc).collect()
    }

    #[test]
    fn any_two_coin_kinds_determine_the_plate_side() {
        let kinds = coins();
        for (i, a) in kinds.iter().enumerate() {
            for b in &kinds[..i] {
                for side_mm in [120.0, 290.0, 433.0] {
                    let [a, b] = [a, b].map(|kind| 2e3 * kind.radius_m);
                    let found = PlateSide::from_discs(&seen(&[a * 1.003, a, b, b * 0.998], side_mm), 0.2, &kinds);
                    assert_eq!(found.source, SideSource::TwoKinds, "{a} and {b} on {side_mm}: {found:?}");
                    assert!((found.side_m * 1e3 / side_mm - 1.0).abs() < 0.006, "{a} and {b} on {side_mm}: {found:?}");
                }
            }
        }
    }

    #[test]
    fn coins_of_one_kind_with_shadows_are_not_two_kinds() {
        let found = PlateSide::from_discs(&seen(&[24.26, 24.3, 25.2, 25.25], 225.0), 0.2, &coins());
        assert_eq!(found.source, SideSource::Assumed, "{found:?}");
    }

    #[test]
    fn one_kind_leaves_a_side_for_every_coin() {
        let found = PlateSide::from_discs(&seen(&[24.26; 3], 250.0), 0.2, &coins());
        assert_eq!((found.source, found.candidates.len()), (SideSource::Assumed, 4));
        assert_eq!(found.side_m, 0.2);
        assert!(found.candidates.iter().any(|side| (side.side_m - 0.25).abs() < 1e-4 && side.kinds == [3]));
    }

    #[test]
    fn foreign_coins_among_known_ones_do_not_change_the_side() {
        let found = PlateSide::from_discs(&seen(&[19.05, 17.91, 24.26, 30.61, 23.25, 16.25], 150.0), 0.2, &coins());
        assert_eq!(found.source, SideSource::Parts);
        assert!((found.side_m - 0.15).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn no_disc_leaves_the_assumed_side_without_candidates() {
        let found = PlateSide::from_discs(&[], 0.2, &coins());
        assert_eq!(found, PlateSide { side_m: 0.2, source: SideSource::Assumed, candidates: Vec::new() });
    }
}
