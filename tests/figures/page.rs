//! Figures on a page: the numbers in cells of its tables and in passages of its prose are compared with measured ones,
//! rounded as the page prints them. `UPM_REMAKE_GOLDEN=1` writes the measured ones into the page.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Held while a page is written: tests of one program run at the same time.
static WRITING: Mutex<()> = Mutex::new(());

/// Marks that may follow a number in its word.
const MARKS: [char; 7] = [',', ';', ':', '.', ')', '%', '°'];

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
        &self.cells[self.place(column)]
    }

    #[track_caller]
    fn place(&self, column: &str) -> usize {
        let found = find_only(self.columns.iter().map(String::as_str), column);
        found.unwrap_or_else(|| panic!("no one column {column:?} among {:?}", self.columns))
    }
}

impl FigurePage {
    /// Reads the page at this path below the repository.
    pub fn open(name: &'static str) -> Self {
        Self::of(name, fs::read_to_string(path(name)).unwrap())
    }

    pub fn of(name: &'static str, text: String) -> Self {
        Self { name, text, changes: Vec::new() }
    }

    /// Rows of all tables whose header begins with `header`.
    pub fn rows(&self, header: &str) -> Vec<TableRow> {
        let (mut rows, mut table) = (Vec::new(), None);
        for line in self.text.lines() {
            if !line.starts_with('|') {
                table = None;
                continue;
            }
            match &table {
                None => table = Some((line.starts_with(header), cells_of(line))),
                Some((true, columns)) if !line.starts_with("|--") => {
                    rows.push(TableRow { columns: columns.clone(), cells: cells_of(line), line: line.to_owned() });
                }
                Some(_) => {}
            }
        }
        rows
    }

    /// The row of these tables with this first cell, or the only one whose first cell begins so.
    #[track_caller]
    pub fn row(&self, header: &str, label: &str) -> TableRow {
        let rows = self.rows(header);
        let found = find_only(rows.iter().map(|row| row.cells[0].as_str()), label);
        let at = found.unwrap_or_else(|| panic!("{}: no one row {label:?} below {header:?}", self.name));
        rows[at].clone()
    }

    /// Compares the numbers in a cell of a row, in their order.
    #[track_caller]
    pub fn cell(&mut self, header: &str, label: &str, column: &str, measured: &[f64]) {
        let row = self.row(header, label);
        let at = row.place(column);
        let cell = row.cells[at].as_str();
        let refitted = self.refitted(cell, measured);
        let mut pieces: Vec<String> = row.line.split('|').map(str::to_owned).collect();
        // before the first bar there is nothing
        pieces[at + 1] = pieces[at + 1].replacen(cell, &refitted, 1);
        self.change(row.line, pieces.join("|"));
    }

    /// Compares the numbers between these words, which the page has once, in their order.
    #[track_caller]
    pub fn passage(&mut self, begin: &str, end: &str, measured: &[f64]) {
        let Range { start, end: stop } = self.between(begin, end);
        let refitted = self.refitted(&self.text[start..stop], measured);
        let (before, after) = (&self.text[start - begin.len()..start], &self.text[stop..stop + end.len()]);
        let printed = self.text[start - begin.len()..stop + end.len()].to_owned();
        let measured = format!("{before}{refitted}{after}");
        self.change(printed, measured);
    }

    /// Compares all of the text between these words, the first of which the page has once.
    #[track_caller]
    pub fn sample(&mut self, begin: &str, end: &str, output: &str) {
        let printed = self.text_between(begin, end).to_owned();
        self.change(printed, output.to_owned());
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
        let mut begun = flat.match_indices(begin).map(|(at, _)| at + begin.len());
        let (first, another) = (begun.next(), begun.next());
        let start = first.unwrap_or_else(|| panic!("{} does not say {begin:?}", self.name));
        assert_eq!(another, None, "{} says {begin:?} more than once", self.name);
        let length = flat[start..].find(end);
        start..start + length.unwrap_or_else(|| panic!("{} does not say {end:?} after {begin:?}", self.name))
    }

    #[track_caller]
    fn refitted(&self, printed: &str, measured: &[f64]) -> String {
        let refitted = refitted(printed, measured);
        refitted.unwrap_or_else(|| panic!("{}: {printed:?} has other numbers than {measured:?}", self.name))
    }

    fn change(&mut self, printed: String, measured: String) {
        if printed != measured {
            self.text = self.text.replacen(&printed, &measured, 1);
            self.changes.push([printed, measured]);
        }
    }

    /// Passages whose figures differ: as printed, and with the measured figures.
    pub fn changes(&self) -> &[[String; 2]] {
        &self.changes
    }

    /// Asserts that all compared figures are those measured.
    #[track_caller]
    pub fn assert_as_measured(self) {
        Self::assert_all([self]);
    }

    /// The same for several pages.
    #[track_caller]
    pub fn assert_all<const N: usize>(pages: [Self; N]) {
        let changes = pages.iter().flat_map(|page| page.changes.iter().map(move |change| (page.name, change)));
        let differing: Vec<String> =
            changes.map(|(name, [printed, measured])| format!("{name}\n- {printed}\n+ {measured}\n")).collect();
        if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
            eprint!("{}", differing.concat());
            pages.iter().for_each(Self::write);
            return;
        }
        let differing = differing.concat();
        assert!(differing.is_empty(), "other figures are measured; UPM_REMAKE_GOLDEN=1 writes them:\n{differing}");
    }

    /// Writes the measured figures into the file, in which other tests may have changed others.
    fn write(&self) {
        if self.changes.is_empty() {
            return;
        }
        let _writing = WRITING.lock().unwrap();
        let mut text = fs::read_to_string(path(self.name)).unwrap();
        for [printed, measured] in &self.changes {
            text = text.replacen(printed, measured, 1);
        }
        fs::write(path(self.name), text).unwrap();
    }
}

/// A file of the repository, below which the package under test is.
fn path(name: &str) -> PathBuf {
    let mut folders = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|folder| folder.join(name));
    folders.find(|path| path.is_file()).unwrap()
}

fn cells_of(line: &str) -> Vec<String> {
    let line = line.trim_end();
    let inner = line.strip_prefix('|').unwrap_or(line);
    inner.strip_suffix('|').unwrap_or(inner).split('|').map(|cell| cell.trim().to_owned()).collect()
}

/// Place of the text that equals `wanted`, or of the only one that begins with it.
fn find_only<'a>(texts: impl Iterator<Item = &'a str> + Clone, wanted: &str) -> Option<usize> {
    texts.clone().position(|text| text == wanted).or_else(|| {
        let mut begun = texts.enumerate().filter(|(_, text)| text.starts_with(wanted));
        let (at, _) = begun.next()?;
        begun.next().is_none().then_some(at)
    })
}

/// Place of the number in a word that is nothing but a number, a bracket before it and marks after it.
fn number_in(word: &str) -> Option<Range<usize>> {
    let start = word.len() - word.trim_start_matches('(').len();
    let end = word.trim_end().trim_end_matches(MARKS).len();
    let number = word.get(start..end)?;
    let begins = number.strip_prefix('-').unwrap_or(number).starts_with(|c: char| c.is_ascii_digit());
    (begins && number.parse::<f64>().is_ok()).then_some(start..end)
}

/// The numbers in `text`: words such as `upm-2`, `1,000` and `5x` are none.
pub fn numbers(text: &str) -> Vec<f64> {
    let words = text.split_whitespace();
    words.filter_map(|word| word[number_in(word)?].parse().ok()).collect()
}

/// `printed` with the measured figures in place of its numbers, with as many decimals; `None` unless there are as many.
pub fn refitted(printed: &str, measured: &[f64]) -> Option<String> {
    let mut measured = measured.iter();
    let mut text = String::new();
    for word in printed.split_inclusive(char::is_whitespace) {
        match number_in(word) {
            Some(place) => {
                text += &word[..place.start];
                text += &shown_like(&word[place.clone()], *measured.next()?);
                text += &word[place.end..];
            }
            None => text += word,
        }
    }
    measured.next().is_none().then_some(text)
}

/// `value` with the decimals of `printed`, and as a power of ten where `printed` is one.
fn shown_like(printed: &str, value: f64) -> String {
    let mantissa = printed.split('e').next().unwrap_or(printed);
    let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    let text = if mantissa == printed { format!("{value:.decimals$}") } else { format!("{value:.decimals$e}") };
    // pages have no negative zero
    if text.parse::<f64>() == Ok(0.0) { text.trim_start_matches('-').to_owned() } else { text }
}
