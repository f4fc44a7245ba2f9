//! Scanner for paths in Rust sources; it assumes sources that compile.

use std::collections::BTreeSet;
use std::sync::LazyLock;

use regex::Regex;

/// A path in a source, made absolute if it starts with `super`: `crate::geometry::Vec2`.
#[derive(Debug)]
pub struct Mention {
    pub line: usize,
    pub segments: Vec<String>,
    pub in_test: bool,
    /// Its form in the source.
    pub written: Written,
}

/// A path in its form in the source.
#[derive(Debug)]
pub struct Written {
    pub line: usize,
    pub path: Vec<String>,
    /// Name bound by a `use`.
    pub bound: Option<String>,
    /// Number of inline modules around it in the same file.
    pub inline: usize,
    /// True for a `pub use`, which re-exports the name.
    pub is_handed_on: bool,
}

#[derive(Clone, Debug)]
struct Token {
    text: String,
    line: usize,
}

impl Token {
    fn is_name(&self) -> bool {
        self.text.starts_with(|c: char| c.is_alphanumeric() || c == '_')
    }
}

/// Comments, strings, characters, names, `::` and single punctuation marks.
static TOKEN: LazyLock<Regex> = LazyLock::new(|| {
    let comment = r"//[^\n]*|/\*.*?\*/";
    let string = r###"b?r"[^"]*"|b?r#".*?"#|b?r##".*?"##|b?"(?:\\.|[^"\\])*""###;
    let character = r"b?'(?:\\(?:x..|u\{[^}]*\}|.)|[^'\\])'";
    Regex::new(&format!(r"(?s){comment}|{string}|{character}|\w+|::|\S")).unwrap()
});

/// Tokens without comments, strings and characters.
fn tokens(source: &str) -> Vec<Token> {
    let (mut tokens, mut line, mut counted) = (Vec::new(), 1, 0);
    for found in TOKEN.find_iter(source) {
        line += source[counted..found.start()].matches('\n').count();
        counted = found.start();
        let text = found.as_str();
        let is_quoted = text.len() > 1 && text.contains(['"', '\'']);
        if !(is_quoted || text.starts_with("//") || text.starts_with("/*")) {
            tokens.push(Token { text: text.to_owned(), line });
        }
    }
    tokens
}

/// Paths in a source, and its modules that are compiled for tests only.
#[derive(Debug, Default)]
pub struct Scan {
    pub mentions: Vec<Mention>,
    pub test_modules: Vec<String>,
    /// Names of the items defined in the source.
    pub defined: Vec<String>,
    /// Lines with code outside tests.
    pub code_lines: BTreeSet<usize>,
}

/// Scans a source; `depth` is that of its module: 0 for a crate's root, 1 for `src/sim/plate.rs`.
pub fn scan(source: &str, depth: usize) -> Scan {
    let tokens = tokens(source);
    let text = |i: usize| tokens.get(i).map_or("", |t| t.text.as_str());
    let mut scan = Scan::default();
    // For each open brace, whether it opens a module and whether it is in a test.
    let mut scopes: Vec<(bool, bool)> = Vec::new();
    let (mut pending_test, mut pending_module) = (false, false);
    let mut i = 0;
    while i < tokens.len() {
        let in_test = pending_test || scopes.last().is_some_and(|s| s.1);
        let mut paths = Vec::new();
        let next = match text(i) {
            "#" if text(i + 1) == "[" && text(i + 2) == "cfg" => {
                let end = (i..tokens.len()).find(|&k| text(k) == "]").unwrap_or(tokens.len());
                let names: Vec<&str> = (i..end).map(text).collect();
                pending_test |= names.contains(&"test") && !names.contains(&"not");
                end
            }
            "use" if text(i + 1) != "<" => {
                let end = use_tree(&tokens, i + 1, &[], &mut paths);
                let is_handed_on = i > 0 && ["pub", ")"].contains(&text(i - 1));
                paths.iter_mut().for_each(|written| written.is_handed_on = is_handed_on);
                end
            }
            "struct" | "enum" | "fn" | "trait" | "type" | "const" | "static" | "union" => {
                scan.defined.push(text(i + 1).to_owned());
                i + 1
            }
            "mod" if text(i + 2) == ";" => {
                scan.test_modules.extend(in_test.then(|| text(i + 1).to_owned()));
                i + 2
            }
            "mod" => {
                pending_module = true;
                i + 1
            }
            "{" => {
                scopes.push((std::mem::take(&mut pending_module), in_test));
                pending_test = false;
                i + 1
            }
            "}" => {
                scopes.pop();
                i + 1
            }
            ";" => {
                pending_test = false;
                i + 1
            }
            _ if tokens[i].is_name() && text(i + 1) == "::" && (i == 0 || text(i - 1) != "::") => {
                let mut end = i;
                while text(end + 1) == "::" && tokens.get(end + 2).is_some_and(Token::is_name) {
                    end += 2;
                }
                let path = (i..=end).step_by(2).map(|k| text(k).to_owned()).collect();
                paths.push(Written { line: tokens[i].line, path, bound: None, inline: 0, is_handed_on: false });
                end + 1
            }
            _ => i + 1,
        };
        if !(in_test || pending_test) {
            scan.code_lines.extend(tokens[i..next.min(tokens.len())].iter().map(|token| token.line));
        }
        let inline = scopes.iter().filter(|s| s.0).count();
        scan.mentions.extend(paths.into_iter().map(|written| Mention {
            line: written.line,
            segments: absolute(written.path.clone(), depth + inline),
            in_test,
            written: Written { inline, ..written },
        }));
        i = next;
    }
    scan
}

/// Expands the tree of a `use` that starts at token `i`; returns the index of the token after it.
fn use_tree(tokens: &[Token], mut i: usize, before: &[String], paths: &mut Vec<Written>) -> usize {
    let (mut path, mut alias) = (before.to_vec(), None);
    while let Some(token) = tokens.get(i) {
        match token.text.as_str() {
            "{" => {
                while tokens.get(i).is_some_and(|t| t.text != "}" && t.text != ";") {
                    i = use_tree(tokens, i + 1, &path, paths);
                }
                return i + 1;
            }
            "as" => {
                i += 1;
                alias = tokens.get(i).map(|token| token.text.clone());
            }
            "::" => {}
            "}" | "," | ";" => break,
            name => path.push(name.to_owned()),
        }
        i += 1;
    }
    if path.len() > before.len() {
        if path.last().is_some_and(|last| last == "self") && path.len() > 1 {
            path.pop();
        }
        let bound = alias.or_else(|| path.last().cloned());
        paths.push(Written { line: tokens.get(i).map_or(0, |t| t.line), path, bound, inline: 0, is_handed_on: false });
    }
    i
}

/// A `super` path that leads to the crate's root as a `crate` path.
fn absolute(path: Vec<String>, depth: usize) -> Vec<String> {
    let climbs = path.iter().take_while(|s| *s == "super").count();
    if climbs == 0 || climbs < depth {
        path
    } else {
        std::iter::once("crate".into()).chain(path.into_iter().skip(climbs)).collect()
    }
}
