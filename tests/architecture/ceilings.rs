//! Ceilings of code for each crate.

use std::collections::BTreeMap;

use super::rules::Source;

/// Most lines of code outside tests in a crate: raised only by the budget of an issue, lowered when the crate shrinks.
const CEILINGS: [(&str, usize); 15] = [
    ("chart", 786),
    // 27 of issue 47's budget (pulses from rest where motions stall), 54 of issue 48's, and 30 of issue 49's
    ("control", 4232),
    ("core", 2606), // 45 of issue 48's budget, 13 of issue 49's: threads for items that are handed over, samples
    ("fixtures", 336),
    ("lab", 6188),
    ("perception", 4820),
    ("planning", 7750), // 30 of issue 48's budget: room for named parts; 60 of issue 49's: pulses as actions
    ("python", 541),    // all of issue 49's budget
    ("recording", 1308),
    // 433 of issue 48's budget, 640 of issue 49's: plates that learners step, a caller's own parts; campaigns, for
    // which 770 lines of the tools' loops went (issue 50)
    ("runner", 7340),
    ("scene", 869),
    ("server", 4495), // 11 of issue 48's budget
    ("sim", 3465),
    // 232 of issue 48's budget, 568 of issue 49's: benchmark, answers, data sets for LeRobot, MCAP; campaigns
    ("upm", 5702),
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
