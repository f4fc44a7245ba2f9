//! Stroke font of capitals, digits and a few signs, designed for placing parts along its lines.

use kurbo::{Affine, BezPath, Shape};
use thiserror::Error;

use super::Drawing;
use super::drawing::Knots;
use super::svg::parsed;
use upm_core::geometry::Vec2;

/// Height of a capital in the units of [`GLYPHS`].
const CAPITAL: f64 = 4.0;

/// Gap between two letters, in the same units.
const BETWEEN: f64 = 1.8;

/// Width of a space, in the same units.
const SPACE: f64 = 1.2;

/// Letters as SVG path data with y upwards, from 0 to [`CAPITAL`]. Lines touch only at ends of their segments, so that
/// those points become knots.
const GLYPHS: &[(char, &str)] = &[
    ('A', "M0 0 L.4375 1.4 L1.25 4 L2.0625 1.4 L2.5 0 M.4375 1.4 H2.0625"),
    ('B', "M1 2 H0 V4 H1 A1 1 0 0 0 1 2 A1 1 0 0 0 1 0 H0 V2"),
    ('C', "M2.464 3.3 A1.4 2 0 1 1 2.464 .7"),
    ('D', "M0 0 V4 H.6 A1.8 2 0 0 0 .6 0 H0"),
    ('E', "M2.2 4 H0 V2 V0 H2.2 M0 2 H1.8"),
    ('F', "M2.2 4 H0 V2 V0 M0 2 H1.8"),
    ('G', "M2.464 3.3 A1.4 2 0 1 1 2.464 .7 V1.8 H1.4"),
    ('H', "M0 0 V2 V4 M2.4 0 V2 V4 M0 2 H2.4"),
    ('I', "M0 0 V4"),
    ('J', "M1.8 4 V1 A.9 1 0 0 0 0 1"),
    ('K', "M0 0 V2 V4 M2.3 4 L0 2 L2.3 0"),
    ('L', "M0 4 V0 H2.2"),
    ('M', "M0 0 V4 L1.5 1.4 L3 4 V0"),
    ('N', "M0 0 V4 L2.4 0 V4"),
    ('O', "M1.4 4 A1.4 2 0 0 1 1.4 0 A1.4 2 0 0 1 1.4 4 Z"),
    ('P', "M0 0 V2 V4 H1.2 A1 1 0 0 0 1.2 2 H0"),
    ('Q', "M1.4 4 A1.4 2 0 0 1 1.4 0 A1.4 2 0 0 1 2.38995 .58579 A1.4 2 0 0 1 1.4 4 Z M2.38995 .58579 L2.9 0"),
    ('R', "M0 0 V2 V4 H1.2 A1 1 0 0 0 1.2 2 H0 M1.2 2 L2.2 0"),
    ('S', "M2.134 3.342 A1.1 1 0 1 1 1.1 2 A1.1 1 0 1 0 .066 .658"),
    ('T', "M0 4 H1.2 H2.4 M1.2 4 V0"),
    ('U', "M0 4 V1.2 A1.2 1.2 0 0 1 2.4 1.2 V4"),
    ('V', "M0 4 L1.3 0 L2.6 4"),
    ('W', "M0 4 L.9 0 L1.8 3 L2.7 0 L3.6 4"),
    ('X', "M0 0 L1.2 2 L2.4 4 M0 4 L1.2 2 L2.4 0"),
    ('Y', "M0 4 L1.2 2 V0 M2.4 4 L1.2 2"),
    ('Z', "M0 4 H2.4 L0 0 H2.4"),
    ('0', "M1.2 4 A1.2 2 0 0 1 1.2 0 A1.2 2 0 0 1 1.2 4 Z"),
    ('1', "M0 3.2 L1 4 V0"),
    ('2', "M0 3 A1.1 1 0 0 0 2.2 3 C2.2 2 .6 1.2 0 0 H2.2"),
    ('3', "M.066 3.342 A1.1 1 0 1 0 1.1 2 A1.1 1 0 1 0 .066 .658"),
    ('4', "M1.8 0 V1.2 V4 L0 1.2 H1.8 H2.4"),
    ('5', "M2 4 H.15 V2.134 A1.2 1.25 0 1 0 .017 .533"),
    ('6', "M1.9 4 C.6 3.9 0 2.9 0 1.1 A1.15 1.1 0 0 1 2.3 1.1 A1.15 1.1 0 0 1 0 1.1"),
    ('7', "M0 4 H2.3 L.8 0"),
    ('8', "M1.1 2 A.95 1 0 0 1 1.1 4 A.95 1 0 0 1 1.1 2 A1.1 1 0 0 0 1.1 0 A1.1 1 0 0 0 1.1 2"),
    ('9', "M.4 0 C1.7 .1 2.3 1.1 2.3 2.9 A1.15 1.1 0 0 1 0 2.9 A1.15 1.1 0 0 1 2.3 2.9"),
    ('+', "M0 2 H1.2 H2.4 M1.2 .8 V2 V3.2"),
    ('-', "M0 2 H2"),
    ('/', "M0 0 L2 4"),
];

/// Error: the font lacks this letter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("no letter {0:?} in the stroke font")]
pub struct UnknownLetter(pub char);

/// All letters of the font except the space.
pub fn known_letters() -> impl Iterator<Item = char> {
    GLYPHS.iter().map(|(letter, _)| *letter)
}

impl Drawing {
    /// One line of text with capitals of `height_m`, centred at `center_m`. Small letters are drawn as capitals.
    ///
    /// # Errors
    /// The first letter that the font lacks.
    pub fn of_text(text: &str, height_m: f64, center_m: Vec2) -> Result<Self, UnknownLetter> {
        let (mut path, mut at, mut right) = (BezPath::new(), 0.0, 0.0);
        for letter in text.chars() {
            if letter == ' ' {
                at += SPACE;
                continue;
            }
            let glyph = glyph(letter).ok_or(UnknownLetter(letter))?;
            right = at + glyph.bounding_box().x1;
            path.extend(Affine::translate((at, 0.0)) * glyph);
            at = right + BETWEEN;
        }
        let to_middle = Affine::translate((-0.5 * right, -0.5 * CAPITAL));
        path.apply_affine(to_middle.then_scale(1.0 / CAPITAL));
        Ok(Self::of_path(&path, Knots::EndsCornersJunctions, height_m, center_m))
    }
}

fn glyph(letter: char) -> Option<BezPath> {
    let capital = letter.to_ascii_uppercase();
    let (_, d) = GLYPHS.iter().find(|(known, _)| *known == capital)?;
    parsed(d).ok()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn text() -> impl Strategy<Value = String> {
        let letters: Vec<char> = known_letters().chain([' ']).collect();
        proptest::collection::vec(proptest::sample::select(letters), 1..8).prop_map(String::from_iter)
    }

    #[test]
    fn letters_have_the_ends_corners_and_junctions_that_they_should() {
        for (letter, knots) in [
            ('A', 5),
            ('B', 4),
            ('C', 2),
            ('D', 2),
            ('E', 6),
            ('H', 6),
            ('I', 2),
            ('M', 5),
            ('O', 1),
            ('P', 3),
            ('S', 2),
            ('T', 4),
            ('U', 2),
            ('X', 5),
            ('Y', 4),
            ('3', 3),
            ('4', 5),
            ('6', 2),
            ('8', 1),
            ('9', 2),
            ('+', 5),
        ] {
            let drawing = Drawing::of_text(&letter.to_string(), 0.1, Vec2::zeros()).unwrap();
            assert_eq!(drawing.fewest(), knots, "{letter}");
        }
    }

    #[test]
    fn letter_that_is_missing_is_named() {
        assert_eq!(Drawing::of_text("UPÜ", 0.1, Vec2::zeros()), Err(UnknownLetter('Ü')));
        let small = Drawing::of_text("upm", 0.1, Vec2::zeros()).unwrap();
        assert_eq!(small, Drawing::of_text("UPM", 0.1, Vec2::zeros()).unwrap());
    }

    proptest! {
        #[test]
        fn any_text_gets_as_many_places_as_asked_for_within_its_height(
            text in text(), more in 0..40_usize, height_m in 0.02..0.25f64, x in -0.1..0.1f64, y in -0.1..0.1f64,
        ) {
            let center_m = Vec2::new(x, y);
            let drawing = Drawing::of_text(&text, height_m, center_m).unwrap();
            let fewest = drawing.fewest();
            prop_assert_eq!(fewest == 0, text.trim().is_empty());
            prop_assert_eq!(fewest.checked_sub(1).and_then(|fewer| drawing.places(fewer)), None);
            let Some(places) = drawing.places(fewest + more).filter(|_| fewest > 0) else {
                prop_assert!(fewest == 0);
                return Ok(());
            };
            prop_assert_eq!(places.len(), fewest + more);
            let above_m = places.iter().map(|place| (place - center_m).y.abs()).fold(0.0, f64::max);
            prop_assert!(above_m <= 0.5 * height_m + 1e-4, "{}", above_m);
            for (i, a) in places.iter().enumerate() {
                prop_assert!(places[..i].iter().all(|b| (a - b).norm() > 1e-6), "{:?}", places);
            }
        }

    }
}
