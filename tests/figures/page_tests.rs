//! Tests of the comparison of figures on a page.

use super::page::{FigurePage, numbers, refitted};

/// Two tables and a passage on two lines.
const PAGE: &str = "\
# Coins

| what | measured | paper |
|---|---|---|
| 2 pennies | 2.5 s (3.7 s), `upm-2` | |
| 2 pennies change places | none; 46 % | 40 % |

| name | measured |
|---|---|
| noise | 1.6e-12 at 5x |

They are off by 1.7 mm
instead of 0.65 mm, in 1,000 runs.
";

fn page() -> FigurePage {
    FigurePage::of("coins.md", PAGE.to_owned())
}

#[test]
fn numbers_take_measured_values_as_they_are_printed() {
    for (printed, measured, refit) in [
        ("2.5 s (3.7 s)", &[2.449, 3.66][..], "2.4 s (3.7 s)"),
        ("0.86 mm/s; 10 of 10", &[0.9, 9.0, 10.0], "0.90 mm/s; 9 of 10"),
        ("1e-11 of a T/16, `upm-2`, 1,000 at 10⁻⁵", &[2.4e-9], "2e-9 of a T/16, `upm-2`, 1,000 at 10⁻⁵"),
        ("1.6e-12, -0.000 mm (0.4°)", &[5.84e-12, -1e-9, 0.44], "5.8e-12, 0.000 mm (0.4°)"),
        ("d = 2 - √2: -4.72", &[2.0, -4.725001], "d = 2 - √2: -4.73"),
        ("in their bins", &[], "in their bins"),
    ] {
        assert_eq!(refitted(printed, measured).as_deref(), Some(refit), "{printed}");
    }
    assert_eq!(refitted("2.5 s (3.7 s)", &[2.5]), None);
    assert_eq!(refitted("2.5 s", &[2.5, 3.7]), None);
    assert_eq!(numbers("20 of 20, 7.8 s by `upm-2`"), [20.0, 20.0, 7.8]);
}

#[test]
fn figures_that_round_to_the_printed_ones_are_no_changes() {
    let mut page = page();
    page.cell("| what | measured", "2 pennies", "measured", &[2.45001, 3.74]);
    page.cell("| what | measured", "2 pennies change", "paper", &[40.4]);
    page.cell("| name", "noise", "measured", &[1.649e-12]);
    page.passage("are off by", "in 1,000 runs", &[1.6501, 0.6549]);
    assert_eq!(page.changes(), [[""; 2]; 0]);
    page.assert_as_measured();
}

#[test]
fn other_figures_are_shown_in_their_line() {
    let mut page = page();
    page.cell("| what | measured", "2 pennies", "measured", &[2.56, 3.7]);
    page.cell("| what | measured", "2 pennies change", "measured", &[47.0]);
    page.passage("are off by", "in 1,000 runs", &[1.7, 0.66]);
    let changes = [
        ["| 2 pennies | 2.5 s (3.7 s), `upm-2` | |", "| 2 pennies | 2.6 s (3.7 s), `upm-2` | |"],
        ["| 2 pennies change places | none; 46 % | 40 % |", "| 2 pennies change places | none; 47 % | 40 % |"],
        [
            "are off by 1.7 mm\ninstead of 0.65 mm, in 1,000 runs",
            "are off by 1.7 mm\ninstead of 0.66 mm, in 1,000 runs",
        ],
    ];
    assert_eq!(page.changes(), changes);
    assert_eq!(page.row("| what", "2 pennies").cell("measured"), "2.6 s (3.7 s), `upm-2`");
}

#[test]
fn rows_are_those_below_the_header() {
    let labels = |header: &str| page().rows(header).into_iter().map(|row| row.cells[0].clone()).collect::<Vec<_>>();
    assert_eq!(labels("| what |"), ["2 pennies", "2 pennies change places"]);
    assert_eq!(labels("| name |"), ["noise"]);
    assert_eq!(labels("| other |"), [""; 0]);
    assert_eq!(page().text_between("are off by ", " mm"), "1.7");
}

#[test]
fn sample_of_an_output_is_compared_as_it_is() {
    let mut page = page();
    page.sample("They are ", " mm", "off by 1.7");
    assert_eq!(page.changes(), [[""; 2]; 0]);
    page.sample("They are ", ", in", "right\n");
    assert_eq!(page.changes(), [["off by 1.7 mm\ninstead of 0.65 mm", "right\n"]]);
}
