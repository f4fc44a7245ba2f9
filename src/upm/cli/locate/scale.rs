//! Scale of a picture from the sizes of the discs in it.
//!
//! The outline of a part is that of its foot and its top: the larger, the farther the part is from the point below the
//! camera and the nearer the camera. Where the camera's distance is not known well, sizes that depend on the place give
//! it, too.

use serde::Serialize;

use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_perception::vision::{DetectedDisc, Table, seen_outline_m};

/// Relative deviation within which a disc fits a kind: at first, and once the scale is fitted.
const FITS: [f64; 6] = [0.025, 0.025, 0.02, 0.015, 0.012, 0.012];
/// Relative difference below which two scales are the same.
const SAME: f64 = 0.015;
/// Width of a coin's raised border at most, as a share of its radius.
const BORDER: f64 = 0.1;
/// Standard deviation of a measured size, relative.
const SIZE_SD: f64 = 0.003;
/// Root mean square deviation of the sizes of parts that agree with each other, relative.
const AGREE: f64 = 0.006;
/// Most discs of one kind that count, and the factor by which a scale's weight must exceed all others for it to be
/// chosen.
const MOST_WEIGHT: usize = 3;
const CLEARLY_MORE: f64 = 1.3;
/// Least visible share of the outline, and least sharpness of it, for discs that the scale is estimated from.
const LEAST_SHARE: f64 = 0.6;
const LEAST_CRISPNESS: f64 = 0.45;
/// Sharpness from which on a rim is that of the coin for sure.
pub(super) const SHARP: f64 = 0.57;

/// Source of a picture's scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum ScaleSource {
    /// The command line.
    Given,
    Rig,
    /// One part whose kind the command line names.
    Part,
    /// Three or more kinds of parts, whose ratios leave one scale.
    Parts,
    /// Two kinds of parts, whose ratio leaves one scale.
    TwoKinds,
    /// No information: the papers' plate is assumed.
    Assumed,
}

/// Source of the scale, and what speaks against it.
pub(super) struct PictureScale {
    pub source: ScaleSource,
    pub doubt: Option<String>,
}

impl PictureScale {
    /// Factor on scores: lower if it is uncertain, much lower if it is a guess.
    pub(super) fn trust(&self) -> f64 {
        match self.source {
            ScaleSource::Assumed => 0.5,
            source if self.doubt.is_some() || source == ScaleSource::TwoKinds => 0.9,
            _ => 1.0,
        }
    }
}

/// A scale under which sizes of discs agree with kinds.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ScaleFit {
    /// Factor on the lengths of the provisional table.
    pub factor: f64,
    /// Factor on its camera's focal length.
    pub focal: f64,
    /// Indices of the kinds that discs fit.
    pub kinds: Vec<usize>,
    /// Root mean square deviation of those discs' sizes, relative.
    pub off: f64,
    /// Number of those discs, up to [`MOST_WEIGHT`] of each kind, and of those kinds.
    rank: (usize, usize),
}

impl ScaleFit {
    /// That scale, without any discs.
    pub(super) fn of(factor: f64) -> Self {
        Self { factor, focal: 1.0, kinds: Vec::new(), off: 0.0, rank: (0, 0) }
    }
}

/// Discs on a table of a provisional size, and what they may be.
pub(super) struct Sizes<'a> {
    pub table: &'a Table,
    pub discs: &'a [DetectedDisc],
    pub kinds: &'a [PartKind],
    /// Relative standard deviation of the focal length that the table was made with.
    pub focal_sd: f64,
}

impl Sizes<'_> {
    /// The scales that agree best with the discs; with those of a `kind` alone if one is given.
    pub(super) fn scales(&self, kind: Option<usize>) -> Vec<ScaleFit> {
        let clear = |disc: &&DetectedDisc| disc.outline_share >= LEAST_SHARE && disc.crispness >= LEAST_CRISPNESS;
        let discs: Vec<&DetectedDisc> = self.discs.iter().filter(clear).collect();
        let starts = self.kinds.iter().enumerate().filter(|(i, _)| kind.is_none_or(|kind| kind == *i));
        let starts = starts.flat_map(|(_, start)| discs.iter().map(|disc| start.radius_m / disc.radius_m));
        let mut fits: Vec<ScaleFit> =
            starts.map(|factor| self.fitted(factor, &discs, [true, kind.is_none()])).collect();
        fits.retain(|fit| kind.is_none_or(|kind| fit.kinds.contains(&kind)));
        fits.sort_by(|a, b| b.rank.cmp(&a.rank).then(a.factor.total_cmp(&b.factor)));
        let most = fits.first().map_or(0, |fit| fit.rank.0);
        fits.retain(|fit| fit.rank.0 as f64 * CLEARLY_MORE > most as f64);
        let same = |a: &ScaleFit, b: &ScaleFit| (a.factor / b.factor - 1.0).abs() < SAME;
        (0..fits.len()).filter(|&i| !fits[..i].iter().any(|fit| same(fit, &fits[i]))).map(|i| fits[i].clone()).collect()
    }

    /// The scale under which the disc at a place, px, is a part of `kind`, and what speaks against it. Where parts of
    /// three kinds or more agree on another one, the inner edge of its raised border may have been taken for its rim.
    pub(super) fn part_scale(&self, kind: usize, at_px: Option<Vec2>) -> Result<(ScaleFit, Option<String>), String> {
        let name = &self.kinds[kind].name;
        let Some(at_px) = at_px else {
            let which = |_| format!("--scale-from: which disc is the {name}? {}", self.places());
            return <[ScaleFit; 1]>::try_from(self.scales(Some(kind))).map(|[fit]| (fit, None)).map_err(which);
        };
        let at = format!("{},{}", at_px.x, at_px.y);
        let off = |disc: &&DetectedDisc| (disc.center_px - at_px).norm() / disc.radius_px;
        let nearest = self.discs.iter().min_by(|a, b| off(a).total_cmp(&off(b))).filter(|disc| off(disc) < 1.0);
        let alone = Sizes { kinds: &self.kinds[kind..=kind], ..*self };
        let named = nearest.map(|disc| alone.fitted(self.kinds[kind].radius_m / disc.radius_m, &[disc], [true, false]));
        let agreed = <[ScaleFit; 1]>::try_from(self.scales(None)).ok().filter(|[fit]| fit.kinds.len() > 2);
        match (named, agreed) {
            (None, None) => Err(format!("--scale-from: no disc at {at}; {}", self.places())),
            (Some(named), None) => Ok((named, None)),
            (None, Some([fit])) => Ok((fit, Some(format!("no disc at {at}; the other parts give the scale")))),
            (Some(named), Some([fit])) => {
                let off = (fit.factor / named.factor - 1.0).abs();
                let doubt = format!("the {name} at {at} is {:.1} % off the other parts' scale", 100.0 * off);
                Ok((if off < BORDER { fit } else { named }, (off > SAME).then_some(doubt)))
            }
        }
    }

    /// Doubt about a scale that was found: sizes that differ, or rims that are those of shadows or of a blur.
    pub(super) fn doubt(&self, fit: &ScaleFit) -> Option<String> {
        let soft = self.discs.iter().filter(|disc| disc.crispness < SHARP).count() * 2 > self.discs.len();
        let off = || format!("the parts differ by {:.1} % from any one scale", 100.0 * fit.off);
        (fit.off > AGREE).then(off).or_else(|| soft.then(|| "the parts' rims are soft".to_owned()))
    }

    /// Places of discs, as `--scale-from` takes them.
    fn places(&self) -> String {
        const MOST: usize = 12;
        let at = |disc: &DetectedDisc| format!("{:.0},{:.0}", disc.center_px.x, disc.center_px.y);
        let places: Vec<String> = self.discs.iter().take(MOST).map(at).collect();
        if places.is_empty() { "no disc was found".to_owned() } else { format!("discs are at {}", places.join(" ")) }
    }

    /// Logarithm of the ratio by which height and side wall enlarge the outline of a part of `kind`.
    fn swelling(&self, disc: &DetectedDisc, kind: &PartKind, factor: f64) -> f64 {
        let [radius_m, thickness_m] = [kind.radius_m, kind.thickness_m].map(|length| length / factor);
        let kind = PartKind { name: String::new(), radius_m, thickness_m };
        libm::log(seen_outline_m(self.table, disc.at_m, &kind).1 / radius_m)
    }

    /// The scale near `factor`, fitted again and again to the discs that have the size of a kind: logarithms of their
    /// sizes are that of the scale and a multiple of the swelling, which is as uncertain as the focal length.
    pub(super) fn fitted(&self, factor: f64, discs: &[&DetectedDisc], [may_scale, may_refocus]: [bool; 2]) -> ScaleFit {
        let mut fit = ScaleFit::of(factor);
        let mut counts = vec![0; self.kinds.len()];
        for fits in FITS {
            let (mut sums, mut squares) = ([0.0f64; 5], 0.0);
            counts.fill(0);
            for disc in discs {
                let off = |kind: &PartKind| {
                    let swelling = self.swelling(disc, kind, fit.factor);
                    [libm::log(fit.factor * disc.radius_m / kind.radius_m), swelling]
                };
                let residual = |[size, swelling]: [f64; 2]| size - swelling / fit.focal;
                let all = self.kinds.iter().map(off).enumerate();
                let nearest = all.min_by(|a, b| residual(a.1).abs().total_cmp(&residual(b.1).abs()));
                if let Some((kind, [size, swelling])) = nearest.filter(|(_, of)| residual(*of).abs() < fits) {
                    counts[kind] += 1;
                    let terms = [1.0, swelling, swelling * swelling, size, swelling * size];
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
                    squares += residual([size, swelling]).powi(2);
                }
            }
            let [n, x, xx, y, xy] = sums;
            if n == 0.0 {
                break;
            }
            // normal equations of y = shift + gain x, with the gain known to be 1 within its deviation
            let prior = (SIZE_SD / self.focal_sd.max(1e-6)).powi(2);
            let [x_mean, y_mean] = if may_scale { [x / n, y / n] } else { [0.0; 2] };
            let gain = if may_refocus { (xy - x_mean * y + prior) / (xx - x_mean * x + prior) } else { 1.0 };
            let gain = gain.clamp(0.2, 3.0);
            fit.off = (squares / n).sqrt();
            fit.factor *= libm::exp(gain * x_mean - y_mean);
            fit.focal = 1.0 / gain;
        }
        fit.kinds = (0..counts.len()).filter(|&kind| counts[kind] > 0).collect();
        fit.rank = (counts.iter().map(|&count: &usize| count.min(MOST_WEIGHT)).sum(), fit.kinds.len());
        fit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::Lens;

    fn table(side_m: f64, focal_sides: f64) -> Table {
        let corners = [(150.0, 50.0), (850.0, 50.0), (850.0, 750.0), (150.0, 750.0)].map(|(x, y)| Vec2::new(x, y));
        Table::of_rectangle(corners, [side_m; 2], &Lens::centered([1000, 800], focal_sides), [0.01; 2]).unwrap()
    }

    #[test]
    fn heights_and_places_of_parts_give_scale_and_focal_length() {
        let kinds = [("penny", 19.05, 1.52), ("nickel", 21.21, 1.95), ("quarter", 24.26, 1.75)];
        let kinds = kinds.map(|(name, mm, thick_mm)| PartKind {
            name: name.into(),
            radius_m: mm * 5e-4,
            thickness_m: thick_mm * 1e-3,
        });
        let (truth, assumed) = (table(0.26, 0.75), table(0.2032, 1.2));
        let places = [(-0.09, 0.08), (0.01, 0.02), (0.1, -0.09), (0.05, 0.11), (-0.02, 0.0), (-0.11, -0.1)];
        let disc = |(i, (x, y)): (usize, (f64, f64))| {
            let (at_m, radius_m) = seen_outline_m(&truth, Vec2::new(x, y), &kinds[i % 3]);
            let (at_m, radius_m) = (at_m * (0.2032 / 0.26), radius_m * (0.2032 / 0.26));
            DetectedDisc { at_m, radius_m, center_px: at_m, radius_px: 40.0, outline_share: 1.0, crispness: 1.0 }
        };
        let discs: Vec<DetectedDisc> = places.into_iter().enumerate().map(disc).collect();
        let scales = Sizes { table: &assumed, discs: &discs, kinds: &kinds, focal_sd: 0.6 }.scales(None);
        let [fit] = &scales[..] else { panic!("{scales:?}") };
        assert!((fit.factor * 0.2032 / 0.26 - 1.0).abs() < 3e-3 && fit.kinds.len() == 3, "{fit:?}");
        assert!((fit.focal * 1.2 / 0.75 - 1.0).abs() < 0.25 && fit.off < 1e-3, "{fit:?}");
        // the inner edge of a border was taken for a rim: the other parts know better, and a doubt says so
        let mut inner = [discs.clone(), vec![discs[3].clone(); 2]].concat();
        (inner[0].radius_m, inner[0].radius_px) = (0.93 * inner[0].radius_m, 0.93 * inner[0].radius_px);
        let right_lens = table(0.2032, 0.75);
        let sizes = |discs| Sizes { table: &right_lens, discs, kinds: &kinds, focal_sd: 0.0 };
        let scale = |discs, place| sizes(discs).part_scale(0, place).unwrap();
        let [(right, none), (mended, some)] = [&discs, &inner].map(|all| scale(all, Some(all[0].center_px)));
        assert!(none.is_none() && (mended.factor / right.factor - 1.0).abs() < 5e-3, "{right:?} {mended:?}");
        assert!(some.unwrap().contains("7."), "{mended:?}");
        assert!(sizes(&discs).part_scale(0, Some(Vec2::new(1e4, 0.0))).unwrap().1.is_some());
        // one kind alone leaves a scale for every kind
        let pennies: Vec<DetectedDisc> = discs.iter().step_by(3).cloned().collect();
        assert!(Sizes { table: &assumed, discs: &pennies, kinds: &kinds, focal_sd: 0.0 }.scales(None).len() >= 3);
    }
}
