//! Figures on a page: the numbers in cells of its tables and in passages of its prose are compared with measured ones,
//! rounded as the page prints them. `UPM_REMAKE_GOLDEN=1` writes the measured ones into the page.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Held while a page is written: tests of one program run at the same time.
static WRITING: Mutex<()> = Mutex::new(());

/// A page whose figures are being compared.
#[derive(Debug)]
pub struct FigurePage {
    name: &'static str,
    text: String,
    /// Passages whose figures differ: as printed, and with the measured figures.
    changes: Vec<[String; 2]>,
}

/// A row of a table, with the headings of the table's columns.
#[derive(Clone, Debug)]
pub struct TableRow {
    pub columns: Vec<String>,
    pub cells: Vec<String>,
    line: String,
}

impl TableRow {
    /// Text below the heading `column`, or below the only one that begins so.
    #[track_caller]
    pub fn cell(&self, column: &str) -> &str {
        &self.cells[only(&self.columns, column)]
    }
}

impl FigurePage {
    /// Reads the page at this path below the repository.
    pub fn open(name: &'static str) -> Self {
        Self { name, text: fs::read_to_string(path(name)).unwrap(), changes: Vec::new() }
    }

    /// Rows of all tables whose header begins with `header`.
    pub fn rows(&self, header: &str) -> Vec<TableRow> {
        let (mut rows, mut columns, mut is_table) = (Vec::new(), None, false);
        for line in self.text.lines() {
            let was_table = std::mem::replace(&mut is_table, line.starts_with('|'));
            match &columns {
                _ if !was_table => columns = line.starts_with(header).then(|| cells_of(line)),
                Some(columns) if is_table && !line.starts_with("|--") => {
                    rows.push(TableRow { columns: columns.clone(), cells: cells_of(line), line: line.to_owned() });
                }
                _ => {}
            }
        }
        rows
    }

    /// The row of these tables with this first cell, or the only one whose first cell begins so.
    #[track_caller]
    pub fn row(&self, header: &str, label: &str) -> TableRow {
        let rows = self.rows(header);
        let labels: Vec<String> = rows.iter().map(|row| row.cells[0].clone()).collect();
        rows[only(&labels, label)].clone()
    }

    /// Compares the numbers in a cell of a row, in their order.
    #[track_caller]
    pub fn cell(&mut self, header: &str, label: &str, column: &str, measured: &[f64]) {
        let row = self.row(header, label);
        let at = only(&row.columns, column);
        let mut pieces: Vec<String> = row.line.split('|').map(str::to_owned).collect();
        // before the first bar there is nothing
        pieces[at + 1] = refitted(&pieces[at + 1], measured);
        self.change(row.line, pieces.join("|"));
    }

    /// Compares the numbers between these words, which the page has once, in their order.
    #[track_caller]
    pub fn passage(&mut self, begin: &str, end: &str, measured: &[f64]) {
        let Range { start, end: stop } = self.between(begin, end);
        let (before, after) = (&self.text[start - begin.len()..start], &self.text[stop..stop + end.len()]);
        let printed = &self.text[start..stop];
        let [printed, measured] = [printed, &refitted(printed, measured)].map(|text| format!("{before}{text}{after}"));
        self.change(printed, measured);
    }

    /// The text between these words, the first of which the page has once.
    #[track_caller]
    pub fn text_between(&self, begin: &str, end: &str) -> &str {
        &self.text[self.between(begin, end)]
    }

    #[track_caller]
    fn between(&self, begin: &str, end: &str) -> Range<usize> {
        // words may be on two lines
        let flat = self.text.replace('\n', " ");
        let begun: Vec<usize> = flat.match_indices(begin).map(|(at, _)| at + begin.len()).collect();
        let [start] = begun[..] else { panic!("{} says {begin:?} {} times", self.name, begun.len()) };
        let length = flat[start..].find(end);
        start..start + length.unwrap_or_else(|| panic!("{} does not say {end:?} after {begin:?}", self.name))
    }

    fn change(&mut self, printed: String, measured: String) {
        if printed != measured {
            self.text = self.text.replacen(&printed, &measured, 1);
            self.changes.push([printed, measured]);
        }
    }

    /// Asserts that all compared figures are those measured, or writes the measured ones.
    #[track_caller]
    pub fn assert_as_measured(self) {
        let show = |[printed, measured]: &[String; 2]| format!("- {printed}\n+ {measured}\n");
        let differing: String = self.changes.iter().map(show).collect();
        if std::env::var_os("UPM_REMAKE_GOLDEN").is_none() {
            assert_eq!(differing, "", "{}: other figures are measured; UPM_REMAKE_GOLDEN=1 writes them", self.name);
        } else if !self.changes.is_empty() {
            let _writing = WRITING.lock().unwrap();
            let text = fs::read_to_string(path(self.name)).unwrap();
            let text = self.changes.iter().fold(text, |text, [from, to]| text.replacen(from, to, 1));
            fs::write(path(self.name), text).unwrap();
        }
    }
}

/// A file of the repository, below which the package under test is.
fn path(name: &str) -> PathBuf {
    let mut folders = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|folder| folder.join(name));
    folders.find(|path| path.is_file()).unwrap()
}

fn cells_of(line: &str) -> Vec<String> {
    line.trim().trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()
}

/// Place of the text that equals `wanted`, or of the only one that begins with it.
#[track_caller]
fn only(texts: &[String], wanted: &str) -> usize {
    let begun: Vec<usize> = (0..texts.len()).filter(|&i| texts[i].starts_with(wanted)).collect();
    match texts.iter().position(|text| text == wanted) {
        Some(at) => at,
        None if begun.len() == 1 => begun[0],
        None => panic!("no one {wanted:?} among {texts:?}"),
    }
}

/// Place of the number in a word that is nothing but a number, a bracket before it and marks after it.
fn number_in(word: &str) -> Option<Range<usize>> {
    let start = word.len() - word.trim_start_matches('(').len();
    let end = word.trim_end().trim_end_matches([',', ';', ':', '.', ')', '%', '°']).len();
    let number = word.get(start..end)?;
    let begins = number.strip_prefix('-').unwrap_or(number).starts_with(|c: char| c.is_ascii_digit());
    (begins && number.parse::<f64>().is_ok()).then_some(start..end)
}

/// The numbers in `text`: words such as `upm-2`, `1,000` and `5x` are none.
pub fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().filter_map(|word| word[number_in(word)?].parse().ok()).collect()
}

/// `printed` with the measured figures in place of its numbers, with as many decimals.
#[track_caller]
fn refitted(printed: &str, measured: &[f64]) -> String {
    assert_eq!(numbers(printed).len(), measured.len(), "{printed:?} has other numbers than {measured:?}");
    let mut measured = measured.iter();
    let words = printed.split_inclusive(char::is_whitespace).map(|word| match number_in(word) {
        Some(place) => {
            let shown = shown_like(&word[place.clone()], *measured.next().unwrap());
            format!("{}{shown}{}", &word[..place.start], &word[place.end..])
        }
        None => word.to_owned(),
    });
    words.collect()
}

/// `value` with the decimals of `printed`, and as a power of ten where `printed` is one.
fn shown_like(printed: &str, value: f64) -> String {
    let mantissa = printed.split('e').next().unwrap_or(printed);
    let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    let text = if mantissa == printed { format!("{value:.decimals$}") } else { format!("{value:.decimals$e}") };
    // pages have no negative zero
    if text.parse::<f64>() == Ok(0.0) { text.trim_start_matches('-').to_owned() } else { text }
}

#[test]
fn numbers_take_measured_values_as_they_are_printed() {
    for (printed, measured, refit) in [
        ("0.86 mm/s; 10 of 10", &[0.9, 9.0, 10.0][..], "0.90 mm/s; 9 of 10"),
        ("1e-11 of a T/16, `upm-2`, 1,000", &[2.4e-9], "2e-9 of a T/16, `upm-2`, 1,000"),
        ("(-0.000 mm, 0.4°)", &[-1e-9, 0.44], "(0.000 mm, 0.4°)"),
    ] {
        assert_eq!(refitted(printed, measured), refit);
    }
}
