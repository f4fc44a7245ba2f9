use std::collections::HashSet;
use std::str::FromStr;

/// Largest number of seeds in a batch.
const MOST_SEEDS: u64 = 1_000_000;

/// The seeds of a batch, each once, in the order in which they are named: `1..20` (both ends included), `1,5,9` or
/// `1..3,7`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seeds(Vec<u64>);

impl Seeds {
    /// The seeds in their order.
    pub fn as_slice(&self) -> &[u64] {
        &self.0
    }
}

impl FromStr for Seeds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let allowed = format!("FIRST..LAST or seeds by comma, {MOST_SEEDS} at most");
        let mut seeds = Vec::new();
        for piece in text.split(',') {
            let (first, last) = ends(piece).ok_or_else(|| format!("expected {allowed}, found {text:?}"))?;
            let more = last - first;
            if more >= MOST_SEEDS - seeds.len() as u64 {
                return Err(format!("expected {allowed}, found more than {MOST_SEEDS} seeds in {text:?}"));
            }
            seeds.extend(first..=last);
        }
        let mut seen = HashSet::new();
        match seeds.iter().find(|&&seed| !seen.insert(seed)) {
            Some(twice) => Err(format!("expected each seed once, found {twice} twice in {text:?}")),
            None => Ok(Self(seeds)),
        }
    }
}

/// First and last seed of `7` or `3..9`; `None` for other text.
fn ends(piece: &str) -> Option<(u64, u64)> {
    let (first, last) = piece.split_once("..").unwrap_or((piece, piece));
    let (first, last) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
    (first <= last).then_some((first, last))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seeds(text: &str) -> Vec<u64> {
        text.parse::<Seeds>().unwrap().0
    }

    #[test]
    fn ranges_include_both_ends_and_keep_the_order_of_the_list() {
        assert_eq!(seeds("1..4"), [1, 2, 3, 4]);
        assert_eq!(seeds("9,1,5"), [9, 1, 5]);
        assert_eq!(seeds("7, 2..3"), [7, 2, 3]);
        assert_eq!(seeds("5..5"), [5]);
        let greatest = u64::MAX;
        assert_eq!(seeds(&format!("{}..{greatest}", greatest - 1)), [greatest - 1, greatest]);
        assert_eq!(seeds("0..999999").len(), 1_000_000);
    }

    #[test]
    fn text_that_names_no_seeds_is_refused_with_itself_in_the_message() {
        for text in ["", ",", "1,", "x", "-1", "1.5", "4..1", "1..", "..4", "1...4", "1..=4", "18446744073709551616"] {
            let message = text.parse::<Seeds>().unwrap_err();
            assert!(
                message.starts_with("expected FIRST..LAST") && message.ends_with(&format!("{text:?}")),
                "{message}"
            );
        }
    }

    #[test]
    fn batch_is_bounded_before_its_seeds_are_listed() {
        for text in ["0..1000000", "1..999999,2000000..2000001", "0..18446744073709551615"] {
            assert!(text.parse::<Seeds>().unwrap_err().contains("more than 1000000 seeds"), "{text}");
        }
    }

    #[test]
    fn seed_named_twice_is_refused() {
        assert_eq!("1..3,2".parse::<Seeds>().unwrap_err(), r#"expected each seed once, found 2 twice in "1..3,2""#);
    }
}
