//! Ceilings of code for each crate.

use std::collections::BTreeMap;

use super::rules::Source;

/// Most lines of code outside tests in a crate. A change that adds also removes: a ceiling is raised only where a new
/// capability is worth it, and lowered when its crate shrinks.
const CEILINGS: [(&str, usize); 14] = [
    ("chart", 786),
    ("control", 4170), // 54 of issue 48's budget: which parts wait for which, spans
    ("core", 2605),    // 45 of issue 48's budget
    ("fixtures", 336),
    ("lab", 6188),
    ("perception", 4820),
    ("planning", 7690), // 30 of issue 48's budget: room for named parts
    ("recording", 1308),
    ("runner", 5336), // 433 of issue 48's budget: rigs by reference, warnings, paths, parts by name, verdict of dry runs
    ("scene", 869),
    ("server", 4601), // 11 of issue 48's budget
    ("sim", 3431),
    ("upm", 4992), // 232 of issue 48's budget: jobs by name, standard input, `--set`
    ("viewer", 1830),
];

/// Room above a crate's present lines, at most: a tenth, and what a small crate needs for one function.
const ROOM: usize = 10;
const FUNCTION: usize = 40;

/// Crates above their ceilings, far below them or without one.
pub fn faults(sources: &[Source]) -> Vec<String> {
    let mut lines: BTreeMap<&str, usize> = BTreeMap::new();
    for source in sources {
        *lines.entry(source.member()).or_default() += source.code_lines();
    }
    let ceilings = BTreeMap::from(CEILINGS);
    let fault = |(of, lines): (&str, usize)| match ceilings.get(of) {
        None => Some(format!("`{of}` has {lines} lines of code and no ceiling")),
        Some(ceiling) if lines > *ceiling => {
            Some(format!("`{of}` has {lines} lines of code, its ceiling is {ceiling}"))
        }
        Some(ceiling) if lines + lines / ROOM + FUNCTION < *ceiling => {
            Some(format!("`{of}` has {lines} lines of code, its ceiling of {ceiling} can be lowered"))
        }
        Some(_) => None,
    };
    lines.into_iter().filter_map(fault).collect()
}
