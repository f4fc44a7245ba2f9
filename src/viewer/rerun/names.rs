use rerun::{Color, Points2D};

use super::paint::{colors, thin};
use upm_chart::{LabelPlace, Labelled, place_labels};

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
    /// Names in a view of these bounds on a panel of `panel` points of the screen; `ids` are the names of the parts.
    pub(super) fn new(ids: &[&str], rgb: &[[u8; 3]], bounds: [[f64; 2]; 2], panel: [f64; 2]) -> Self {
        let unit = [0, 1].map(|axis| (bounds[axis][1] - bounds[axis][0]) / panel[axis]);
        let texts = if ids.len() < MANY { ids.iter().map(|&id| id.to_owned()).collect() } else { shortened(ids) };
        Self { texts, colors: colors(rgb), unit: unit[0].max(unit[1]), bounds, placed: Vec::new() }
    }

    /// The names beside discs, each a centre and a radius in the view.
    pub(super) fn beside(&mut self, discs: impl IntoIterator<Item = ([f32; 2], f32)>) -> Points2D {
        let places = self.places(discs);
        self.looks(Points2D::new(places))
    }

    /// The names without their places, for a whole recording.
    pub(super) fn without_places(&self) -> Points2D {
        self.looks(Points2D::update_fields())
    }

    /// Height of a label in the view.
    pub(super) fn label_height(&self) -> f64 {
        HEIGHT * self.unit
    }

    fn looks(&self, points: Points2D) -> Points2D {
        points
            .with_labels(self.texts.iter().map(String::as_str))
            .with_show_labels(true)
            .with_colors(self.colors.iter().copied())
            .with_radii([thin(0.1)])
    }

    /// Points that the names beside discs hang from.
    pub(super) fn places(&mut self, discs: impl IntoIterator<Item = ([f32; 2], f32)>) -> Vec<[f32; 2]> {
        let half = |text: &String| {
            let wide = LETTER * text.chars().count() as f64 + BESIDE;
            [0.5 * wide * self.unit, 0.5 * HEIGHT * self.unit]
        };
        let labelled = |(([x, y], radius), text): (([f32; 2], f32), &String)| Labelled {
            center: [f64::from(x), f64::from(y)],
            radius: f64::from(radius),
            half: half(text),
        };
        let parts: Vec<Labelled> = discs.into_iter().zip(&self.texts).map(labelled).collect();
        self.placed = place_labels(&parts, self.bounds, &self.placed);
        let hung = |place: &LabelPlace| {
            let [x, y] = place.center;
            [x as f32, (y - HANGS * self.unit) as f32]
        };
        self.placed.iter().map(hung).collect()
    }
}

/// The kind of the part called `id`.
pub(super) fn kind_of(id: &str) -> &str {
    id.rsplit_once('-').map_or(id, |(kind, _)| kind)
}

/// The kind of each id shortened to the letters that tell it from the others: `penny-12` to `p12`, beside `dime-1` and
/// `dollar-2` to `di1` and `do2`.
fn shortened(ids: &[&str]) -> Vec<String> {
    let kinds: Vec<&str> = ids.iter().map(|id| kind_of(id)).collect();
    let head = |kind: &str, letters: usize| kind.chars().take(letters).collect::<String>();
    let short = |kind: &str| {
        let longest = kind.chars().count();
        let is_clear = |&letters: &usize| {
            let own = head(kind, letters);
            kinds.iter().all(|&other| other == kind || head(other, letters) != own)
        };
        (1..=longest).find(is_clear).map_or_else(|| kind.to_owned(), |letters| head(kind, letters))
    };
    ids.iter().zip(&kinds).map(|(id, kind)| short(kind) + id[kind.len()..].trim_start_matches('-')).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_many_parts_are_as_short_as_tells_them_apart() {
        assert_eq!(shortened(&["penny-1", "penny-12"]), ["p1", "p12"]);
        assert_eq!(shortened(&["dime-1", "dollar-2", "penny-3"]), ["di1", "do2", "p3"]);
        assert_eq!(shortened(&["nut-1", "nut-m6-2", "ä-1", "ring"]), ["nut1", "nut-2", "ä1", "r"]);
    }
}
