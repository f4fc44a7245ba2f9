//! Matches names by their beginning, as people type ids.

/// Word that selects the newest name.
pub(super) const LAST: &str = "last";

/// Most candidates listed in a message.
const SHOWN: usize = 6;

/// The item whose name is `text`, else the only one whose name begins with it. If several do, the error has their
/// number and the first of them as `shown` writes them.
pub(super) fn by_prefix<'a, T>(
    text: &str,
    items: &'a [T],
    name: impl Fn(&T) -> String,
    shown: impl Fn(&T) -> String,
) -> Result<Option<&'a T>, String> {
    if let Some(item) = items.iter().find(|item| name(item) == text) {
        return Ok(Some(item));
    }
    let found: Vec<&T> = items.iter().filter(|item| name(item).starts_with(text)).collect();
    if found.len() < 2 {
        return Ok(found.into_iter().next());
    }
    let candidates = found.iter().take(SHOWN).map(|item| shown(item)).collect::<Vec<_>>().join(", ");
    let more = match found.len().saturating_sub(SHOWN) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    Err(format!("{}: {candidates}{more}", found.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_name_wins_over_longer_ones_and_long_lists_are_cut() {
        let names = ["arrange-2", "arrange-24", "hold-4"];
        let found = |text| by_prefix(text, &names, ToString::to_string, ToString::to_string).map(|name| name.copied());
        assert_eq!(found("arrange-2"), Ok(Some("arrange-2")));
        assert_eq!(found("h"), Ok(Some("hold-4")));
        assert_eq!(found("arr"), Err("2: arrange-2, arrange-24".to_owned()));
        assert_eq!(found("arrange-3"), Ok(None));
        let names: Vec<String> = (0..8).map(|i| format!("run-{i}")).collect();
        let all = by_prefix("", &names, String::clone, String::clone).unwrap_err();
        assert_eq!(all, "8: run-0, run-1, run-2, run-3, run-4, run-5 and 2 more");
    }
}
