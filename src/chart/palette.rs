//! Colours of the parts of a job: a range of hues for each kind, and one of them for each part.

use std::collections::BTreeMap;

/// Kinds whose hue is the same in every job, degrees in OKLCH: those of the operator page.
const COINS: [(&str, f64); 4] = [("penny", 60.0), ("nickel", 255.0), ("dime", 315.0), ("quarter", 180.0)];

/// Hues of other kinds, in the order of their names; repeated as needed.
const OTHERS: [f64; 4] = [5.0, 105.0, 145.0, 285.0];

/// Share of a kind's range of hues that its parts use; the rest separates it from the next kind's.
const USED: f64 = 0.7;

/// Chroma in OKLCH; less where the display cannot show it.
const CHROMA: f64 = 0.15;

/// Step from one part's hue to the next one's, as a share of the range: parts with neighbouring numbers often lie next
/// to each other and differ most.
const STEP: f64 = 0.382;

/// Brightness of what is drawn on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ground {
    /// A dark view.
    Dark,
    /// White paper.
    Light,
}

impl Ground {
    /// Lightness of neighbouring hues in turn, OKLCH.
    fn lightness(self) -> [f64; 3] {
        match self {
            Self::Dark => [0.76, 0.69, 0.84],
            Self::Light => [0.54, 0.45, 0.62],
        }
    }
}

/// Colours of parts and of their kinds. No two parts have the same colour, and the hues of a kind's parts are nearer to
/// its hue than to another kind's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Palette {
    parts: Vec<[u8; 3]>,
    kinds: BTreeMap<String, [u8; 3]>,
}

impl Palette {
    /// The colours of parts of these kinds on `ground`.
    pub fn of(kinds: &[&str], ground: Ground) -> Self {
        let hues = hues_of(kinds);
        let [usual, ..] = ground.lightness();
        let mut parts = vec![[0; 3]; kinds.len()];
        for (kind, [from, to]) in ranges(&hues) {
            let members: Vec<usize> = (0..kinds.len()).filter(|&i| kinds[i] == kind).collect();
            let count = members.len();
            let stride = coprime_near(STEP * count as f64, count);
            for (k, &i) in members.iter().enumerate() {
                let slot = k * stride % count;
                let hue = from + (to - from) * (slot as f64 + 0.5) / count as f64;
                let lightness = if count > 3 { ground.lightness()[slot % 3] } else { usual };
                parts[i] = rgb_of(lightness, hue);
            }
        }
        let kinds = hues.into_iter().map(|(kind, hue)| (kind.to_owned(), rgb_of(usual, hue))).collect();
        Self { parts, kinds }
    }

    /// Red, green and blue of each part.
    pub fn parts(&self) -> &[[u8; 3]] {
        &self.parts
    }

    /// Red, green and blue of a kind of the job; `None` for another.
    pub fn kind(&self, name: &str) -> Option<[u8; 3]> {
        self.kinds.get(name).copied()
    }
}

/// Each kind once, with its hue, degrees.
fn hues_of<'a>(kinds: &[&'a str]) -> BTreeMap<&'a str, f64> {
    let mut hues: BTreeMap<&str, f64> = kinds.iter().map(|&kind| (kind, 0.0)).collect();
    let mut others = OTHERS.into_iter().cycle().enumerate();
    for (kind, hue) in &mut hues {
        let coin = COINS.into_iter().find(|(name, _)| name == kind);
        // a second round of hues lies between those of the first
        let next = others.by_ref();
        *hue = match coin {
            Some((_, hue)) => hue,
            None => next.next().map_or(0.0, |(i, hue)| hue + 20.0 * (i / OTHERS.len()) as f64),
        };
    }
    hues
}

/// Range of hues of each kind, degrees, from and to: half the way to the next hue on either side, reduced to [`USED`].
/// A single kind has all hues.
fn ranges<'a>(hues: &BTreeMap<&'a str, f64>) -> Vec<(&'a str, [f64; 2])> {
    let mut sorted: Vec<(&str, f64)> = hues.iter().map(|(&kind, &hue)| (kind, hue.rem_euclid(360.0))).collect();
    sorted.sort_by(|a, b| a.1.total_cmp(&b.1));
    let count = sorted.len();
    if let [(kind, hue)] = sorted[..] {
        return vec![(kind, [hue - 180.0, hue + 180.0])];
    }
    let range = |i: usize| {
        let (kind, hue) = sorted[i];
        let before = (hue - sorted[(i + count - 1) % count].1).rem_euclid(360.0);
        let after = (sorted[(i + 1) % count].1 - hue).rem_euclid(360.0);
        (kind, [hue - 0.5 * USED * before, hue + 0.5 * USED * after])
    };
    (0..count).map(range).collect()
}

/// The number nearest to `wish` that has no divisor in common with `count`, at least 1.
fn coprime_near(wish: f64, count: usize) -> usize {
    let divisor = |a: usize, b: usize| (1..=a.min(b)).rev().find(|&d| a.is_multiple_of(d) && b.is_multiple_of(d));
    let distance = |&step: &usize| ((step as f64 - wish).abs() * 1e6) as u64;
    (1..=count.max(1)).filter(|&step| divisor(step, count.max(1)) == Some(1)).min_by_key(distance).unwrap_or(1)
}

/// Red, green and blue of a colour in OKLCH (Ottosson, 2020), with less chroma where the display cannot show it.
fn rgb_of(lightness: f64, hue_deg: f64) -> [u8; 3] {
    let (sin, cos) = hue_deg.to_radians().sin_cos();
    let shown = (0..=20).map(|k| linear_rgb(lightness, CHROMA * (1.0 - 0.05 * f64::from(k)), cos, sin));
    let within = |rgb: &[f64; 3]| rgb.iter().all(|part| (0.0..=1.0).contains(part));
    let rgb = shown.into_iter().find(within).unwrap_or([lightness.powi(3); 3]);
    rgb.map(|part| {
        let curved = if part <= 0.003_130_8 { 12.92 * part } else { 1.055 * part.powf(1.0 / 2.4) - 0.055 };
        (255.0 * curved).round() as u8
    })
}

fn linear_rgb(lightness: f64, chroma: f64, cos: f64, sin: f64) -> [f64; 3] {
    let (a, b) = (chroma * cos, chroma * sin);
    let l = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let m = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let s = (lightness - 0.089_484_177_5 * a - 1.291_485_548 * b).powi(3);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701 * s,
    ]
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use proptest::prelude::*;

    #[test]
    fn parts_of_one_kind_use_all_hues_and_neighbours_differ_most() {
        let palette = Palette::of(&["penny"; 24], Ground::Dark);
        let distance = |a: [u8; 3], b: [u8; 3]| (0..3).map(|i| a[i].abs_diff(b[i])).max().unwrap_or(0);
        for pair in palette.parts().windows(2) {
            assert!(distance(pair[0], pair[1]) > 60, "{pair:?}");
        }
        assert_eq!(palette.kind("penny"), Palette::of(&["penny"], Ground::Dark).kind("penny"));
        assert_eq!(palette.kind("dime"), None);
    }

    #[test]
    fn a_kind_has_its_hue_whatever_the_other_kinds_are() {
        let of = |kinds: &[&str]| Palette::of(kinds, Ground::Light).kind("quarter").unwrap();
        assert_eq!(of(&["quarter"]), of(&["penny", "quarter", "washer"]));
        let [r, g, b] = of(&["quarter"]);
        assert!(g > r && b > r, "teal: {r} {g} {b}");
    }

    proptest! {
        #[test]
        fn no_two_parts_look_alike_and_kinds_keep_apart(
            kinds in proptest::collection::vec(proptest::sample::select(vec!["penny", "dime", "quarter", "nut", "ring"]), 1..25),
            light: bool,
        ) {
            let palette = Palette::of(&kinds, if light { Ground::Light } else { Ground::Dark });
            prop_assert_eq!(palette.parts().iter().collect::<BTreeSet<_>>().len(), kinds.len());
            let hues = hues_of(&kinds);
            let all = ranges(&hues);
            for (kind, [from, to]) in &all {
                for (other, hue) in hues.iter().filter(|(other, _)| *other != kind) {
                    let inside = (hue - from).rem_euclid(360.0) < to - from;
                    prop_assert!(!inside, "{other} lies in the hues of {kind}");
                }
            }
        }
    }
}
