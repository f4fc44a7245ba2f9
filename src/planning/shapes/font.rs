//! Stroke font of capitals, digits and a few signs, designed for placing parts along its lines.

use kurbo::{Affine, BezPath, Shape};

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

/// A letter a line, as SVG path data with y upwards, from 0 to [`CAPITAL`]. Lines touch only at ends of their segments,
/// so that those points become knots.
const GLYPHS: &str = include_str!("../../../assets/stroke-font.txt");

/// All letters of the font except the space.
pub fn known_letters() -> impl Iterator<Item = char> {
    GLYPHS.lines().filter_map(|glyph| glyph.chars().next())
}

impl Drawing {
    /// One line of text with capitals of `height_m`, centred at `center_m`. Small letters are drawn as capitals.
    ///
    /// # Errors
    /// The first letter that the font lacks.
    pub fn of_text(text: &str, height_m: f64, center_m: Vec2) -> Result<Self, char> {
        let (mut path, mut at, mut right) = (BezPath::new(), 0.0, 0.0);
        for letter in text.chars() {
            if letter == ' ' {
                at += SPACE;
                continue;
            }
            let glyph = glyph(letter).ok_or(letter)?;
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
    let d = GLYPHS.lines().find_map(|glyph| glyph.strip_prefix(capital)?.strip_prefix(' '))?;
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
        for (letters, knots) in [("O8", 1), ("CDISU69", 2), ("P3", 3), ("BTY", 4), ("AMX4+", 5), ("EH", 6)] {
            for letter in letters.chars() {
                let drawing = Drawing::of_text(&letter.to_string(), 0.1, Vec2::zeros()).unwrap();
                assert_eq!(drawing.fewest(), knots, "{letter}");
            }
        }
    }

    #[test]
    fn letter_that_is_missing_is_named() {
        assert_eq!(Drawing::of_text("UPÜ", 0.1, Vec2::zeros()), Err('Ü'));
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
