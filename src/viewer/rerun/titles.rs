//! Titles of panels, in the width that they have in a window of 1280 points.

/// Width of the window that titles are made for, points of the screen.
pub(super) const WINDOW: f64 = 1280.0;

/// Width of a letter of a title, and of the symbol before it and the buttons after it, points.
const LETTER: f64 = 5.9;
const BESIDE: f64 = 125.0;

/// True if a panel of this width, points, shows the whole title.
pub(super) fn fits(title: &str, width: f64) -> bool {
    LETTER * title.chars().count() as f64 + BESIDE <= width
}

/// The title, or as much of it as a panel of this width shows: whole clauses if they are most of it, otherwise words.
pub(super) fn shortened(title: &str, width: f64) -> String {
    if fits(title, width) {
        return title.to_owned();
    }
    let ends = |separators: &[&str]| {
        let found = separators.iter().flat_map(|mark| title.match_indices(mark).map(|(at, _)| at)).collect::<Vec<_>>();
        found.into_iter().filter(|&at| fits(&title[..at], width - LETTER)).max()
    };
    let most = (width - BESIDE) / LETTER;
    match (ends(&[": ", "; ", ", ", " ("]), ends(&[" "])) {
        (Some(clause), _) if title[..clause].chars().count() as f64 >= 0.5 * most => title[..clause].to_owned(),
        (_, Some(word)) => format!("{}…", title[..word].trim_end_matches([',', ':', ';'])),
        (_, None) => title.chars().take(most.max(1.0) as usize).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn long_titles_end_with_a_clause_or_a_word() {
        let third = WINDOW / 3.0;
        for (title, expected) in [
            (
                "A pulse: wave, envelope and their product (Fig. 8)",
                "A pulse: wave, envelope and their product (Fig. 8)",
            ),
            ("Row f: accelerations and centre of rotation (Fig. 11)", "Row f: accelerations and centre of rotation"),
            (
                "Table 1, rows a to f: where the centre of rotation went",
                "Table 1, rows a to f: where the centre of rotation…",
            ),
        ] {
            assert_eq!(shortened(title, third), expected);
        }
        assert_eq!(shortened("Wort ohne Ende", 130.0), "W");
    }

    proptest! {
        #[test]
        fn shortened_title_fits(title in "[a-zäµ:, (]{0,80}", width in 140.0..1280.0f64) {
            prop_assert!(fits(&shortened(&title, width), width));
        }
    }
}
