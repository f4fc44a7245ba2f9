//! Ceilings of code for each crate.

use std::collections::BTreeMap;

use super::rules::Source;

/// Most lines of code outside tests in a crate: raised only by the budget of an issue, lowered when the crate shrinks.
const CEILINGS: [(&str, usize); 15] = [
    ("chart", 786),
    ("control", 4200), // 54 of issue 48's budget, and 30 of issue 49's: planners of a caller
    ("core", 2610),    // 45 of issue 48's budget, 5 of issue 49's
    ("fixtures", 336),
    ("lab", 6188),
    ("perception", 4820),
    ("planning", 7690), // 30 of issue 48's budget: room for named parts
    ("python", 430),    // all of issue 49's budget
    ("recording", 1308),
    ("runner", 5420), // 433 of issue 48's budget, 84 of issue 49's: what a caller brings in the place of a job's own
    ("scene", 869),
    ("server", 4601), // 11 of issue 48's budget
    ("sim", 3470),
    ("upm", 5372), // 232 of issue 48's budget, 380 of issue 49's: data sets for LeRobot, MCAP
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
