//! Matches names by their beginning, as people type ids.

/// Word that selects the newest name.
pub(super) const LAST: &str = "last";

/// Most candidates listed in a message.
const SHOWN: usize = 6;

/// Result of a match.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Match {
    None,
    /// Index of the only match.
    One(usize),
    /// Indices of all names that begin with the text.
    Several(Vec<usize>),
}

/// Finds the name equal to `text`, else those that begin with it.
pub(super) fn match_prefix<'a>(text: &str, names: impl Iterator<Item = &'a str>) -> Match {
    let mut found = Vec::new();
    for (index, name) in names.enumerate() {
        if name == text {
            return Match::One(index);
        }
        if name.starts_with(text) {
            found.push(index);
        }
    }
    match found.as_slice() {
        [] => Match::None,
        [one] => Match::One(*one),
        _ => Match::Several(found),
    }
}

/// The first [`SHOWN`] of `candidates` on one line.
pub(super) fn in_one_line(candidates: &[String]) -> String {
    let shown = candidates.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    match candidates.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_name_wins_over_longer_ones_and_several_are_all_found() {
        let names = ["arrange-2", "arrange-24", "hold-4"];
        let found = |text| match_prefix(text, names.into_iter());
        assert_eq!(found("arrange-2"), Match::One(0));
        assert_eq!(found("arrange-24"), Match::One(1));
        assert_eq!(found("h"), Match::One(2));
        assert_eq!(found("arr"), Match::Several(vec![0, 1]));
        assert_eq!(found(""), Match::Several(vec![0, 1, 2]));
        assert_eq!(found("arrange-3"), Match::None);
    }

    #[test]
    fn long_list_of_candidates_is_cut_with_a_count() {
        let names: Vec<String> = (0..8).map(|i| format!("run-{i}")).collect();
        assert_eq!(in_one_line(&names), "run-0, run-1, run-2, run-3, run-4, run-5 and 2 more");
        assert_eq!(in_one_line(&names[..2]), "run-0, run-1");
    }
}
