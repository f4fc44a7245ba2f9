//! Colours of the parts of a job: a range of hues for each kind, and one of them for each part.

use std::collections::BTreeMap;

/// Kinds whose hue is the same in every job, degrees in OKLCH: those of the operator page.
const COINS: [(&str, f64); 4] = [("penny", 60.0), ("nickel", 255.0), ("dime", 315.0), ("quarter", 180.0)];

/// Hues of the first other kinds, in the order of their names. Each further kind has the middle of the largest gap.
const OTHERS: [f64; 4] = [5.0, 105.0, 145.0, 285.0];

/// Share of the hues that parts use; the rest separates the kinds.
const USED: f64 = 0.8;

/// Farthest hue of a part from that of its kind where there are several, degrees: parts look like their bin.
const FARTHEST_DEG: f64 = 45.0;

/// Least share of the gap between the hues of two neighbouring kinds that each of them gets.
const LEAST_SHARE: f64 = 0.25;

/// Distances between the hues of a kind's parts, degrees, at which one lightness is enough, and at which three are.
const ONE_LIGHTNESS_DEG: f64 = 25.0;
const THREE_LIGHTNESSES_DEG: f64 = 10.0;

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
    /// Lightness of neighbouring hues in turn, OKLCH: the first, the first three or all, the closer the hues the more.
    fn lightness(self) -> [f64; 7] {
        match self {
            Self::Dark => [0.76, 0.69, 0.84, 0.725, 0.80, 0.88, 0.63],
            Self::Light => [0.54, 0.45, 0.62, 0.495, 0.58, 0.67, 0.40],
        }
    }
}

/// Colours of parts and of their kinds. The ranges of hues of two kinds do not overlap. The colours of any two of up to
/// 24 parts of up to 12 kinds differ by 6 of 255 or more in red, green or blue.
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
        for (kind, [from, to]) in ranges(&hues, kinds) {
            let members: Vec<usize> = (0..kinds.len()).filter(|&i| kinds[i] == kind).collect();
            let count = members.len();
            let levels = match (to - from) / count as f64 {
                _ if count == 1 => 1,
                apart_deg if apart_deg >= ONE_LIGHTNESS_DEG => 1,
                apart_deg if apart_deg >= THREE_LIGHTNESSES_DEG => 3,
                _ => ground.lightness().len(),
            };
            let stride = coprime_near(STEP * count as f64, count);
            for (k, &i) in members.iter().enumerate() {
                let slot = k * stride % count;
                let hue = from + (to - from) * (slot as f64 + 0.5) / count as f64;
                parts[i] = rgb_of(ground.lightness()[slot % levels], hue);
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

    /// Red, green and blue of a bin for parts of `kinds`: those of its kind; `None` for a bin of several.
    pub fn of_bin(&self, kinds: &[String]) -> Option<[u8; 3]> {
        match kinds {
            [kind] => self.kind(kind),
            _ => None,
        }
    }
}

/// Each kind once, with its hue, degrees.
fn hues_of<'a>(kinds: &[&'a str]) -> BTreeMap<&'a str, f64> {
    let mut hues: BTreeMap<&str, f64> = kinds.iter().map(|&kind| (kind, 0.0)).collect();
    let mut taken: Vec<f64> = COINS.map(|(_, hue)| hue).to_vec();
    let mut first = OTHERS.into_iter();
    for (kind, hue) in &mut hues {
        let coin = COINS.into_iter().find(|(name, _)| name == kind);
        *hue = match coin {
            Some((_, hue)) => hue,
            None => {
                let other = first.next().unwrap_or_else(|| middle_of_largest_gap(&mut taken));
                taken.push(other);
                other
            }
        };
    }
    hues
}

/// Middle of the largest gap between hues, degrees; sorts them.
fn middle_of_largest_gap(hues: &mut [f64]) -> f64 {
    hues.sort_by(f64::total_cmp);
    let gap = |i: usize| (hues[(i + 1) % hues.len()] - hues[i]).rem_euclid(360.0);
    // the first of equal gaps
    let largest = (0..hues.len()).rev().max_by(|&a, &b| gap(a).total_cmp(&gap(b)));
    largest.map_or(0.0, |i| (hues[i] + 0.5 * gap(i)).rem_euclid(360.0))
}

/// Range of hues of each kind of `parts`, degrees, from and to: a share of the way to the next hue on either side that
/// grows with the number of its parts, reduced to [`USED`], up to [`FARTHEST_DEG`]. A single kind has all hues.
fn ranges<'a>(hues: &BTreeMap<&'a str, f64>, parts: &[&str]) -> Vec<(&'a str, [f64; 2])> {
    let mut sorted: Vec<(&str, f64)> = hues.iter().map(|(&kind, &hue)| (kind, hue.rem_euclid(360.0))).collect();
    sorted.sort_by(|a, b| a.1.total_cmp(&b.1));
    let count = sorted.len();
    if let [(kind, hue)] = sorted[..] {
        return vec![(kind, [hue - 180.0, hue + 180.0])];
    }
    let number = |kind: &str| parts.iter().filter(|&&other| other == kind).count() as f64;
    let share =
        |kind: &str, next: &str| (number(kind) / (number(kind) + number(next))).clamp(LEAST_SHARE, 1.0 - LEAST_SHARE);
    let range = |i: usize| {
        let ((kind, hue), before, after) = (sorted[i], sorted[(i + count - 1) % count], sorted[(i + 1) % count]);
        let back = USED * share(kind, before.0) * (hue - before.1).rem_euclid(360.0);
        let ahead = USED * share(kind, after.0) * (after.1 - hue).rem_euclid(360.0);
        (kind, [hue - back.min(FARTHEST_DEG), hue + ahead.min(FARTHEST_DEG)])
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
    use super::*;
    use proptest::prelude::*;

    /// Largest difference of two colours in red, green or blue.
    fn difference(a: [u8; 3], b: [u8; 3]) -> u8 {
        (0..3).map(|i| a[i].abs_diff(b[i])).max().unwrap_or(0)
    }

    fn least_difference(colors: &[[u8; 3]]) -> u8 {
        let pairs = colors.iter().enumerate().flat_map(|(i, &a)| colors[..i].iter().map(move |&b| difference(a, b)));
        pairs.min().unwrap_or(u8::MAX)
    }

    #[test]
    fn parts_of_one_kind_use_all_hues_and_neighbours_differ_most() {
        let palette = Palette::of(&["penny"; 24], Ground::Dark);
        for pair in palette.parts().windows(2) {
            assert!(difference(pair[0], pair[1]) > 60, "{pair:?}");
        }
        assert_eq!(palette.kind("penny"), Palette::of(&["penny"], Ground::Dark).kind("penny"));
        assert_eq!(palette.kind("dime"), None);
    }

    #[test]
    fn bin_has_the_colour_of_its_kind() {
        let palette = Palette::of(&["penny", "dime"], Ground::Light);
        let bin = |kinds: &[&str]| palette.of_bin(&kinds.iter().map(|&kind| kind.to_owned()).collect::<Vec<_>>());
        assert_eq!(bin(&["dime"]), palette.kind("dime"));
        assert_eq!([bin(&["penny", "dime"]), bin(&["nut"]), bin(&[])], [None; 3]);
    }

    const KINDS: [&str; 16] =
        ["penny", "nickel", "dime", "quarter", "nut", "ring", "a", "b", "c", "d", "e", "f", "g", "h", "i", "j"];

    /// Up to 24 parts of up to 12 kinds, more or less evenly spread over them.
    fn parts() -> impl Strategy<Value = Vec<&'static str>> {
        let kinds = proptest::sample::subsequence(KINDS.to_vec(), 1..=12);
        (kinds, proptest::collection::vec((0..12usize, any::<bool>()), 12), any::<bool>()).prop_map(
            |(kinds, further, is_even)| {
                let further = further.into_iter().map(|(i, other)| if is_even || other { i } else { 0 });
                let further: Vec<&str> = further.map(|i| kinds[i % kinds.len()]).collect();
                [kinds, further].concat()
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(512))]

        #[test]
        fn colours_of_parts_differ_and_hue_ranges_of_kinds_do_not_overlap(kinds in parts(), light: bool) {
            let palette = Palette::of(&kinds, if light { Ground::Light } else { Ground::Dark });
            let least = least_difference(palette.parts());
            prop_assert!(least >= 6, "{least} for {kinds:?}");
            let all = ranges(&hues_of(&kinds), &kinds);
            for (i, (kind, [_, to])) in all.iter().enumerate().filter(|_| all.len() > 1) {
                let (next, [from, _]) = all[(i + 1) % all.len()];
                prop_assert!((from - to).rem_euclid(360.0) < 360.0 - 2.0 * FARTHEST_DEG, "{kind} overlaps {next}");
            }
        }
    }
}
