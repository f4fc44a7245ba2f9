//! Parser of the pages: prose, fenced blocks, commands with their marks, and inline code. CONTRIBUTING.md has the rules
//! for those who write pages; `tools/doc_commands.py` reads pages by the same rules.

/// Languages of fenced blocks; a word after the language is for the test that reads the block.
const LANGUAGES: [&str; 5] = ["", "json", "sh", "text", "toml"];

/// Beginnings of lines that are commands.
const COMMANDS: [&str; 5] = ["$ ", "upm ", "upm-lab ", "cargo ", "python3 "];

/// How a block of commands is run.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// Typed by the test; the exit status is 0.
    Typed,
    /// Typed by the test; the exit status of the last command is this.
    Exit(i32),
    /// Goes on running while the following blocks of the page are typed.
    Background,
    /// Run by continuous integration: `.ci/run` has each command.
    Ci,
    /// Longer than a minute: run by the tool.
    Minutes,
    /// Not run, for this reason.
    No(String),
}

/// A fenced block of commands.
#[derive(Debug)]
pub struct Block {
    /// Line of the page at which its text begins, from 1.
    pub line: usize,
    pub mark: Mark,
    /// Commands as a shell takes them, each with its first line's offset in the block.
    pub commands: Vec<(usize, String)>,
    /// Output that the page shows below the block.
    pub output: Option<String>,
}

impl Block {
    /// True for commands that the test types.
    pub fn is_typed(&self) -> bool {
        matches!(self.mark, Mark::Typed | Mark::Exit(_) | Mark::Background)
    }
}

/// Use of a command in inline code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inline {
    /// Complete and of `upm` or `upm-lab`: a reader may type it, and the long test does.
    Prose,
    /// The same, longer than a minute: run by the tool.
    Minutes,
    /// Complete, and builds the project or measures it: run by the tool with `--heavy`.
    Heavy,
    /// Named, or with a placeholder: its name and options are checked by `tests/docs.rs`.
    Named,
}

/// A page with its commands.
#[derive(Debug, Default)]
pub struct Page {
    pub name: String,
    /// Text outside fenced blocks, without the marks.
    pub prose: String,
    /// Fenced blocks in any language: the words after the fence, and the text.
    pub fences: Vec<(String, String)>,
    pub blocks: Vec<Block>,
    /// True when the page takes too long for every `cargo test`.
    pub is_slow: bool,
    /// Inline commands that the page marks as longer than a minute.
    pub long: Vec<String>,
    /// Inline code.
    pub codes: Vec<String>,
    /// Breaches of the rules.
    pub faults: Vec<String>,
}

/// A fenced block while it is read.
struct Fence {
    line: usize,
    indent: usize,
    language: String,
    text: String,
    mark: Option<Mark>,
}

impl Page {
    pub fn read(name: &str, text: &str) -> Self {
        let mut page = Self { name: name.to_owned(), ..Self::default() };
        let (mut fence, mut mark, mut is_below) = (None::<Fence>, None, false);
        for (i, line) in text.lines().enumerate() {
            let bare = line.trim_start();
            if let Some(mut open) = fence.take() {
                if bare.starts_with("```") {
                    is_below = page.close(open, is_below);
                } else {
                    open.text += line.get(open.indent..).unwrap_or_default();
                    open.text.push('\n');
                    fence = Some(open);
                }
                continue;
            }
            if let Some(language) = bare.strip_prefix("```") {
                let indent = line.len() - bare.len();
                let language = language.to_owned();
                fence = Some(Fence { line: i + 2, indent, language, text: String::new(), mark: mark.take() });
                page.prose.push('\n');
                continue;
            }
            is_below &= bare.is_empty();
            if mark.take().is_some() {
                page.faults.push(format!("{name}:{i}: a mark without a block on the next line"));
            }
            match bare.strip_prefix("<!-- run: ").map(|rest| rest.strip_suffix(" -->")) {
                Some(Some(words)) => mark = page.mark(i + 1, words),
                Some(None) => page.faults.push(format!("{name}:{}: a mark is one line", i + 1)),
                None => page.prose.extend([line, "\n"]),
            }
        }
        page.codes = codes(&page.prose);
        page
    }

    /// The mark that these words give to the next block. A mark of the whole page is noted at once.
    fn mark(&mut self, line: usize, words: &str) -> Option<Mark> {
        let (kind, rest) = words.split_once(": ").unwrap_or((words, ""));
        match (kind, rest) {
            ("slow", "") => {
                self.is_slow = true;
                None
            }
            ("background", "") => Some(Mark::Background),
            ("ci", "") => Some(Mark::Ci),
            ("minutes", "") => Some(Mark::Minutes),
            ("minutes", command) => {
                self.long.push(command.to_owned());
                None
            }
            ("no", reason) if !reason.is_empty() => Some(Mark::No(reason.to_owned())),
            _ => {
                let status = words.strip_prefix("exit ").and_then(|status| status.parse().ok());
                if status.is_none() {
                    self.faults
                        .push(format!("{}:{line}: expected a mark of CONTRIBUTING.md, found {words:?}", self.name));
                }
                status.map(Mark::Exit)
            }
        }
    }

    /// Takes a block that is closed; true when the next one may be its output.
    fn close(&mut self, fence: Fence, is_below: bool) -> bool {
        let language = fence.language.split(' ').next().unwrap_or_default();
        let mut fault = |words: &str| self.faults.push(format!("{}:{}: {words}", self.name, fence.line));
        if !LANGUAGES.contains(&language) {
            fault(&format!("expected a block in one of {LANGUAGES:?}, found {language:?}"));
        }
        if language == "sh" {
            self.blocks.push(Block {
                line: fence.line,
                mark: fence.mark.unwrap_or(Mark::Typed),
                commands: commands(&fence.text),
                output: None,
            });
            self.fences.push((fence.language, fence.text));
            return true;
        }
        let is_command = |line: &&str| COMMANDS.iter().any(|begin| line.starts_with(begin));
        if let Some(hidden) = fence.text.lines().find(is_command).filter(|_| !["json", "toml"].contains(&language)) {
            fault(&format!("a command outside a block of `sh`: {hidden}"));
        }
        if fence.mark.is_some() {
            fault("a mark at a block without commands");
        }
        if language == "text"
            && is_below
            && let Some(block) = self.blocks.last_mut()
        {
            block.output = Some(fence.text.clone());
        }
        self.fences.push((fence.language, fence.text));
        false
    }

    /// Inline commands with their use; `long` has those that some page marks as longer than a minute.
    pub fn inline<'a>(&'a self, long: &'a [String]) -> impl Iterator<Item = (&'a str, Inline)> {
        self.codes.iter().filter_map(|code| Some((code.as_str(), usage(code, long)?)))
    }
}

/// Commands of a block: one a line. A command goes on after a `\` at the end of its line and up to the end of a here
/// document; empty lines and comments are none.
fn commands(text: &str) -> Vec<(usize, String)> {
    let mut commands: Vec<(usize, String)> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        match commands.last_mut().filter(|(_, command)| goes_on(command)) {
            Some((_, command)) => *command = format!("{command}\n{line}"),
            None if line.is_empty() || line.starts_with('#') => {}
            None => commands.push((i, line.to_owned())),
        }
    }
    commands
}

fn goes_on(command: &str) -> bool {
    let end = command.split_once("<<").and_then(|(_, rest)| rest.split_whitespace().next());
    let is_open = |end: &str| !command.lines().skip(1).any(|line| line == end.trim_matches('\''));
    command.ends_with('\\') || end.is_some_and(is_open)
}

/// A command in one line, without its comment and without the text of a here document.
pub fn in_one_line(command: &str) -> String {
    let joined = command.replace("\\\n", " ");
    let first = joined.lines().next().unwrap_or_default();
    first.split(" #").next().unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Inline code of the prose, which has no fenced blocks any more; a code may go on in the next line.
fn codes(prose: &str) -> Vec<String> {
    let paragraphs = prose.split("\n\n");
    let codes = paragraphs.flat_map(|paragraph| paragraph.split('`').skip(1).step_by(2));
    codes.map(|code| code.split_whitespace().collect::<Vec<_>>().join(" ")).collect()
}

/// Use of inline code; `None` when it is no command.
pub fn usage(code: &str, long: &[String]) -> Option<Inline> {
    let words: Vec<&str> = code.split(' ').collect();
    if !["upm", "upm-lab", "cargo", "python3"].contains(&words[0]) || words.len() < 2 {
        return None;
    }
    // two capital letters in a row, brackets or an ellipsis: something that the reader puts in
    let is_capital = |pair: &[u8]| pair.iter().all(u8::is_ascii_uppercase);
    let is_left_open =
        |word: &&str| word.contains(['[', '…']) || word.contains("...") || word.as_bytes().windows(2).any(is_capital);
    if words.iter().any(is_left_open) {
        return Some(Inline::Named);
    }
    let takes_long = long.iter().any(|command| command == code);
    Some(match words[..] {
        ["upm", _, argument, ..] | ["upm-lab", argument, ..] if !argument.starts_with('-') => {
            if takes_long {
                Inline::Minutes
            } else {
                Inline::Prose
            }
        }
        ["cargo", "bench" | "build" | "run" | "test", _, ..] => Inline::Heavy,
        // the tool does not run itself
        ["python3", "tools/doc_commands.py", ..] => Inline::Named,
        ["python3", script, ..] if script.starts_with("tools/") => Inline::Heavy,
        _ => Inline::Named,
    })
}
