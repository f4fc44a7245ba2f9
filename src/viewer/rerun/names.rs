use re_sdk_types::archetypes::Points2D;
use re_sdk_types::components::Color;

use super::paint::{colors, thin};
use crate::types::PartAppearance;
use upm_chart::{LabelPlace, LabelledDisc, place_labels};

/// Size of a label of the viewer, in points of the screen: width of a letter, space beside the text, height, and the
/// distance from the point that the label hangs from to its middle.
const LETTER: f64 = 7.1;
const BESIDE: f64 = 8.0;
const HEIGHT: f64 = 22.0;
const HANGS: f64 = 12.0;

/// Size of a view on the first page in a window of 1280 by 800 points, in points of the screen.
pub(super) const PANEL: [f64; 2] = [560.0, 450.0];

/// Number of parts from which names are shortened: `penny-12` to `p12`.
const MANY: usize = 12;

/// Names of parts in one view, placed off the parts and off each other, each in its part's colour.
#[derive(Clone, Debug)]
pub(super) struct Names {
    texts: Vec<String>,
    colors: Vec<Color>,
    /// Lengths of the view that are one point of the screen.
    unit: f64,
    /// Bounds of the view, from and to along x and y.
    bounds: [[f64; 2]; 2],
    placed: Vec<LabelPlace>,
}

impl Names {
    /// Names in a view of these bounds on a panel of `panel` points of the screen. `ids` are the names of the parts,
    /// `kinds` those of their kinds.
    pub(super) fn new(
        (ids, kinds): (&[&str], &[&str]),
        rgb: &[[u8; 3]],
        bounds: [[f64; 2]; 2],
        panel: [f64; 2],
    ) -> Self {
        let texts =
            if ids.len() < MANY { ids.iter().map(|&id| id.to_owned()).collect() } else { shortened(ids, kinds) };
        let [unit_x, unit_y] = [0, 1].map(|axis| (bounds[axis][1] - bounds[axis][0]) / panel[axis]);
        Self { texts, colors: colors(rgb), unit: unit_x.max(unit_y), bounds, placed: Vec::new() }
    }

    /// The names of `parts`, as [`Names::new`].
    pub(super) fn of(parts: &[PartAppearance], rgb: &[[u8; 3]], bounds: [[f64; 2]; 2], panel: [f64; 2]) -> Self {
        let (ids, kinds): (Vec<&str>, Vec<&str>) =
            parts.iter().map(|part| (part.id.as_str(), part.kind.as_str())).unzip();
        Self::new((&ids, &kinds), rgb, bounds, panel)
    }

    /// The names beside discs, each a centre and a radius in the view.
    pub(super) fn beside(&mut self, discs: impl IntoIterator<Item = ([f32; 2], f32)>) -> Points2D {
        let places = self.places(discs);
        self.styled(Points2D::new(places))
    }

    /// The names without their places, for a whole recording.
    pub(super) fn without_places(&self) -> Points2D {
        self.styled(Points2D::update_fields())
    }

    /// Height of a label in the view.
    pub(super) fn label_height(&self) -> f64 {
        HEIGHT * self.unit
    }

    fn styled(&self, points: Points2D) -> Points2D {
        points
            .with_labels(self.texts.iter().map(String::as_str))
            .with_show_labels(true)
            .with_colors(self.colors.iter().copied())
            .with_radii([thin(0.1)])
    }

    /// Points that the names beside discs hang from.
    pub(super) fn places(&mut self, discs: impl IntoIterator<Item = ([f32; 2], f32)>) -> Vec<[f32; 2]> {
        let labelled = |(([x, y], radius), text): (([f32; 2], f32), &String)| LabelledDisc {
            center: [f64::from(x), f64::from(y)],
            radius: f64::from(radius),
            half: [LETTER * text.chars().count() as f64 + BESIDE, HEIGHT].map(|size| 0.5 * size * self.unit),
        };
        let parts: Vec<LabelledDisc> = discs.into_iter().zip(&self.texts).map(labelled).collect();
        self.placed = place_labels(&parts, self.bounds, &self.placed);
        let hung_from = |[x, y]: [f64; 2]| [x as f32, (y - HANGS * self.unit) as f32];
        self.placed.iter().map(|place| hung_from(place.center)).collect()
    }
}

/// The kind of each id shortened to the letters that tell it from the others: `penny-12` to `p12`, beside `dime-1` and
/// `dollar-2` to `di1` and `do2`. An id that does not begin with its kind, or whose short text is also the name or the
/// short text of another part, keeps its whole text.
fn shortened(ids: &[&str], kinds: &[&str]) -> Vec<String> {
    let head = |kind: &str, letters: usize| kind.chars().take(letters).collect::<String>();
    let short = |kind: &str| {
        let is_clear = |&letters: &usize| {
            let own = head(kind, letters);
            kinds.iter().all(|&other| other == kind || head(other, letters) != own)
        };
        (1..=kind.chars().count()).find(is_clear).map_or_else(|| kind.to_owned(), |letters| head(kind, letters))
    };
    let of_part = |(&id, &kind): (&&str, &&str)| {
        let number = id.strip_prefix(kind)?;
        Some(short(kind) + number.trim_start_matches('-'))
    };
    let texts: Vec<Option<String>> = ids.iter().zip(kinds).map(of_part).collect();
    let is_alone = |i: usize, text: &String| {
        let other = |j: usize| ids[j] != ids[i] && (ids[j] == text || texts[j].as_ref() == Some(text));
        !(0..ids.len()).any(other)
    };
    let kept = texts.iter().enumerate().map(|(i, text)| text.clone().filter(|text| is_alone(i, text)));
    kept.zip(ids).map(|(text, &id)| text.unwrap_or_else(|| id.to_owned())).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use proptest::prelude::*;

    #[test]
    fn names_of_many_parts_are_shortened_but_unique() {
        assert_eq!(shortened(&["penny-1", "penny-12"], &["penny"; 2]), ["p1", "p12"]);
        let kinds = ["dime", "dollar", "penny"];
        assert_eq!(shortened(&["dime-1", "dollar-2", "penny-3"], &kinds), ["di1", "do2", "p3"]);
        let kinds = ["nut", "nut-m6", "ä", "ring"];
        assert_eq!(shortened(&["nut-1", "nut-m6-2", "ä-1", "ring"], &kinds), ["nut1", "nut-2", "ä1", "r"]);
    }

    #[test]
    fn short_name_that_is_another_part_is_not_used() {
        let ids = ["nut-1", "nut-2", "nut-m6-2"];
        assert_eq!(shortened(&ids, &["nut", "nut", "nut-m6"]), ["nut1", "nut2", "nut-m6-2"]);
        // n1 with the number 1, and n with the number 11
        let ids = ["n1-1", "n-11"];
        let texts = shortened(&ids, &["n1", "n"]);
        assert_eq!(texts.iter().collect::<BTreeSet<_>>().len(), 2, "{texts:?}");
    }

    proptest! {
        #[test]
        fn short_names_are_unique_and_no_other_part_has_one_as_its_id(
            parts in proptest::collection::btree_set(
                (proptest::sample::select(vec!["n", "n1", "nut", "nut-m6", "nut-m", "nu", "washer-m6", "washer-m8"]), 1..13u32),
                1..25,
            ),
        ) {
            let ids: Vec<String> = parts.iter().map(|(kind, number)| format!("{kind}-{number}")).collect();
            let ids: Vec<&str> = ids.iter().map(String::as_str).collect();
            let kinds: Vec<&str> = parts.iter().map(|(kind, _)| *kind).collect();
            let texts = shortened(&ids, &kinds);
            prop_assert_eq!(texts.iter().collect::<BTreeSet<_>>().len(), ids.len(), "{:?}", texts);
            for (text, own) in texts.iter().zip(&ids) {
                prop_assert!(ids.iter().all(|id| id == own || id != text), "{own} is shown as {text}");
            }
        }
    }
}
