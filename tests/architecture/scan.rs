//! Scanner for paths in Rust sources; it assumes sources that compile.

use std::collections::BTreeSet;

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

/// Tokens: names, `::` and single punctuation marks, without comments, strings and characters.
fn tokens(source: &str) -> Vec<Token> {
    let (mut tokens, mut rest, mut line) = (Vec::new(), source, 1);
    while let Some(c) = rest.chars().next() {
        let hashes = rest.trim_start_matches(['b', 'r']).chars().take_while(|&c| c == '#').count();
        let raw =
            rest.trim_start_matches('b').strip_prefix('r').is_some_and(|r| r[hashes.min(r.len())..].starts_with('"'));
        let name = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
        let (length, kept) = if rest.starts_with("//") {
            (rest.find('\n').unwrap_or(rest.len()), false)
        } else if rest.starts_with("/*") {
            (rest.find("*/").map_or(rest.len(), |end| end + 2), false)
        } else if raw {
            let start = rest.find('"').map_or(0, |i| i + 1);
            let close = format!("\"{}", "#".repeat(hashes));
            (rest[start..].find(&close).map_or(rest.len(), |end| start + end + close.len()), false)
        } else if c == '"' {
            (quoted_length(rest), false)
        } else if c == '\'' {
            (character_length(rest), false)
        } else if name > 0 {
            (name, true)
        } else if rest.starts_with("::") {
            (2, true)
        } else {
            (c.len_utf8(), !c.is_whitespace())
        };
        let (text, after) = rest.split_at(length);
        if kept {
            tokens.push(Token { text: text.to_owned(), line });
        }
        line += text.matches('\n').count();
        rest = after;
    }
    tokens
}

fn quoted_length(rest: &str) -> usize {
    let mut escaped = false;
    for (i, c) in rest.char_indices().skip(1) {
        match c {
            '"' if !escaped => return i + 1,
            _ => escaped = c == '\\' && !escaped,
        }
    }
    rest.len()
}

/// Length of a character literal with its quotes; 1 for the quote of a lifetime.
fn character_length(rest: &str) -> usize {
    let mut chars = rest.char_indices().skip(1);
    match (chars.next(), chars.next()) {
        (Some((_, '\\')), Some((after, _))) => rest[after + 1..].find('\'').map_or(rest.len(), |end| after + end + 2),
        (Some(_), Some((end, '\''))) => end + 1,
        _ => 1,
    }
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
